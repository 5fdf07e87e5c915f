// A polygon mesh as its prim authors it: checked, and brought to world space.
//
// Each function passes once over its arrays, in parts side by side where they are long.
#pragma once

#include <cstdint>
#include <span>

#include "core/placement.h"
#include "core/vec3.h"

namespace isolux {

struct TopologySurvey {
    std::int64_t corners = 0; // sum of the counts
    std::int32_t least_count = 0, greatest_count = 0;
    std::int32_t least_index = 0, greatest_index = 0;
    std::int64_t degenerate_faces = 0; // under three corners, or a point used twice
};

// Faces are looked at where the counts add up to the indices; else there is no telling them apart.
TopologySurvey survey_topology(std::span<const std::int32_t> counts,
                               std::span<const std::int32_t> indices, int threads);

// m. Fourth powers of distances, such as areas squared, must be numbers in single precision.
constexpr double kFarthestPoint = 1e9;

// out[i] = points[i] placed; returns whether all are numbers and none is too far.
bool place_points(std::span<const Vec3f> points, const Placement& placement, std::span<Vec3d> out,
                  int threads);

// out[i] = normals[of[i]] (`of` empty: normals[i]) turned and of unit length; returns whether all
// of them were finite and other than zero.
bool place_normals(std::span<const Vec3f> normals, std::span<const std::int32_t> of,
                   const Placement& placement, std::span<Vec3f> out, int threads);

} // namespace isolux
