// Uniform numbers as a function of (seed, photon index, dimension), without generator state, so
// that a photon is the same whoever traces it: SplitMix64 [Steele, Lea & Flood 2014], one stream a
// photon, its start a hash of seed and index.
#pragma once

#include <cstdint>

namespace isolux {

constexpr std::uint64_t mix64(std::uint64_t z) {
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    return z ^ (z >> 31);
}

class PhotonRandom {
  public:
    constexpr PhotonRandom(std::uint64_t seed, std::uint64_t photon)
        : state_(mix64(mix64(seed + kGolden) ^ (photon * kGolden))) {}

    // The next 64 bits of the photon's stream: dimensions are taken in order.
    constexpr std::uint64_t next() { return mix64(state_ += kGolden); }

    // In [0, 1), 53 bits.
    constexpr double next_double() { return static_cast<double>(next() >> 11) * 0x1p-53; }

  private:
    static constexpr std::uint64_t kGolden = 0x9e3779b97f4a7c15ULL;
    std::uint64_t state_;
};

// Two numbers in [0, 1), 24 bits each, from one word.
constexpr float low_float(std::uint64_t bits) {
    return static_cast<float>(bits & 0xffffffU) * 0x1p-24F;
}
constexpr float high_float(std::uint64_t bits) { return static_cast<float>(bits >> 40) * 0x1p-24F; }

} // namespace isolux
