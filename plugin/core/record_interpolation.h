// Illuminance between gather records: the best linear prediction from the records around that see
// each other, for illuminance that varies over the distances that the records' rays measured
// (kriging [Cressie 1993, §3]; the scale of variation is that of irradiance caching [Ward &
// Heckbert 1992]). Where records are noisy it averages, where they are exact it passes through
// them; and it tells the error that it expects of itself.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "core/ray_caster.h"
#include "core/vertex_clusters.h"

namespace isolux {

class RecordInterpolation {
  public:
    // vertices: of each record; scales: m, distance over which light varies around it
    RecordInterpolation(const VertexClusters& clusters, const RayCaster& caster,
                        std::vector<std::int32_t> vertices, std::vector<float> scales);
    ~RecordInterpolation();

    // Whether two vertices face alike and nothing stands between them.
    bool alike(std::int32_t vertex, std::int32_t other) const;

    // The record that a vertex can be predicted from: its own cluster's or another near one that
    // faces alike and that nothing hides from it; -1 where there is none.
    std::int32_t anchor(std::int32_t vertex, std::int32_t own) const;

    // illuminance: lx by channel, a record; noise: lx², photometric variance of it
    // areas: m², that each record stands for
    void fit(std::span<const Vec3f> illuminance, std::span<const double> noise,
             std::span<const float> areas, int threads);

    struct Prediction {
        Vec3f illuminance; // lx by channel
        float variance;    // lx², expected square of its error, photometric
    };
    // At a vertex that is anchored at a record.
    Prediction predict(std::int32_t vertex, std::int32_t record) const;

  private:
    static constexpr std::size_t kNeighbours = 10;
    static constexpr std::size_t kMembers = kNeighbours + 1;

    // A record and those around it: what predicts the vertices near it.
    struct Neighbourhood {
        std::size_t count = 0;                        // members, the record itself first
        std::array<std::int32_t, kMembers> members{}; // records
        double amplitude = 0.0, constant = 0.0;       // lx², variance of light and of its mean
        double noise = 0.0;                           // lx², of each member
        std::array<double, kMembers*(kMembers + 1) / 2> factor{}; // Cholesky, rows
        std::array<Vec3d, kMembers> weights{};                    // lx by channel
    };
    struct Tree;

    void find_neighbours(std::size_t record);
    void solve(Neighbourhood& hood, std::span<const Vec3f> illuminance) const;
    double correlation(std::int32_t vertex, std::int32_t other, float scale) const;

    const VertexClusters& clusters_;
    const RayCaster& caster_;
    std::vector<std::int32_t> vertices_;
    std::vector<float> scales_;
    std::unique_ptr<Tree> tree_;
    std::vector<Neighbourhood> hoods_;
    std::vector<Vec3f> illuminance_;
    double calibration_ = 1.0; // true over expected square error of records that were left out
};

} // namespace isolux
