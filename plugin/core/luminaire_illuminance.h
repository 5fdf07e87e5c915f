// Illuminance that a luminaire would give where nothing is in the way, and the points of it that
// shadow rays aim at [Volevich 2000, §3.1.1].
#pragma once

#include "core/luminaire.h"
#include "core/receiver.h"
#include "core/vec3.h"

namespace isolux {

// A point of the luminaire and the illuminance, lx, that the receiver would get if all of the
// luminaire's light came to it as from there: the mean over uniform (u, v) is the unoccluded
// illuminance.
struct ShadowSample {
    Vec3d point; // m, world space
    double illuminance;
};
ShadowSample shadow_sample(const Luminaire& luminaire, const Receiver& receiver, double u,
                           double v);

} // namespace isolux
