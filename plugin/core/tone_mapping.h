// Tone reproduction [Tumblin and Rushmeier 1993]: the display shows each luminance so that it
// looks as bright to the display's viewer as the scene does to an observer adapted to the scene.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace isolux {

// Luminance to which an observer of these surfaces adapts: their area-weighted log-average.
// luminance : cd/m^2; surfaces at 0 (no light has reached them) don't count
// area : m^2, as many
// returns : cd/m^2; 0 where nothing is lit
double adaptation_luminance(std::span<const double> luminance, std::span<const double> area);

// The operator for one state of adaptation. The display: 100 cd/m^2 at its brightest, contrast 100.
class ToneMapping {
  public:
    // adaptation_luminance : of the scene's observer, cd/m^2, >= 0
    explicit ToneMapping(double adaptation_luminance);

    // Display value in [0, 1], linear (before gamma), of a luminance in cd/m^2.
    double display_value(double luminance) const;

    // The display's value after gamma, in which steps look about alike: 0 black, 1 white. Goes on
    // above 1, so that what is found good holds for darker exposures as well.
    double displayed_brightness(double luminance) const;

    // Greatest luminance, cd/m^2, that the display still shows as black:
    // its value after gamma is 1 of 255 steps.
    double dark_luminance() const;

  private:
    friend class ToneTable;

    // Before it is clamped, and its inverse.
    double unbounded_value(double luminance) const;
    double luminance_of(double value) const;

    double scale_;
    double exponent_;
};

// The display values of one state of adaptation, looked up [Volevich 2000, §6]: from black to the
// display's peak in steps of 1/256 octave, linear between them; off by less than 1e-5.
class ToneTable {
  public:
    explicit ToneTable(const ToneMapping& mapping);

    // As ToneMapping::display_value, of a luminance >= 0; 0 for NaN.
    float display_value(float luminance) const;

  private:
    std::uint32_t first_; // step of values_[0]
    float dark_;          // cd/m^2, below it: 0
    float bright_;        // cd/m^2, from it on: 1
    std::vector<float> values_;
};

// The same for a caller that needs nothing else of the operator.
inline double dark_luminance(double adaptation_luminance) {
    return ToneMapping(adaptation_luminance).dark_luminance();
}

} // namespace isolux
