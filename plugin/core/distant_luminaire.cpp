#include "core/distant_luminaire.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/luminous_outline.h"
#include "core/sampling.h"

namespace isolux {
namespace {

constexpr double kPi = std::numbers::pi;
// Directions tried until one is taken: a face that gets light gets some of them.
constexpr int kMostTries = 1 << 16;

// Of the directions within half_angle of the axis, at most a right angle, above the horizon.
double projected_solid_angle(const Vec3d& axis, double half_angle, const Vec3d& normal) {
    LuminousOutline outline(normal);
    const auto [s, t] = tangents(axis);
    const double radius = std::sin(half_angle);
    outline.add_circle({axis * std::cos(half_angle), s * radius, t * radius});
    return outline.projected_solid_angle();
}

// 1 - cosine, without cancellation.
double versine(double angle) {
    const double half = std::sin(0.5 * angle);
    return 2.0 * half * half;
}

} // namespace

double DistantLuminaire::illuminance(const Vec3d& axis, const Vec3d& normal) const {
    if (half_angle == 0.0) {
        return flux_density * std::max(0.0, dot(axis, normal));
    }
    const double luminance = flux_density / (2.0 * kPi * versine(half_angle));
    if (half_angle <= 0.5 * kPi) {
        return luminance * projected_solid_angle(axis, half_angle, normal);
    }
    // What is left of the hemisphere.
    return luminance * (kPi - projected_solid_angle(-axis, kPi - half_angle, normal));
}

Vec3d DistantLuminaire::direction(const Vec3d& axis, double u, double v) const {
    const double below = u * versine(half_angle); // 1 - cosine to the axis
    const double sine = std::sqrt(std::max(0.0, below * (2.0 - below)));
    const auto [s, t] = tangents(axis);
    return axis * (1.0 - below) + s * (sine * std::cos(2.0 * kPi * v)) +
           t * (sine * std::sin(2.0 * kPi * v));
}

Vec3d DistantLuminaire::cosine_direction(const Vec3d& axis, const Vec3d& normal,
                                         PhotonRandom& random) const {
    if (half_angle == 0.0) {
        return axis;
    }
    const double cosine = std::clamp(dot(axis, normal), -1.0, 1.0);
    const double most = std::cos(std::max(0.0, std::acos(cosine) - half_angle));
    const double depth = versine(half_angle);
    const auto [s, t] = tangents(axis);
    Vec3d out = axis;
    for (int i = 0; i < kMostTries; ++i) {
        const auto [a, b, r2] = uniform_disk<double>(random);
        const double below = r2 * depth; // 1 - cosine, uniform
        const double sine = std::sqrt((2.0 - below) * depth);
        out = axis * (1.0 - below) + s * (a * sine) + t * (b * sine);
        if (random.next_double() * most < dot(out, normal)) {
            break;
        }
    }
    return out;
}

} // namespace isolux
