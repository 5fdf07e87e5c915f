// Indirect illuminance by a final gather over cached exitances: at as few vertices as the error
// allows, interpolated to all others, and joined with what photons left there.
//
// Departure: the paper lets indirect photons go on to the end (IDEPT) and filters them
// [Volevich 2000, §3.3]. tools/gather_study.py measures the gain.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/gather_records.h"
#include "core/record_interpolation.h"
#include "core/vertex_clusters.h"

namespace isolux {

struct GatheredIllumination {
    std::vector<Vec3f> indirect;       // lx by channel, one a vertex, at its receiver
    std::vector<float> standard_error; // lx, photometric: noise and interpolation
    double indirect_rms = 0.0;         // lx, error over all vertices by area
    std::size_t records = 0;
    std::uint64_t rays = 0; // of this call
};

// Indirect light that photons left in the vertices' buckets.
struct BucketIllumination {
    std::span<const Vec3f> indirect; // lx by channel, one a vertex, unfiltered; none: no photons
    double photon_flux = 0.0;        // lm a photon
};

class SparseGather {
  public:
    SparseGather(const Scene& scene, std::uint64_t seed);

    // Spends ray_budget more rays where they help most, and looks up the light anew in all.
    // illuminance: lx by channel, one a vertex: all light that falls on it, as known so far
    GatheredIllumination advance(std::span<const Vec3f> illuminance,
                                 const BucketIllumination& buckets, std::uint64_t ray_budget,
                                 int threads);

    std::size_t vertex_count() const { return receivers_.size(); }

  private:
    // A cluster and the record that stands for it. The cells part all vertices.
    struct Cell {
        std::int32_t cluster, record;
        float roughness; // lx², square difference of light over one scale of the record
        float priority;  // lx² m², error that as many rays as a record has would halve
    };
    // How a vertex is predicted.
    struct Anchor {
        std::int32_t owner = -1, record = -1; // of the vertex's cell; the one that it is seen from
    };

    std::vector<Exitance> exitances(std::span<const Vec3f> illuminance) const;
    std::int32_t record_at(std::int32_t vertex, std::vector<std::int32_t>& fresh);
    void trace(std::span<const std::int32_t> records, std::uint32_t factor,
               std::span<const Exitance> exitances, int threads);
    void estimate_noise();
    double noise(const GatherRecord& record) const; // lx², variance
    // The same where the record may have missed what gives most light.
    double possible_noise(const GatherRecord& record) const;
    float scale(const GatherRecord& record) const; // m, over which light varies around it
    float first_roughness(std::span<const Exitance> exitances) const;
    float roughness(const GatherRecord& a, const GatherRecord& b, float before) const;
    void rate(Cell& cell) const;
    void refine(std::uint64_t end, std::span<const Exitance> exitances, int threads);
    std::vector<Anchor> anchors(const RecordInterpolation& interpolation, int threads) const;
    void add_hidden(std::span<const Anchor> anchors, const RecordInterpolation& interpolation,
                    std::uint64_t end, std::span<const Exitance> exitances, int threads);
    RecordInterpolation interpolation() const;
    void fit(RecordInterpolation& interpolation, int threads) const;
    double join(const BucketIllumination& buckets, GatheredIllumination& gathered) const;

    const Scene& scene_;
    RecordTracer tracer_;
    std::vector<Receiver> receivers_;
    VertexClusters clusters_;
    float extent_; // m
    std::vector<GatherRecord> records_;
    std::vector<std::int32_t> record_of_; // a vertex; -1: none
    std::vector<Cell> cells_;
    double noise_share_ = 1.0; // of the variance of independent rays, that a Sobol sequence leaves
    double pooled_variance_ = 0.0; // lx², photometric, of one ray
    std::uint64_t rays_ = 0;
};

} // namespace isolux
