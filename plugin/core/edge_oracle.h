// The oracle of an edge: where its brightness wants another sample, and where a split
// [Volevich 2000, §3.1.1, §4].
#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace isolux {

inline constexpr int kEdgeSamples = 5; // at most, the ends included [§3.1.1]

// What is known of an edge, from its start to its end.
struct EdgeProfile {
    int count = 2;                                // of samples
    std::array<double, kEdgeSamples> fractions{}; // 0 at the start, 1 at the end
    // One row a side: front and back, and the two sides of a crease. The surfaces share their
    // splits, so that what one side wants the others get.
    std::vector<std::array<double, kEdgeSamples>> brightness;

    // Greatest difference between samples i and i + 1.
    double difference(int i) const;
    // Greatest distance of sample i from the straight line between samples a and b.
    double deviation(int i, int a, int b) const;
};

// Gaps between neighbouring samples that want one in their middle: those whose ends differ by more
// than the threshold, the greatest first, as far as there is room. Bit i: after sample i.
std::uint32_t gaps_to_sample(const EdgeProfile& edge, double threshold);

// Samples to split at: as few as make straight lines between them pass within half the threshold
// by all others [Douglas and Peucker 1973]. A step above the threshold is taken between two.
// Bit i: sample i.
std::uint32_t samples_to_split_at(const EdgeProfile& edge, double threshold);

} // namespace isolux
