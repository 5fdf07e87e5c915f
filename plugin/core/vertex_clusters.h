// Clusters of illumination vertices that lie near each other and face alike: a binary tree from all
// vertices down to single ones.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/receiver.h"

namespace isolux {

struct VertexCluster {
    std::int32_t begin, end; // in VertexClusters::order()
    std::int32_t children;   // the first of two, one after the other; -1: a single vertex
    float area;              // m², of the vertices
    Vec3f centre, normal;    // m from the origin given, and of any length: means over the vertices
    float square_radius;     // m², mean square distance from the centre
    float normal_spread;     // mean square distance of the normals from their mean
};

class VertexClusters {
  public:
    // receivers, areas: one a vertex; those of zero normal are in no cluster
    // origin: m, where positions are recentred
    VertexClusters(std::span<const Receiver> receivers, std::span<const double> areas,
                   const Vec3d& origin);

    std::span<const VertexCluster> clusters() const { return clusters_; }  // the first has all
    std::span<const std::int32_t> order() const { return order_; }         // vertices
    std::int32_t rank(std::int32_t vertex) const { return rank_[vertex]; } // its place in order()
    const Vec3f& position(std::int32_t vertex) const { return positions_[vertex]; }
    const Vec3f& normal(std::int32_t vertex) const { return normals_[vertex]; }

    // The vertex that is nearest to a cluster's centre and mean normal, `scale` metres to a unit of
    // normals.
    std::int32_t middle(const VertexCluster& cluster, float scale) const;

  private:
    VertexCluster summarize(std::int32_t begin, std::int32_t end, std::span<const double> areas,
                            int& widest) const;

    std::vector<Vec3f> positions_, normals_; // one a vertex
    std::vector<std::int32_t> order_, rank_;
    std::vector<VertexCluster> clusters_;
    float normal_scale_; // m a unit of normals, where place and orientation compete for a split
};

} // namespace isolux
