// Surfaces that lie in the same place: walls of a front and a back sheet, floors twice in a stage.
// A ray meets but one of them, by rounding.
#pragma once

#include "core/illumination_mesh.h"
#include "core/ray_caster.h"

namespace isolux {

// The hit; or, where that is the back of a one-sided surface, the first of those that face the ray
// in the same place, if there is one.
Hit facing_hit(const IlluminationMesh& mesh, const RayCaster& caster, const Ray& ray,
               const Hit& hit);

// The first element that has a side to `normal`, unit, at a point of world space; -1: none.
std::int32_t first_element_at(const IlluminationMesh& mesh, const RayCaster& caster,
                              const Vec3d& point, const Vec3d& normal);

} // namespace isolux
