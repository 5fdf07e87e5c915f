// Luminous intensity of many luminaires together by direction, and how much they differ: what one
// of them, chosen by flux, tells of all [Conty Estevez & Kulla 2018].
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "core/luminaire_illuminance.h"

namespace isolux {

// Of all together towards a direction, cd; the variances are relative to the mean squared, of the
// intensity of one chosen by flux, times all flux over its own.
struct DirectionalIntensity {
    float mean = 0.0F, most = 0.0F; // most: of the whole by one of them
    float between = 0.0F;           // variance, of the luminaires
    float across = 0.0F;            // variance, over the directions of a bin
};

class ClusterIntensity {
  public:
    // Bins of equal sides on the octahedron, of so many directions.
    static constexpr int kSide = 8;
    static constexpr double kBinAngle = 0.22; // rad, half a bin: sqrt(4 pi / 64) / 2

    ClusterIntensity() = default;
    explicit ClusterIntensity(const LuminaireIlluminance& luminaire);
    // Sum of two.
    ClusterIntensity(const ClusterIntensity& a, const ClusterIntensity& b);

    bool empty() const { return bins_.empty(); }
    const DirectionalIntensity& at(const Vec3d& direction) const; // world space, any length
    // Leaves the fine directions, which only sums need.
    void settle();

  private:
    struct Fine {
        float intensity, squares, most; // cd, sum of cd²/lm, most cd/lm
    };
    double flux_ = 0.0; // lm
    std::vector<Fine> fine_;
    std::vector<DirectionalIntensity> bins_;
};

} // namespace isolux
