// The indirect illuminance at single vertices, by rays over the hemisphere that look up the
// exitance of what they hit: final gather [Ward, Rubinstein & Clear 1988; Jensen 1996].
//
// What a ray hits does not depend on the light, so it is kept: with new exitances a record's
// illuminance costs look-ups, not rays.
//
// A bucket's mean says little of a point that is nearer than the bucket is wide: there a ray
// bounces once more, and the light straight from the luminaires is that of the point [Jensen 2001,
// §9.2.2: secondary rays where distances are short].
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/luminaire_illuminance.h"
#include "core/random.h"
#include "core/scene.h"

namespace isolux {

// What a ray meets that hits nearby.
struct NearHit {
    Vec3f direct;      // lm/m² by channel, exitance by light straight from the luminaires
    Vec3f reflectance; // of the point that was hit
    std::int32_t hit;  // of the ray that goes on from there, as in GatherRecord
};

struct GatherRecord {
    std::int32_t vertex = 0;
    // A ray: the vertex whose bucket it hits; -1: black; -2 - i: near hit i.
    std::vector<std::int32_t> hits;
    std::vector<NearHit> near_hits;
    double inverse_distances = 0.0; // 1/m, summed over the rays
    // Of the latest exitances:
    Vec3f illuminance;         // lx by channel
    double ray_variance = 0.0; // lx², photometric, of one ray
    // Squared differences of the halves of the sequence over 4, and the mean of those of the
    // quarters: from these it shows how fast the error falls.
    double half_square = 0.0, quarter_square = 0.0;

    std::uint32_t rays() const { return static_cast<std::uint32_t>(hits.size()); }
    // With those that near hits cost: one to go on, one to a luminaire.
    std::uint64_t all_rays() const { return hits.size() + 2 * near_hits.size(); }
};

class RecordTracer {
  public:
    RecordTracer(const Scene& scene, std::uint64_t seed);

    // Adds rays to a record, the next of its Owen-scrambled Sobol sequence: up to `rays` in all.
    void trace(const Receiver& receiver, std::uint32_t rays, GatherRecord& record) const;

  private:
    NearHit near_hit(const Receiver& at, const Vec3f& reflectance, PhotonRandom& random) const;
    Vec3f direct_illuminance(const Receiver& at, PhotonRandom& random) const;

    const Scene& scene_;
    std::uint64_t seed_;
    std::vector<LuminaireIlluminance> luminaires_;
};

// Exitance by channel, lm/m², one a vertex: what a record sees.
struct Exitance {
    float x, y, z, unused;
};

// Looks up what the record's rays hit.
void look_up(std::span<const Exitance> exitances, GatherRecord& record);

} // namespace isolux
