// Triangles that are others in another place: found by their corners, so that one tree may stand
// for all of them.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>

#include "core/placement.h"
#include "core/vec3.h"

namespace isolux {

// Triangles [first, first + count) are those from `source` on, placed elsewhere. Corner k of each
// is corner `corners[k]` there.
struct TriangleCopies {
    std::int32_t first = 0, count = 0, source = 0;
    Placement placement;
    std::array<std::uint8_t, 3> corners{0, 1, 2};

    bool mirrored_order() const { return (corners[0] + 1) % 3 != corners[1]; }
};

// None where the triangles are not all the same to the rounding of a float ray, or all but flat.
std::optional<TriangleCopies> match_copies(std::span<const Vec3d> points,
                                           std::span<const std::array<std::int32_t, 3>> triangles,
                                           std::int32_t first, std::int32_t count,
                                           std::int32_t source, const Placement& placement);

} // namespace isolux
