#include "core/angle_table.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace isolux {
namespace {

// Directions this near to the edge of the tabulated angles count as on it, in turns.
constexpr double kTurnSlack = 1e-9;
constexpr std::size_t kBucketsPerAngle = 4;

// In [0, 4): grows with the angle, by one a quarter of the circle, and needs no arc tangent.
double turn(double sine, double cosine) {
    if (sine >= 0.0) {
        return cosine > 0.0 ? sine / (sine + cosine) : 1.0 - cosine / (sine - cosine);
    }
    return cosine < 0.0 ? 2.0 + sine / (sine + cosine) : 3.0 + cosine / (cosine - sine);
}

double turn(double angle) {
    const double quarter = std::floor(angle / (0.5 * std::numbers::pi));
    const double rest = angle - quarter * 0.5 * std::numbers::pi;
    return quarter + turn(std::sin(rest), std::cos(rest));
}

// For |sine| up to 0.1: off by less than 1e-10.
double small_arc_sine(double sine) {
    const double x2 = sine * sine;
    return sine * (1.0 + x2 * (1.0 / 6.0 + x2 * (3.0 / 40.0 + x2 * (15.0 / 336.0))));
}

} // namespace

AngleTable::AngleTable(std::span<const double> angles) {
    for (std::size_t i = 0; i < angles.size(); ++i) {
        turns_.push_back(turn(angles[i]));
        if (i + 1 < angles.size()) {
            intervals_.push_back(
                {std::sin(angles[i]), std::cos(angles[i]), angles[i + 1] - angles[i]});
        }
    }
    const std::size_t count = kBucketsPerAngle * angles.size();
    buckets_per_turn_ = static_cast<double>(count) / (turns_.back() - turns_.front());
    for (std::size_t b = 0; b < count; ++b) {
        const double begin = turns_.front() + static_cast<double>(b) / buckets_per_turn_;
        const auto above = std::upper_bound(turns_.begin() + 1, turns_.end() - 1, begin);
        buckets_.push_back(static_cast<std::uint32_t>(above - turns_.begin() - 1));
    }
}

std::optional<AngleTable::Place> AngleTable::locate(double sine, double cosine) const {
    const double at = turn(sine, cosine);
    if (!(at >= turns_.front() - kTurnSlack && at <= turns_.back() + kTurnSlack)) {
        return std::nullopt;
    }
    const double bucket = std::max(0.0, (at - turns_.front()) * buckets_per_turn_);
    std::size_t i = buckets_[std::min(static_cast<std::size_t>(bucket), buckets_.size() - 1)];
    while (i > 0 && at < turns_[i]) { // the bucket's begin has rounded
        --i;
    }
    while (i + 1 < intervals_.size() && at >= turns_[i + 1]) {
        ++i;
    }
    const Interval& interval = intervals_[i];
    const double past = small_arc_sine(sine * interval.cosine - cosine * interval.sine);
    return Place{i, std::clamp(past / interval.width, 0.0, 1.0)};
}

} // namespace isolux
