// Illuminance of a dome or of a wide cone of distant light where surfaces hide parts of it: the
// part of the exact unoccluded illuminance that shadow rays find unhindered. A dome's directions
// are by cosine and by luminance [multiple importance sampling, Veach & Guibas 1995].
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "core/luminaire.h"
#include "core/ray_caster.h"
#include "core/receiver.h"

namespace isolux {

class SkyLighting {
  public:
    SkyLighting(const Luminaire& luminaire, const RayCaster& caster);

    // So much of the sky that a few shadow rays don't tell what is hidden.
    static bool is_wide(const Luminaire& luminaire);

    struct Found {
        Vec3d illuminance;     // lx by channel
        double variance = 0.0; // lx², photometric: what sampling left open
        std::uint64_t shadow_rays = 0;
    };
    // allowed : lx, standard error at which shadow rays stop, as a function of the illuminance
    //     found, lx
    // key : any 64 bits, of the receiver
    Found illuminate(const Receiver& receiver, std::uint64_t key,
                     const std::function<double(double)>& allowed);

  private:
    // A direction, the light that it stands for and whether it arrives.
    struct Sample {
        Vec3f light; // lx by channel, up to the number of samples
        float seen;  // share
    };

    void add_samples(const Receiver& receiver, std::uint64_t scramble, std::uint32_t count);
    Found estimate(const Vec3d& unoccluded);

    struct Direction {
        Vec3d to_light; // world space, unit
        Vec3f light;    // lx by channel, up to a factor
    };
    Direction distant_direction(const Vec3d& normal, double u, double v) const;
    Direction dome_direction(const Vec3d& normal, double u, double v) const;

    const Luminaire& luminaire_;
    const DistantLuminaire* distant_; // or
    const DomeLuminaire* dome_;
    const RayCaster& caster_;
    // Kept from one receiver to the next:
    std::vector<Sample> samples_;
    std::vector<std::uint32_t> cells_;
    std::uint32_t columns_ = 1;      // of cells
    std::vector<double> deviations_; // lx, by cell
    std::vector<Ray> rays_;
    std::vector<std::uint32_t> of_ray_;
    std::vector<float> transmitted_;
};

} // namespace isolux
