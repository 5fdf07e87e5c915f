// Luminous intensity over direction as photometry tabulates it: a goniometric diagram, integrated
// and sampled exactly.
//
// Local axes: nadir (gamma = 0) is -Z, C0 is +X, C90 is +Y. Between the tabulated angles the
// intensity is bilinear in (gamma, C); outside them it is zero.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/angle_table.h"
#include "core/vec3.h"

namespace isolux {

class CandelaDistribution {
  public:
    // gamma: rad, strictly increasing in [0, pi], two or more.
    // c_angles: rad in [0, 2 pi]; one angle for an axially symmetric diagram, else strictly
    // increasing.
    // candela: cd, finite and >= 0, gamma.size() values for each C-plane in turn.
    // Throws std::invalid_argument where these don't hold.
    CandelaDistribution(std::span<const double> gamma, std::span<const double> c_angles,
                        std::span<const double> candela);

    double luminous_flux() const { return luminous_flux_; } // lm

    // The angle from nadir beyond which there is no light, rad.
    double widest_gamma() const;
    double peak_intensity() const; // cd

    // cd; `direction` is local and needs no unit length.
    double intensity(const Vec3d& direction) const;

    // Unit local direction with the density intensity / flux, 1/sr, from uniform numbers in [0, 1):
    // u0 chooses the cell, u1 the C-angle in it and u2 gamma. luminous_flux() must not be zero.
    Vec3d sample(double u0, double u1, double u2) const;

  private:
    // An interval between two neighbouring angles, in offsets x from its middle, |x| <= half.
    struct Interval {
        double half, sin_middle, cos_middle;
    };
    struct GammaBand : Interval {
        double sin_first, sin_last;       // of its two gamma angles
        double first_weight, last_weight; // integral of a linear intensity times sin(gamma)
    };
    // A column of the alias table [Walker 1977]: `cell` below the threshold, `alias` above.
    struct Column {
        double threshold;
        std::uint32_t cell, alias;
    };

    static Interval make_interval(double first, double last);
    static GammaBand make_band(double first, double last);
    static double invert_band(const GammaBand& band, double first, double last, double u);
    void tabulate_cells();

    bool axial_;
    // Refined, so that every interval is narrow.
    std::vector<double> gamma_, c_angles_;
    AngleTable gamma_table_, c_table_;
    std::vector<double> candela_; // by C-plane, then gamma
    std::vector<GammaBand> bands_;
    std::vector<Interval> sectors_; // between neighbouring C-planes
    std::vector<Column> columns_;   // of cells that give light
    double luminous_flux_ = 0.0;
};

} // namespace isolux
