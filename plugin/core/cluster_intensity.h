// Luminous intensity of many luminaires together by direction, and how much they differ: what one
// of them, chosen by it, tells of all [Conty Estevez & Kulla 2018].
#pragma once

#include <vector>

#include "core/luminaire_illuminance.h"

namespace isolux {

// Of all together towards a direction, cd; the variances are relative to the mean squared, of the
// intensity of one chosen by its weight in the bin, over its probability. The weight is the mean
// intensity and, so that none is left out, a part of that of an even luminaire of the same flux.
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

    explicit ClusterIntensity(const LuminaireIlluminance& luminaire);
    // Sum of two.
    ClusterIntensity(const ClusterIntensity& a, const ClusterIntensity& b);

    static int bin(const Vec3d& direction); // world space, any length, 0 as well
    const DirectionalIntensity& at(int bin) const { return bins_[bin]; }
    // Leaves the fine directions, which only sums need.
    void settle();

  private:
    struct Fine {
        float intensity, squares, most; // cd; sum of cd² over weights; most cd over its weight
    };
    std::vector<Fine> fine_;
    std::vector<float> weights_; // cd, of the bins
    std::vector<DirectionalIntensity> bins_;
};

} // namespace isolux
