#include "core/tone_mapping.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <numbers>

namespace isolux {

namespace {

constexpr double display_peak = 100.0;     // cd/m^2
constexpr double display_contrast = 100.0; // peak over black, room light included
constexpr double display_gamma = 2.2;
constexpr double display_steps = 255.0;

// Below this the rods alone see and the fit of the brightness doesn't hold; cd/m^2.
constexpr double scotopic_limit = 1e-3;

double lamberts(double luminance) { return std::numbers::pi * 1e-4 * luminance; }

// Brightness in brils is 10^beta * (luminance in lamberts)^alpha [Stevens and Stevens 1963].
struct Brightness {
    double alpha;
    double beta;

    explicit Brightness(double adaptation_luminance) {
        const double l = std::log10(lamberts(std::max(adaptation_luminance, scotopic_limit)));
        alpha = 0.4 * l + 2.92;
        beta = -0.4 * l * l - 2.584 * l + 2.0208;
    }
};

} // namespace

// Departure: Tumblin and Rushmeier shift the log-average up by 0.84. That shift stands for a gaze
// drawn to lamps and windows, and a surface average holds neither; with it an evenly lit room
// comes out nearly black (test_an_evenly_lit_room_is_shown_in_mid_tones).
double adaptation_luminance(std::span<const double> luminance, std::span<const double> area) {
    assert(luminance.size() == area.size());
    double sum = 0.0;
    double lit_area = 0.0;
    for (std::size_t i = 0; i < luminance.size(); ++i) {
        if (luminance[i] > 0.0) {
            sum += area[i] * std::log(luminance[i]);
            lit_area += area[i];
        }
    }
    return lit_area > 0.0 ? std::exp(sum / lit_area) : 0.0;
}

// With both brightnesses equal, the display's luminance is a power of the scene's:
// scale_ * luminance^exponent_, in units of the display's peak.
ToneMapping::ToneMapping(double adaptation_luminance) {
    const Brightness world(adaptation_luminance);
    const Brightness display(display_peak / std::sqrt(display_contrast));
    exponent_ = world.alpha / display.alpha;
    scale_ = std::pow(10.0, (world.beta - display.beta) / display.alpha) *
             std::pow(lamberts(1.0), exponent_) / lamberts(display_peak);
}

double ToneMapping::display_value(double luminance) const {
    const double value = scale_ * std::pow(luminance, exponent_) - 1.0 / display_contrast;
    return std::clamp(value, 0.0, 1.0);
}

double ToneMapping::displayed_brightness(double luminance) const {
    const double value = scale_ * std::pow(luminance, exponent_) - 1.0 / display_contrast;
    return std::pow(std::max(0.0, value), 1.0 / display_gamma);
}

double ToneMapping::dark_luminance() const {
    const double darkest = std::pow(1.0 / display_steps, display_gamma);
    return std::pow((darkest + 1.0 / display_contrast) / scale_, 1.0 / exponent_);
}

} // namespace isolux
