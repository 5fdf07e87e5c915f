// A point of a surface that receives light on one side.
#pragma once

#include <cstdint>

#include "core/vec3.h"

namespace isolux {

struct Receiver {
    Vec3d position;         // m, world space
    Vec3f normal;           // unit, on the side that receives
    std::int32_t mesh = -1; // of the surface, for light links; -1: none in particular
};

} // namespace isolux
