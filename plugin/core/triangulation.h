// Triangles of a polygon mesh: fans of convex faces, ear clipping of the others [Meisters 1975].
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "core/vec3.h"

namespace isolux {

// A polygon mesh as its prim authors it; all spans must outlive the calls that take it.
struct PolygonMesh {
    std::span<const Vec3d> points;                     // m, world space
    std::span<const std::int32_t> face_vertex_counts;  // 0 and more
    std::span<const std::int32_t> face_vertex_indices; // corners, valid indices into points
    std::span<const std::int32_t> hole_faces;          // faces that are no surface
    bool flip_winding = false;                         // authored order is clockwise from the front
};

struct Triangulation {
    std::vector<std::array<std::int32_t, 3>> corners; // face corners, counter-clockwise from front
    std::vector<std::int32_t> faces;                  // face of each triangle
};

// Ears take time with the square of the corners, a second at this many: larger faces are fans,
// which is right where they are convex.
constexpr std::int32_t kMostEarCorners = 10'000;

// Faces of fewer than three corners, holes and triangles without area give no triangle.
Triangulation triangulate(const PolygonMesh& mesh);

// One a face: whether it is a hole.
std::vector<bool> hole_flags(const PolygonMesh& mesh);

// Twice the area times the unit normal on the front side [Newell].
Vec3d area_vector(const PolygonMesh& mesh, std::int32_t first_corner, std::int32_t count);

} // namespace isolux
