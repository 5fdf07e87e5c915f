// Points of the unit square that fill it evenly: Sobol's (0, 2)-sequence in base 2, scrambled after
// Owen by hashing [Burley 2020]. Each scramble gives an independent unbiased estimate; any 2^k
// first points are stratified in all ways that a (0, 2)-sequence is.
#pragma once

#include <cstdint>

namespace isolux {

struct SobolPoint {
    double u, v; // in [0, 1)
};

namespace sobol {

constexpr std::uint32_t reverse_bits(std::uint32_t x) {
    x = (x << 16) | (x >> 16);
    x = ((x & 0x00ff00ffU) << 8) | ((x & 0xff00ff00U) >> 8);
    x = ((x & 0x0f0f0f0fU) << 4) | ((x & 0xf0f0f0f0U) >> 4);
    x = ((x & 0x33333333U) << 2) | ((x & 0xccccccccU) >> 2);
    return ((x & 0x55555555U) << 1) | ((x & 0xaaaaaaaaU) >> 1);
}

// A nested uniform permutation of [0, 1) as 32-bit fractions.
constexpr std::uint32_t owen_scramble(std::uint32_t x, std::uint32_t seed) {
    x = reverse_bits(x);
    x ^= x * 0x3d20adeaU;
    x += seed;
    x *= (seed >> 16) | 1U;
    x ^= x * 0x05526c56U;
    x ^= x * 0x53a22864U;
    return reverse_bits(x);
}

constexpr std::uint32_t second_dimension(std::uint32_t index) {
    std::uint32_t out = 0;
    for (std::uint32_t column = 1U << 31; index != 0; index >>= 1, column ^= column >> 1) {
        out ^= (index & 1U) != 0 ? column : 0U;
    }
    return out;
}

} // namespace sobol

// Point `index` of the sequence that `scramble`, any 64 bits, stands for.
constexpr SobolPoint sobol_point(std::uint32_t index, std::uint64_t scramble) {
    const auto low = static_cast<std::uint32_t>(scramble);
    const auto high = static_cast<std::uint32_t>(scramble >> 32);
    return {sobol::owen_scramble(sobol::reverse_bits(index), low) * 0x1p-32,
            sobol::owen_scramble(sobol::second_dimension(index), high) * 0x1p-32};
}

} // namespace isolux
