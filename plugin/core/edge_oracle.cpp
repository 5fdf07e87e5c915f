#include "core/edge_oracle.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace isolux {
namespace {

void split_between(const EdgeProfile& edge, int a, int b, double tolerance, std::uint32_t& splits) {
    int farthest = -1;
    double most = tolerance;
    for (int i = a + 1; i < b; ++i) {
        const double deviation = edge.deviation(i, a, b);
        if (deviation > most) {
            most = deviation;
            farthest = i;
        }
    }
    if (farthest >= 0) {
        splits |= 1U << farthest;
        split_between(edge, a, farthest, tolerance, splits);
        split_between(edge, farthest, b, tolerance, splits);
    }
}

} // namespace

double EdgeProfile::difference(int i) const {
    double most = 0.0;
    for (const auto& side : brightness) {
        most = std::max(most, std::abs(side[i + 1] - side[i]));
    }
    return most;
}

double EdgeProfile::deviation(int i, int a, int b) const {
    const double t = (fractions[i] - fractions[a]) / (fractions[b] - fractions[a]);
    double most = 0.0;
    for (const auto& side : brightness) {
        most = std::max(most, std::abs(side[i] - (side[a] * (1.0 - t) + side[b] * t)));
    }
    return most;
}

std::uint32_t gaps_to_sample(const EdgeProfile& edge, double threshold) {
    std::uint32_t gaps = 0;
    for (int room = kEdgeSamples - edge.count; room > 0; --room) {
        int steepest = -1;
        double most = threshold;
        for (int i = 0; i + 1 < edge.count; ++i) {
            if ((gaps >> i & 1U) == 0 && edge.difference(i) > most) {
                most = edge.difference(i);
                steepest = i;
            }
        }
        if (steepest < 0) {
            break;
        }
        gaps |= 1U << steepest;
    }
    return gaps;
}

// Departure: the paper splits where neighbours differ. Linear interpolation shows a smooth gradient
// as it is, however steep, so that the difference asks for samples and the bend for splits.
std::uint32_t samples_to_split_at(const EdgeProfile& edge, double threshold) {
    std::uint32_t splits = 0;
    split_between(edge, 0, edge.count - 1, 0.5 * threshold, splits);
    return splits;
}

} // namespace isolux
