// Density estimation photon tracing, DEPT [Volevich 2000, §3.1.3]: photons of equal luminous flux
// from all luminaires, bounced diffusely until Russian roulette absorbs them, and bucketed at the
// nearest vertex of each element that they hit.
#pragma once

#include <cstdint>

#include "core/photon_buckets.h"
#include "core/scene.h"

namespace isolux {

// Half-open range of photon indices. A photon depends on the seed and its index alone.
struct PhotonRange {
    std::uint64_t first = 0, count = 0;
};

// Of a scene that has light.
void trace_photons(const Scene& scene, std::uint64_t seed, PhotonRange range, int threads,
                   PhotonBuckets& buckets);

} // namespace isolux
