// The hierarchy among whose members radiosity is exchanged: clusters of elements, elements, and
// their parts, down to leaves of about one area [Volevich 2000, §3.1.2; Sillion & Puech 1994].
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "core/form_factor.h"
#include "core/scene.h"
#include "core/vec3.h"

namespace isolux {

// A triangle: one side of an element or of a part of it, its children four in a row; or a cluster
// of such sides, its children two in a row.
struct RadiosityNode {
    Triangle corners;         // m; of a triangle only
    Vec3d centre;             // m, area-weighted; of a leaf that is partly hidden, in view
    Vec3d normal;             // unit; of a cluster the mean
    double area = 0.0;        // m²
    double radius = 0.0;      // m, about the centre, of all that it holds
    double normal_sine = 0.0; // of the largest angle to the normal; 1: beyond a right angle
    std::int32_t parent = -1; // of a part of an element
    std::int32_t first_child = -1;
    std::int32_t surface = -1; // -1: a cluster
    std::int32_t element = -1;
    double owned = 1.0;  // of a leaf, the share that no earlier element covers: that reflects
    bool hidden = false; // no light reaches the leaf; of others, one of the leaves

    bool leaf() const { return first_child < 0; }
    bool cluster() const { return surface < 0; }
    std::int32_t child_count() const { return leaf() ? 0 : cluster() ? 2 : 4; }
};

struct RadiosityHierarchy {
    std::vector<RadiosityNode> nodes;        // the first is the root; children follow parents
    std::vector<std::int32_t> element_sides; // nodes that are whole elements' sides
    std::vector<std::int32_t> leaves;
};

// leaves : about how many; elements smaller than their share are leaves as they are, and where
//     something stands on a surface or close before it, they are smaller
RadiosityHierarchy radiosity_hierarchy(const Scene& scene, double leaves);

} // namespace isolux
