// How much light a receiver takes from the members of a hierarchy, each as coarse as the accuracy
// allows.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "core/radiosity_cluster.h"
#include "core/receiver.h"
#include "core/scene.h"
#include "core/source_visibility.h"

namespace isolux {

// What a point receives.
struct PointIlluminance {
    Vec3d illuminance;     // lx by channel
    double variance = 0.0; // lx², photometric, of the rays
    Vec3d unevenness;      // lx: error of giving all of a leaf its mean exitance
};

class RadiosityExchange {
  public:
    // exitance : one a node
    // tolerance : lx, that one interaction may be off
    RadiosityExchange(const Scene& scene, const RadiosityHierarchy& hierarchy,
                      std::span<const NodeExitance> exitance, double tolerance, std::uint64_t seed);

    // key : names the receiver among others of this seed
    PointIlluminance at_point(const Receiver& receiver, std::uint64_t key,
                              std::uint64_t& rays) const;
    // Illuminance of all leaves of an element's side.
    // received : lx by channel, one a node
    void onto(std::int32_t element_side, std::span<Vec3d> received, std::uint64_t& rays) const;

  private:
    const Scene& scene_;
    const RadiosityHierarchy& hierarchy_;
    std::span<const NodeExitance> exitance_;
    double tolerance_;
    std::uint64_t seed_;
};

} // namespace isolux
