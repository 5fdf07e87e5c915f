#include "core/tone_mapping.h"

#include <algorithm>
#include <bit>
#include <cassert>
#include <cmath>
#include <limits>
#include <numbers>

namespace isolux {

namespace {

constexpr double display_peak = 100.0;     // cd/m^2
constexpr double display_contrast = 100.0; // peak over black, room light included
constexpr double display_gamma = 2.2;
constexpr double display_steps = 255.0;

// Below this the rods alone see and the fit of the brightness doesn't hold; cd/m^2.
constexpr double scotopic_limit = 1e-3;

// Of a float's 23 bits of mantissa, those that are left below a step of the table: the float's
// leading bits, exponent and 8 bits of mantissa, number its steps in order of luminance.
constexpr int bits_within_step = 15;
constexpr std::uint32_t step_mask = (1u << bits_within_step) - 1;

std::uint32_t step_of(float luminance) {
    return std::bit_cast<std::uint32_t>(luminance) >> bits_within_step;
}

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

double ToneMapping::unbounded_value(double luminance) const {
    return scale_ * std::pow(luminance, exponent_) - 1.0 / display_contrast;
}

double ToneMapping::display_value(double luminance) const {
    return std::clamp(unbounded_value(luminance), 0.0, 1.0);
}

double ToneMapping::displayed_brightness(double luminance) const {
    return std::pow(std::max(0.0, unbounded_value(luminance)), 1.0 / display_gamma);
}

double ToneMapping::dark_luminance() const {
    return luminance_of(std::pow(1.0 / display_steps, display_gamma));
}

double ToneMapping::luminance_of(double value) const {
    return std::pow((value + 1.0 / display_contrast) / scale_, 1.0 / exponent_);
}

ToneTable::ToneTable(const ToneMapping& mapping) {
    constexpr double least = std::numeric_limits<float>::min();
    constexpr double most = std::numeric_limits<float>::max() / 2; // the last step stays finite
    dark_ = static_cast<float>(std::clamp(mapping.luminance_of(0.0), least, most));
    bright_ = static_cast<float>(std::clamp(mapping.luminance_of(1.0), least, most));
    first_ = step_of(dark_);
    const std::uint32_t last = step_of(bright_) + 1;
    values_.reserve(last - first_ + 1);
    for (std::uint32_t step = first_; step <= last; ++step)
        values_.push_back(static_cast<float>(
            mapping.unbounded_value(std::bit_cast<float>(step << bits_within_step))));
}

float ToneTable::display_value(float luminance) const {
    if (!(luminance >= dark_))
        return 0.0f;
    if (luminance >= bright_)
        return 1.0f;
    const auto bits = std::bit_cast<std::uint32_t>(luminance);
    const std::uint32_t step = (bits >> bits_within_step) - first_;
    const float along = static_cast<float>(bits & step_mask) / (step_mask + 1);
    return std::max(0.0f, values_[step] + along * (values_[step + 1] - values_[step]));
}

} // namespace isolux
