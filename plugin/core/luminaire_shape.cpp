#include "core/luminaire_shape.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <variant>

namespace isolux {
namespace {

constexpr double kPi = std::numbers::pi;

} // namespace

double bounding_radius(const LuminaireShape& shape) {
    return std::visit(
        Overloaded{
            [](const SphereLuminaire& s) { return s.radius; },
            [](const DiskLuminaire& s) { return s.radius; },
            [](const RectLuminaire& s) { return 0.5 * std::hypot(s.width, s.height); },
            [](const CylinderLuminaire& s) { return std::hypot(s.radius, 0.5 * s.length); },
            [](const TriangleLuminaire& s) {
                return std::max({length(s.a), length(s.b), length(s.c)});
            },
            [](const auto&) { return 0.0; },
        },
        shape);
}

double luminous_area(const LuminaireShape& shape) {
    return std::visit(
        Overloaded{
            [](const SphereLuminaire& s) { return 4.0 * kPi * s.radius * s.radius; },
            [](const DiskLuminaire& s) { return kPi * s.radius * s.radius; },
            [](const RectLuminaire& s) { return s.width * s.height; },
            [](const CylinderLuminaire& s) { return 2.0 * kPi * s.radius * s.length; },
            [](const TriangleLuminaire& s) { return 0.5 * length(cross(s.b - s.a, s.c - s.a)); },
            [](const auto&) { return 0.0; },
        },
        shape);
}

bool is_flat(const LuminaireShape& shape) {
    return std::holds_alternative<DiskLuminaire>(shape) ||
           std::holds_alternative<RectLuminaire>(shape) ||
           std::holds_alternative<TriangleLuminaire>(shape);
}

double profile(const LuminaireShape& shape, const Vec3d& direction) {
    const auto flat = [&] { return std::max(0.0, -direction.z) / kPi; };
    return std::visit(Overloaded{
                          [&](const SphereLuminaire&) { return 0.25 / kPi; },
                          [&](const DiskLuminaire&) { return flat(); },
                          [&](const RectLuminaire&) { return flat(); },
                          [&](const CylinderLuminaire&) {
                              return std::hypot(direction.y, direction.z) / (kPi * kPi);
                          },
                          [&](const TriangleLuminaire&) { return flat(); },
                          [](const auto&) { return 0.0; },
                      },
                      shape);
}

} // namespace isolux
