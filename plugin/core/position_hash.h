// Positions as keys of hash tables: equal where they are equal to the bit, both zeros one.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>

#include "core/vec3.h"

namespace isolux {

struct PositionHash {
    std::size_t operator()(const Vec3d& p) const {
        std::size_t hash = 0;
        for (const double x : {p.x, p.y, p.z}) {
            // + 0.0: both zeros are one
            hash = (hash ^ std::bit_cast<std::uint64_t>(x + 0.0)) * 0x9e3779b97f4a7c15ULL;
            hash ^= hash >> 32;
        }
        return hash;
    }
};

} // namespace isolux
