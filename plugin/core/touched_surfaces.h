// Surfaces in whose planes a point of light lies, such as the walls of its corner: by rounding
// alone, its grazing light would meet them.
#pragma once

#include <vector>

#include "core/ray_caster.h"

namespace isolux {

// Unit normals of the surfaces in which a point of world space lies but for rounding; no two are
// parallel.
std::vector<Vec3f> touched_surfaces(const RayCaster& caster, const Vec3d& point);

} // namespace isolux
