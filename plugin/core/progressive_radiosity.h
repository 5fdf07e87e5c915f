// Hierarchical progressive radiosity, HPR: exitance is shot through a hierarchy of clusters, a
// reflection at a time, without stored links [Volevich 2000, §3.1.2; Sillion & Puech 1994].
//
// Each sweep shoots what no sweep has shot yet. A receiver takes light from a source once both are
// small enough for the accuracy wanted: form factors are exact for triangles in full view, and what
// is in the way is sampled by rays.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/radiosity_exchange.h"
#include "core/receiver.h"
#include "core/scene.h"

namespace isolux {

struct RadiositySettings {
    std::uint64_t seed = 0;
    // Error of the indirect illuminance at a point, of its mean over the scene, that is aimed at.
    double accuracy = 0.01;
};

struct ShootingProgress {
    double unshot = 1.0; // share of all reflected flux
    // lm: how much was shot so far, how much of it left the scene or fell on the backs of one-sided
    // meshes, and how much was received before that was made to fit the two.
    double shot_flux = 0.0, lost_flux = 0.0, received_flux = 0.0;
    std::uint64_t rays = 0;
    bool finished = false; // what is unshot is below a tenth of the accuracy
};

// One entry a receiver.
struct IndirectIllumination {
    std::vector<Vec3f> illuminance;    // lx by channel
    std::vector<float> standard_error; // lx, photometric: visibility, leaves' size, truncation
    std::uint64_t rays = 0;
};

class ProgressiveRadiosity {
  public:
    ProgressiveRadiosity(const Scene& scene, const RadiositySettings& settings);

    // Where each leaf wants direct light.
    std::vector<Receiver> receivers() const;
    // direct : lx by channel, one a leaf. Forgets what was shot.
    void begin(std::span<const Vec3f> direct);
    // Shoots whole sweeps until about so many rays are spent, one at least.
    ShootingProgress advance(std::uint64_t ray_budget, int threads);
    // lm/m² by channel, of each leaf: what it reflects so far.
    std::vector<Vec3f> exitance() const;
    // Indirect light at points, by what the leaves reflect so far. A receiver's outcome depends on
    // its position and normal alone.
    IndirectIllumination indirect(std::span<const Receiver> receivers, int threads) const;

  private:
    void find_losses(int threads);
    void pull(std::vector<NodeExitance>& exitance) const;
    double flux(const std::vector<NodeExitance>& exitance) const;

    const Scene& scene_;
    RadiositySettings settings_;
    RadiosityHierarchy hierarchy_;
    std::vector<NodeExitance> unshot_, total_; // one a node
    std::vector<Vec3d> received_;              // lx, one a node, of the current sweep
    std::vector<double> lost_; // one a leaf: share of what it shoots that nothing receives
    ShootingProgress progress_;
    std::uint64_t sweep_ = 0;
    double decay_ = 1.0; // of the unshot flux in the last sweep
    double scale_ = 0.0; // lx, photometric: mean indirect illuminance to be expected
};

} // namespace isolux
