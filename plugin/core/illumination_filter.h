// Filtered illuminance at vertices: each vertex draws on as many buckets around it as its noise
// needs and its neighbourhood's gradients allow [Volevich 2000, Appendix A].
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "core/buried_receivers.h"
#include "core/illumination_mesh.h"
#include "core/photon_buckets.h"
#include "core/poisson_interval.h"
#include "core/vertex_kdtree.h"

namespace isolux {

struct FilterSettings {
    double accuracy = 0.05; // relative deviation at which a support stops growing [§A.2: e.g. 5 %]
    double sharing = 0.25;  // d_f: fraction of the radius within which a value is shared [§6: 25 %]
    IntervalRule rule = IntervalRule::corrected;
};

// One entry a vertex.
struct FilteredIllumination {
    // The estimate from the photons of one half over the support that the other half chose.
    // Departure: where the same photons choose a support and are counted in it, stopping at enough
    // photons prefers places with a surplus: the mean of a closed sphere came out 0.7 % high
    // (tests/physics/test_filter_bias.py).
    struct Half {
        float illuminance;   // lx, photometric
        double support_area; // m²
    };
    using Halves = std::array<Half, 2>;
    std::vector<Halves> halves;
    std::vector<Vec3f> illuminance;    // lx by channel; luminance: the mean of the halves
    std::vector<float> standard_error; // lx, photometric, bias included: see filter_error
    std::vector<float> offset;         // lx, of it, by the mean over a bucket for a vertex
    std::vector<float> support_radius; // m; 0 where the own bucket suffices
};

class IlluminationFilter {
  public:
    IlluminationFilter(const IlluminationMesh& mesh, const BuriedReceivers& buried);

    // Of direct and of indirect light. photon_flux: lm a photon.
    std::array<FilteredIllumination, 2> filter(const PhotonBuckets& buckets, double photon_flux,
                                               const FilterSettings& settings, int threads) const;

  private:
    const IlluminationMesh& mesh_;
    VertexKdTree tree_;
    std::vector<double> reflectance_;  // of luminance, by rank in the tree
    std::vector<bool> border_;         // by vertex
    std::vector<std::int32_t> blocks_; // cells that hold all vertices, a thread's work each
    // Vertices within other bodies, whose buckets are dark, and those whose light they show.
    std::vector<std::array<std::int32_t, 2>> buried_;
};

} // namespace isolux
