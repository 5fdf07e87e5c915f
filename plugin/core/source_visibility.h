// How much of a source's light comes through to a receiver: visibility by rays between points of
// both [Hanrahan, Salzman & Aupperle 1991], each weighted as its point illuminates.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/radiosity_cluster.h"
#include "core/scene.h"

namespace isolux {

// What the leaves of a node emit.
struct NodeExitance {
    Vec3d mean;                   // lm/m² by channel
    double low = 0.0, high = 0.0; // lm/m², photometric
};

// Where light is received: at a point, or all over a triangle about it.
struct RayOrigins {
    Vec3d centre, normal;
    const RadiosityNode* node = nullptr;
};

// What rays to a source found.
struct SourceLight {
    // Of a triangle its exitance, 0 where something is in the way, weighted as it illuminates; of a
    // cluster the illuminance that it gives.
    Vec3d light;
    double variance = 0.0; // of its luminance
    bool mixed = false;    // something is in the way of a part
};

class SourceVisibility {
  public:
    // exitance : one a node
    // tolerance : lx; less than a quarter of it is not worth more than the first few rays
    SourceVisibility(const RayCaster& caster, const std::vector<RadiosityNode>& nodes,
                     std::span<const NodeExitance> exitance, double tolerance, std::uint64_t seed)
        : caster_(caster), nodes_(nodes), exitance_(exitance), tolerance_(tolerance), seed_(seed) {}

    // key : names the receiver among others of this seed
    // brings : lx, that the source s may give in full view
    SourceLight look(const RayOrigins& origins, std::uint64_t key, std::int32_t s, double brings);

    std::uint64_t rays() const { return rays_; }

  private:
    struct SourcePoint {
        Vec3d position;
        std::int32_t leaf;
    };
    SourcePoint cluster_point(std::int32_t s, double u, double v) const;
    SourcePoint triangle_point(std::int32_t s, const Vec3d& position) const;
    double sees(const Vec3d& from, const Vec3d& from_normal, const Vec3d& to,
                const Vec3d& to_normal);

    const RayCaster& caster_;
    const std::vector<RadiosityNode>& nodes_;
    std::span<const NodeExitance> exitance_;
    double tolerance_;
    std::uint64_t seed_;
    std::uint64_t rays_ = 0;
};

} // namespace isolux
