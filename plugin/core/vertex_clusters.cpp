#include "core/vertex_clusters.h"

#include <algorithm>
#include <array>
#include <limits>

namespace isolux {
namespace {

// Of the stage's extent that a turn by one radian weighs in a split. Flat surfaces come apart by
// their orientation first; on round ones place and orientation go together.
constexpr float kTurnShare = 0.125F;

float coordinate(const Vec3f& position, const Vec3f& normal, int axis) {
    const std::array all{position.x, position.y, position.z, normal.x, normal.y, normal.z};
    return all[static_cast<std::size_t>(axis)];
}

} // namespace

VertexClusters::VertexClusters(std::span<const Receiver> receivers, std::span<const double> areas,
                               const Vec3d& origin)
    : positions_(receivers.size()), normals_(receivers.size()), rank_(receivers.size(), -1),
      normal_scale_(0.0F) {
    for (std::size_t v = 0; v < receivers.size(); ++v) {
        positions_[v] = (receivers[v].position - origin).as<float>();
        normals_[v] = receivers[v].normal;
        if (normals_[v] != Vec3f{}) {
            order_.push_back(static_cast<std::int32_t>(v));
            normal_scale_ = std::max(normal_scale_, 2.0F * kTurnShare * length(positions_[v]));
        }
    }
    if (order_.empty()) {
        return;
    }
    clusters_.reserve(2 * order_.size());
    int widest = 0;
    clusters_.push_back(summarize(0, static_cast<std::int32_t>(order_.size()), areas, widest));
    std::vector<std::pair<std::int32_t, int>> pending{{0, widest}}; // cluster, axis to split
    while (!pending.empty()) {
        const auto [at, axis] = pending.back();
        pending.pop_back();
        const auto [begin, end] = std::pair(clusters_[at].begin, clusters_[at].end);
        if (end - begin < 2) {
            continue;
        }
        const std::int32_t middle = begin + (end - begin) / 2;
        std::nth_element(order_.begin() + begin, order_.begin() + middle, order_.begin() + end,
                         [&, axis = axis](std::int32_t a, std::int32_t b) {
                             const float x = coordinate(positions_[a], normals_[a], axis);
                             const float y = coordinate(positions_[b], normals_[b], axis);
                             return x < y || (x == y && a < b);
                         });
        const auto children = static_cast<std::int32_t>(clusters_.size());
        clusters_[at].children = children;
        for (const auto& [from, to] : {std::pair(begin, middle), std::pair(middle, end)}) {
            clusters_.push_back(summarize(from, to, areas, widest));
            pending.emplace_back(static_cast<std::int32_t>(clusters_.size()) - 1, widest);
        }
    }
    for (std::size_t i = 0; i < order_.size(); ++i) {
        rank_[order_[i]] = static_cast<std::int32_t>(i);
    }
}

VertexCluster VertexClusters::summarize(std::int32_t begin, std::int32_t end,
                                        std::span<const double> areas, int& widest) const {
    double area = 0.0;
    std::array<double, 6> sum{}, square{};
    for (std::int32_t i = begin; i < end; ++i) {
        const std::int32_t v = order_[i];
        area += areas[v];
        for (int axis = 0; axis < 6; ++axis) {
            const auto x = static_cast<double>(coordinate(positions_[v], normals_[v], axis));
            sum[static_cast<std::size_t>(axis)] += x;
            square[static_cast<std::size_t>(axis)] += x * x;
        }
    }
    const double share = 1.0 / (end - begin);
    double largest = -1.0;
    for (std::size_t axis = 0; axis < 6; ++axis) {
        sum[axis] *= share;
        square[axis] = std::max(0.0, square[axis] * share - sum[axis] * sum[axis]);
        const double scale = axis < 3 ? 1.0 : static_cast<double>(normal_scale_ * normal_scale_);
        if (square[axis] * scale > largest) {
            largest = square[axis] * scale;
            widest = static_cast<int>(axis);
        }
    }
    return {begin,
            end,
            -1,
            static_cast<float>(area),
            Vec3d{sum[0], sum[1], sum[2]}.as<float>(),
            Vec3d{sum[3], sum[4], sum[5]}.as<float>(),
            static_cast<float>(square[0] + square[1] + square[2]),
            static_cast<float>(square[3] + square[4] + square[5])};
}

std::int32_t VertexClusters::middle(const VertexCluster& cluster, float scale) const {
    std::int32_t best = -1;
    float least = std::numeric_limits<float>::max();
    for (std::int32_t i = cluster.begin; i < cluster.end; ++i) {
        const std::int32_t v = order_[i];
        const Vec3f p = positions_[v] - cluster.centre;
        const Vec3f n = (normals_[v] - cluster.normal) * scale;
        const float squared = dot(p, p) + dot(n, n);
        if (squared < least) {
            least = squared;
            best = v;
        }
    }
    return best;
}

} // namespace isolux
