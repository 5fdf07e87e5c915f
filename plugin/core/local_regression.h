// Illuminance that is smoother than its noise: at each vertex a plane through the values around it
// on its surface, a bowl where they surely lie on one, by weighted least squares [Cleveland &
// Devlin 1988]. A value weighs by its noise and by how far light is from a plane at its distance,
// which the residuals tell: where they are no larger than the noise it averages, where noise is
// small it keeps each value as it is.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/illumination_mesh.h"

namespace isolux {

struct NoisyIlluminance {
    Vec3f illuminance;        // lx by channel
    float ray_variance = 0.0; // lx², photometric, of one of so many rays
    float rays = 0.0F;        // 0: nothing is known here
};

struct SmoothIlluminance {
    Vec3f illuminance;    // lx by channel
    float variance = 0.0; // lx², photometric, expected square of its error
    float taken = 0.0;    // share of what the values around tell in it
};

class LocalRegression {
  public:
    LocalRegression(const IlluminationMesh& mesh, std::span<const Receiver> receivers);

    void fit(std::span<const NoisyIlluminance> values, std::span<SmoothIlluminance> out,
             int threads) const;

    // Vertices that an edge joins to one, on the same smooth surface.
    std::span<const std::int32_t> neighbours(std::int32_t vertex) const {
        return std::span(neighbours_).subspan(begin_[vertex], begin_[vertex + 1] - begin_[vertex]);
    }

  private:
    static constexpr std::size_t kMost = 24; // values around one

    std::size_t around(std::int32_t vertex, std::span<std::int32_t, kMost> found) const;
    // What the values around a vertex tell of it, beside its own.
    struct Prediction {
        Vec3f illuminance;     // lx by channel
        float variance = 0.0F; // lx², photometric
        float noise = 0.0F;    // lx², of its own value
        float excess = 0.0F;   // lx², square difference of both, beyond the noise
    };
    Prediction predict(std::int32_t vertex, std::span<const NoisyIlluminance> values) const;
    SmoothIlluminance blend(std::int32_t vertex, std::span<const NoisyIlluminance> values,
                            std::span<const Prediction> predictions) const;

    std::span<const Receiver> receivers_;
    std::vector<std::int32_t> begin_, neighbours_; // along edges, of each vertex
};

} // namespace isolux
