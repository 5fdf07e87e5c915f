// A point of a surface that receives light on one side.
#pragma once

#include "core/vec3.h"

namespace isolux {

struct Receiver {
    Vec3d position; // m, world space
    Vec3f normal;   // unit, on the side that receives
};

} // namespace isolux
