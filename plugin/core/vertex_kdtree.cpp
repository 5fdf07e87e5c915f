#include "core/vertex_kdtree.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <tuple>

#include <nanoflann.hpp>

namespace isolux {
namespace {

// Groups lie apart in a fourth dimension, further than any two positions of one group, so that one
// tree serves all groups and a search never leaves its own.
struct Points {
    float spacing; // m, a power of two: multiples are exact
    std::vector<std::array<float, 4>> points;

    Points(std::span<const Vec3f> positions, std::span<const std::int32_t> groups)
        : points(positions.size()) {
        float largest = 0x1p-60F;
        for (const auto& p : positions) {
            largest = std::max({largest, std::abs(p.x), std::abs(p.y), std::abs(p.z)});
        }
        // The diagonal of the cube [-largest, largest]^3 is 3.5 times as long.
        spacing = std::exp2(std::ceil(std::log2(largest)) + 2.0F);
        for (std::size_t i = 0; i < points.size(); ++i) {
            const Vec3f& p = positions[i];
            points[i] = {p.x, p.y, p.z,
                         groups.empty() ? 0.0F : static_cast<float>(groups[i]) * spacing};
        }
    }
    std::size_t kdtree_get_point_count() const { return points.size(); }
    float kdtree_get_pt(std::size_t i, std::size_t axis) const { return points[i][axis]; }
    template <typename Box> bool kdtree_get_bbox(Box&) const { return false; }
};

using Index = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, Points>,
                                                  Points, 4, std::uint32_t>;

} // namespace

struct VertexKdTree::Tree {
    Points points;
    Index index;
    Tree(std::span<const Vec3f> positions, std::span<const std::int32_t> groups)
        : points(positions, groups),
          index(4, points, nanoflann::KDTreeSingleIndexAdaptorParams(16)) {}
};

VertexKdTree::VertexKdTree(std::span<const Vec3f> positions, std::span<const std::int32_t> groups)
    : tree_(std::make_unique<Tree>(positions, groups)) {}

VertexKdTree::~VertexKdTree() = default;

void VertexKdTree::nearest(std::int32_t vertex, std::size_t count,
                           std::vector<Neighbour>& out) const {
    thread_local std::vector<std::uint32_t> vertices;
    thread_local std::vector<float> squared_distances;
    vertices.resize(count);
    squared_distances.resize(count);
    const auto& points = tree_->points;
    const auto& query = points.points[static_cast<std::size_t>(vertex)];
    const std::size_t found =
        tree_->index.knnSearch(query.data(), count, vertices.data(), squared_distances.data());
    out.clear();
    for (std::size_t i = 0; i < found; ++i) {
        if (squared_distances[i] < points.spacing * points.spacing) {
            out.push_back({static_cast<std::int32_t>(vertices[i]), squared_distances[i]});
        }
    }
}

void VertexKdTree::within(std::int32_t vertex, float squared_inner, float squared_outer,
                          std::vector<Neighbour>& out) const {
    thread_local std::vector<std::pair<std::uint32_t, float>> found;
    found.clear();
    const auto& points = tree_->points;
    const auto& query = points.points[static_cast<std::size_t>(vertex)];
    nanoflann::SearchParams unsorted;
    unsorted.sorted = false;
    tree_->index.radiusSearch(
        query.data(), std::min(squared_outer, points.spacing * points.spacing), found, unsorted);
    out.clear();
    for (const auto& [other, squared_distance] : found) {
        if (squared_distance >= squared_inner) {
            out.push_back({static_cast<std::int32_t>(other), squared_distance});
        }
    }
    std::ranges::sort(out, [](const Neighbour& a, const Neighbour& b) {
        return std::tie(a.squared_distance, a.vertex) < std::tie(b.squared_distance, b.vertex);
    });
}

std::span<const std::uint32_t> VertexKdTree::spatial_order() const { return tree_->index.vAcc; }

} // namespace isolux
