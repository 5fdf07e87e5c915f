// Nearest illumination vertices to a point, by a static balanced kd-tree
// [Volevich 2000, §3.1.3].
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "core/vec3.h"

namespace isolux {

struct Neighbour {
    std::int32_t vertex;
    float squared_distance; // m²
};

class VertexKdTree {
  public:
    // groups: one a vertex, 0 to 2^24; searches find vertices of the query's group alone.
    // Empty: all are one group.
    VertexKdTree(std::span<const Vec3f> positions, std::span<const std::int32_t> groups);
    ~VertexKdTree();
    VertexKdTree(const VertexKdTree&) = delete;
    VertexKdTree& operator=(const VertexKdTree&) = delete;

    // The `count` nearest to a vertex, by rising distance; fewer where there are no more. For
    // small counts: the cost is quadratic in it.
    void nearest(std::int32_t vertex, std::size_t count, std::vector<Neighbour>& out) const;
    // All at distances from inner to outer, outer excluded, by rising distance.
    void within(std::int32_t vertex, float squared_inner, float squared_outer,
                std::vector<Neighbour>& out) const;

    // All vertices, neighbours in space near each other.
    std::span<const std::uint32_t> spatial_order() const;

  private:
    struct Tree;
    std::unique_ptr<Tree> tree_;
};

} // namespace isolux
