// Normals for vertices of faces without area, which have none of their own.
#pragma once

#include <span>

#include "core/vec3.h"

namespace isolux {

// Zero normals become that of the nearest vertex that has one; all stay zero where none has.
void fill_normals(std::span<const Vec3d> positions, std::span<Vec3f> normals);

} // namespace isolux
