// An affine map of space: where something stands.
#pragma once

#include "core/vec3.h"

namespace isolux {

// p goes to x * p.x + y * p.y + z * p.z + at: the rows of a matrix for row vectors, as USD has
// them.
struct Placement {
    Vec3d x{1, 0, 0}, y{0, 1, 0}, z{0, 0, 1}, at;

    Vec3d linear(const Vec3d& p) const { return x * p.x + y * p.y + z * p.z; }
    Vec3d operator()(const Vec3d& p) const { return linear(p) + at; }
};

} // namespace isolux
