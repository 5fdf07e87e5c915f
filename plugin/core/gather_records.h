// The indirect illuminance at single vertices, by rays over the hemisphere that look up the
// exitance of what they hit: final gather [Ward, Rubinstein & Clear 1988; Jensen 1996].
//
// What a ray hits does not depend on the light, so it is kept: with new exitances a record's
// illuminance costs look-ups, not rays.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/scene.h"

namespace isolux {

struct GatherRecord {
    std::int32_t vertex = 0;
    std::vector<std::int32_t> hits; // a ray: the vertex whose bucket it hits; -1: black
    double inverse_distances = 0.0; // 1/m, summed over the rays
    // Of the latest exitances:
    Vec3f illuminance;         // lx by channel
    double ray_variance = 0.0; // lx², photometric, of one ray
    // Squared differences of the halves of the sequence over 4, and the mean of those of the
    // quarters: from these it shows how fast the error falls.
    double half_square = 0.0, quarter_square = 0.0;

    std::uint32_t rays() const { return static_cast<std::uint32_t>(hits.size()); }
};

// Adds rays to a record, the next of its Owen-scrambled Sobol sequence: up to `rays` in all.
void trace_rays(const Scene& scene, const Receiver& receiver, std::uint64_t seed,
                std::uint32_t rays, GatherRecord& record);

// Exitance by channel, lm/m², one a vertex: what a record sees.
struct Exitance {
    float x, y, z, unused;
};

// Looks up what the record's rays hit.
void look_up(std::span<const Exitance> exitances, GatherRecord& record);

} // namespace isolux
