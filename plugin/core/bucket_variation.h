// What sets the mean over a bucket apart from the light in it, were that linear on each element
// between vertices of these means.
#pragma once

#include <span>
#include <vector>

#include "core/illumination_mesh.h"

namespace isolux {

// lx, one a vertex: what the mean over its bucket exceeds the illuminance at it by; linear in the
// means, lx.
std::vector<double> bucket_offset(const IlluminationMesh& mesh, std::span<const double> means);

// lx², one a vertex: what the square of such offsets is expected to be with all that bends between
// the vertices.
std::vector<double> offset_square(const IlluminationMesh& mesh, std::span<const double> offsets);

// lx, of colours in lx by channel.
std::vector<double> photometric(std::span<const Vec3f> illuminance);

} // namespace isolux
