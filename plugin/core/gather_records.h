// The indirect illuminance at single vertices, by rays over the hemisphere that look up the
// exitance of what they hit: final gather [Ward, Rubinstein & Clear 1988; Jensen 1996].
//
// What a ray hits does not depend on the light, so it is kept: with new exitances a record's
// illuminance costs look-ups, not rays.
//
// A vertex says little of a point that is nearer to the receiver than the next vertex: from there a
// ray bounces on until it has come far enough, and where direct light isn't smooth it is that of
// the points [Jensen 2001, §9.2.2: secondary rays where distances are short]. Of points further off
// direct light alone is traced, where its change around a vertex would show: the edge of a shadow
// on the wall behind a sofa, in a bowl of fruit, inside of a lampshade.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/bright_patches.h"
#include "core/luminaire_illuminance.h"
#include "core/random.h"
#include "core/scene.h"

namespace isolux {

// What a ray meets that hits nearby, until it hits far away, or where direct light changes.
struct NearHit {
    Vec3f direct;     // lm/m² by channel, exitance by light straight from the luminaires
    Vec3f share;      // of the last hit's exitance
    std::int32_t hit; // the last: a vertex, its indirect light, or -1: black
};

struct GatherRecord {
    std::int32_t vertex = 0;
    // A ray: what it looks up, a vertex or, beyond these, the indirect light of a vertex, a bright
    // patch up to the cap; -1: black;
    // -2 - i: near hit i.
    std::vector<std::int32_t> hits;
    std::vector<BrightHit> bright_hits;
    std::vector<NearHit> near_hits;
    std::uint32_t further_rays = 0; // that near hits took
    std::uint32_t close_rays = 0;   // that met something nearer than the next vertex
    // Of the latest exitances:
    Vec3f illuminance;         // lx by channel
    double ray_variance = 0.0; // lx², photometric, of one ray
    double bright_noise = 0.0; // lx², of the light of bright patches
    // Squared differences of the halves of the sequence over 4, and the mean of those of the
    // quarters: from these it shows how fast the error falls.
    double half_square = 0.0, quarter_square = 0.0;

    std::uint32_t rays() const { return static_cast<std::uint32_t>(hits.size()); }
    std::uint64_t all_rays() const { return hits.size() + bright_hits.size() + further_rays; }
};

// What is known of the light for rays to find their way by.
struct VertexLight {
    const BrightPatches& bright;
    std::span<const Vec3f> direct;       // lx by channel, one a vertex
    std::span<const std::uint8_t> rough; // whether it isn't linear from this vertex to the next
    std::span<const std::uint8_t> tight; // whether most of what it sees is nearer than the next
    // lm/m², by which what direct light leaves differs around each; none: not known
    std::span<const float> change;
    float unseen; // lx, below which a change in what a receiver sees doesn't show in one ray
};

class RecordTracer {
  public:
    RecordTracer(const Scene& scene, std::uint64_t seed);

    // Adds rays to a record, the next of its Owen-scrambled Sobol sequence: up to `rays` in all.
    void trace(const Receiver& receiver, std::uint32_t rays, const VertexLight& light,
               GatherRecord& record) const;

  private:
    struct Point;
    Point hit_point(const Ray& ray, PhotonRandom& random) const;
    bool is_near(const Point& point, const VertexLight& light) const;
    bool shows_change(const Point& point, const Ray& ray, const Vec3f& receiver_normal,
                      std::uint32_t rays, const VertexLight& light) const;
    NearHit light_point(const Point& point, PhotonRandom& random, std::uint32_t& rays) const;
    Receiver receiver_at(const Point& point) const;
    NearHit follow(Point point, const VertexLight& light, PhotonRandom& random,
                   std::uint32_t& rays) const;
    Vec3f direct_at(const Point& point, const Receiver& at, const VertexLight& light,
                    PhotonRandom& random, std::uint32_t& rays) const;
    Vec3f direct_illuminance(const Receiver& at, PhotonRandom& random) const;

    const Scene& scene_;
    std::uint64_t seed_;
    std::vector<LuminaireIlluminance> luminaires_;
    float chosen_variance_ = 0.0F; // relative, about, of direct light by one of kCandidates
};

// Exitance by channel, lm/m²: what a record sees.
struct Exitance {
    float x, y, z, unused;
};
struct Exitances {
    std::vector<Exitance> seen; // of each vertex, its indirect light, each bright patch to the cap
    std::vector<Vec3f> above;   // of each bright patch, what is above
};

inline double photometric(const Exitance& e) {
    return luminance(Vec3f{e.x, e.y, e.z}.as<double>());
}

// What the record's rays look up below an index: visit(i, weight), 1 for a ray that sees it itself.
// From 2 V on, the bright patches, light is sure.
template <typename Visit>
void for_each_lookup(const GatherRecord& record, std::size_t end, const Visit& visit) {
    const auto visit_one = [&](std::int32_t i, double weight) {
        if (i >= 0 && static_cast<std::size_t>(i) < end) {
            visit(static_cast<std::size_t>(i), weight);
        }
    };
    for (const std::int32_t i : record.hits) {
        visit_one(i, 1.0);
    }
    for (const NearHit& near : record.near_hits) {
        visit_one(near.hit, luminance(near.share.as<double>()));
    }
}

// Looks up what the record's rays hit.
void look_up(const Exitances& exitances, GatherRecord& record);

} // namespace isolux
