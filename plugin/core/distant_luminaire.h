// Light from infinitely far, of constant luminance within a cone of directions: the sun. Its
// illuminance is exact, cut at the receiver's horizon.
#pragma once

#include <memory>

#include "core/random.h"
#include "core/scene_entry.h"
#include "core/vec3.h"

namespace isolux {

struct DistantLuminaire { // comes from directions within half_angle of local +Z
    double half_angle;    // rad, up to pi; 0: parallel light
    double flux_density;  // lm/m², each direction's through the plane across it: ∫ L dω
    std::shared_ptr<const SceneEntry> entry; // set by the scene that it shines on

    // lx; axis: to the light, unit.
    double illuminance(const Vec3d& axis, const Vec3d& normal) const;
    // To the light, uniform over the solid angle, from u, v in [0, 1).
    Vec3d direction(const Vec3d& axis, double u, double v) const;
    // To the light, with a density proportional to the cosine to the normal.
    Vec3d cosine_direction(const Vec3d& axis, const Vec3d& normal, PhotonRandom& random) const;
};

} // namespace isolux
