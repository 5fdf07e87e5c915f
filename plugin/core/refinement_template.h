// The template of an element: the triangles that it becomes once its edges are split
// [Volevich 2000, §3.1.1, Fig. 3].
#pragma once

#include <array>
#include <span>
#include <vector>

#include "core/edge_oracle.h"
#include "core/vec3.h"

namespace isolux {

// The corners, and all samples of three edges.
inline constexpr int kTemplateNodes = 3 * (kEdgeSamples - 1);

// A corner of the element, or a split on one of its edges.
struct TemplateNode {
    Vec3d position;                   // m
    std::array<double, 2> brightness; // front, back
    unsigned edges;                   // bit k: lies on edge k; a corner lies on two
};

// Triangles between nodes that go round the element, as indices, orientation kept. No vertex is
// added inside, and no two neighbouring elements disagree, whatever the splits.
// threshold : of brightness
std::vector<std::array<int, 3>> triangulate_template(std::span<const TemplateNode> nodes,
                                                     double threshold);

} // namespace isolux
