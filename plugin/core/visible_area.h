// How much of each vertex's surroundings light can reach: the foot of a column or the edge of a
// slab covers a part of the floor or wall that it stands on, between the vertices. Photons leave
// nothing there and no ray hits it, so that neither knows of that part of the area.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/scene.h"

namespace isolux {

struct VisibleArea {
    std::vector<float> nearest; // share of the area that is nearest to the vertex
    std::vector<float> linear;  // of the area by barycentric weight
};

// One a vertex, by points of the elements that something cuts. A point is inside of a body where
// all rays from it meet one-sided backs, or two-sided surfaces without light. lit: whether a vertex
// has light
VisibleArea visible_area(const Scene& scene, std::span<const std::uint8_t> lit, std::uint64_t seed,
                         int threads);

} // namespace isolux
