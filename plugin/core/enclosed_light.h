// Luminaires of which no light gets out of a small closed part of the scene: lamps in opaque bulbs
// and closed fixtures.
#pragma once

#include <cstdint>
#include <vector>

#include "core/scene.h"

namespace isolux {

struct EnclosedLight {
    Vec3d position;    // of the luminaire, m, world space
    Vec3d size;        // m, of the box of all that its light meets
    std::int32_t mesh; // which most of it meets
};

// Light is followed by diffuse reflections, whatever the reflectance: a beam on a black table is
// not enclosed. Nor is the light of a scene in which there is no mesh elsewhere.
std::vector<EnclosedLight> enclosed_lights(const Scene& scene);

} // namespace isolux
