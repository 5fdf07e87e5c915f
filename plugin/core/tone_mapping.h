// Tone reproduction [Tumblin and Rushmeier 1993]: the display shows each luminance so that it
// looks as bright to the display's viewer as the scene does to an observer adapted to the scene.
#pragma once

#include <span>

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
    double scale_;
    double exponent_;
};

// The same for a caller that needs nothing else of the operator.
inline double dark_luminance(double adaptation_luminance) {
    return ToneMapping(adaptation_luminance).dark_luminance();
}

} // namespace isolux
