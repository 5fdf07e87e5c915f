#include "core/triangle_copies.h"

#include <algorithm>
#include <cmath>

namespace isolux {
namespace {

// Of the size of a coordinate: half a unit in the last place of a float.
constexpr double kSamePlace = 0x1p-24;

// Of the cube over the longest axis: rays are turned back to the source in floats.
constexpr double kLeastVolume = 1e-3;

constexpr std::array<std::array<std::uint8_t, 3>, 6> kOrders{
    {{0, 1, 2}, {0, 2, 1}, {1, 2, 0}, {2, 1, 0}, {2, 0, 1}, {1, 0, 2}}};

} // namespace

std::optional<TriangleCopies> match_copies(std::span<const Vec3d> points,
                                           std::span<const std::array<std::int32_t, 3>> triangles,
                                           std::int32_t first, std::int32_t count,
                                           std::int32_t source, const Placement& placement) {
    const auto same = [](const Vec3d& a, const Vec3d& b) {
        const Vec3d d = a - b;
        const double size = std::max({std::abs(a.x), std::abs(a.y), std::abs(a.z)});
        return std::max({std::abs(d.x), std::abs(d.y), std::abs(d.z)}) <= kSamePlace * size;
    };
    const auto matches = [&](std::int32_t t, const std::array<std::uint8_t, 3>& order) {
        const auto& own = triangles[first + t];
        const auto& other = triangles[source + t];
        for (std::size_t k = 0; k < 3; ++k) {
            if (!same(points[own[k]], placement(points[other[order[k]]]))) {
                return false;
            }
        }
        return true;
    };
    const double longest =
        std::max({length(placement.x), length(placement.y), length(placement.z)});
    const double volume = std::abs(dot(placement.x, cross(placement.y, placement.z)));
    if (count == 0 || volume < kLeastVolume * longest * longest * longest) {
        return std::nullopt;
    }
    const auto order = std::ranges::find_if(kOrders, [&](const auto& o) { return matches(0, o); });
    if (order == kOrders.end()) {
        return std::nullopt;
    }
    for (std::int32_t t = 1; t < count; ++t) {
        if (!matches(t, *order)) {
            return std::nullopt;
        }
    }
    return TriangleCopies{first, count, source, placement, *order};
}

} // namespace isolux
