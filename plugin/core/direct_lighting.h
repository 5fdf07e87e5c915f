// Deterministic direct lighting, DDL: illuminance straight from the luminaires at points, emission
// times visibility [Volevich 2000, §3.1.1]. Visibility is the share of a luminaire's light that
// shadow rays find unhindered; they go where the error of the total is.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/scene.h"
#include "core/shadow_testing.h"

namespace isolux {

struct DirectLightingSettings {
    std::uint64_t seed = 0;
    // Standard error of direct light, relative to the total illuminance, at which shadow rays
    // stop: 1 %. Very dark and very bright places count like less dark and less bright ones.
    double accuracy = 0.01;
};

// One entry a receiver.
struct DirectIllumination {
    std::vector<Vec3f> illuminance;    // lx by channel
    std::vector<float> standard_error; // lx, photometric: what sampling left open
    std::uint64_t shadow_rays = 0;
};

class DirectLighting {
  public:
    DirectLighting(const Scene& scene, const DirectLightingSettings& settings);

    void aim_at(double accuracy) { sources_.accuracy = accuracy; }

    // indirect : lx, photometric, one a receiver or none: light from elsewhere, beside which small
    //     errors of direct light don't show
    // A receiver's light depends on its position, normal, mesh and indirect light alone, the error
    // told also on what shadow rays met at the others.
    DirectIllumination illuminate(std::span<const Receiver> receivers,
                                  std::span<const float> indirect, int threads) const;

  private:
    DirectSources sources_;
};

} // namespace isolux
