// Form factor from a point to a triangle in full view, in closed form [Lambert 1760]: the share of
// the point's illuminance that a triangle of exitance 1 gives it, near or far, whatever its shape.
#pragma once

#include <array>

#include "core/vec3.h"

namespace isolux {

using Triangle = std::array<Vec3d, 3>; // m, counter-clockwise seen from its front

// The part below the point's horizon gives nothing, nor does a triangle seen from its back.
// position : m. normal : unit, on the side that receives.
double form_factor(const Vec3d& position, const Vec3d& normal, const Triangle& triangle);

} // namespace isolux
