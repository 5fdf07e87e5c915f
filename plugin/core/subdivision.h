// Subdivision surfaces: the refined faces of a control cage, its limit points and normals, and how
// values given on the cage spread over them [Catmull and Clark 1978; Loop 1987; OpenSubdiv, Far].
//
// Refinement is uniform. Refined points are moved to the limit surface, where those of every level
// lie: a finer level only adds points between.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "core/cage_stencil.h"
#include "core/vec3.h"

namespace isolux {

enum class SubdivisionScheme { bilinear, catmull_clark, loop };
enum class BoundaryRule { none, edge_only, edge_and_corner };
enum class FaceVaryingRule { none, corners_only, corners_plus1, corners_plus2, boundaries, all };

struct SubdivisionRules {
    SubdivisionScheme scheme = SubdivisionScheme::catmull_clark;
    BoundaryRule boundary = BoundaryRule::edge_and_corner;
    FaceVaryingRule face_varying = FaceVaryingRule::corners_plus1;
    bool smooth_triangles = false; // weights of catmull_clark for triangles
};

// The control cage; the spans need only last through the constructor that takes it.
struct ControlCage {
    std::int32_t point_count = 0;
    std::span<const std::int32_t> face_vertex_counts;         // 3 and more
    std::span<const std::int32_t> face_vertex_indices;        // corners, valid point indices
    std::span<const std::int32_t> hole_faces;                 // valid face indices
    std::span<const std::array<std::int32_t, 2>> sharp_edges; // point indices
    std::span<const float> edge_sharpness;                    // one a sharp edge; 10: infinite
    std::span<const std::int32_t> sharp_points;               // point indices
    std::span<const float> point_sharpness;                   // one a sharp point
    std::span<const std::int32_t> face_varying_indices;       // one a corner; empty: none
};

class SubdividedSurface {
  public:
    // Refines so many levels; 0: the cage's own faces. Throws std::invalid_argument with
    // OpenSubdiv's reason where it can't.
    SubdividedSurface(const ControlCage& cage, const SubdivisionRules& rules, std::int32_t level);
    ~SubdividedSurface();
    SubdividedSurface(SubdividedSurface&&) noexcept;
    SubdividedSurface& operator=(SubdividedSurface&&) noexcept;

    // The refined faces, corners in the winding of the cage.
    std::int32_t point_count() const;
    std::vector<std::int32_t> face_vertex_counts() const;
    std::vector<std::int32_t> face_vertex_indices() const;
    std::vector<std::int32_t> cage_faces() const; // one a refined face: of which it is a part
    // Refined faces that are no surface: of holes, and at boundaries without interpolation.
    std::vector<std::int32_t> hole_faces() const;
    // One a corner of the cage: the refined corner at the same point of the same face.
    std::vector<std::int32_t> corners_of_cage() const;
    // One a refined corner: its row of face_varying_stencils().
    std::vector<std::int32_t> face_varying_indices() const;

    std::vector<Vec3d> limit_points(std::span<const Vec3d> cage_points) const;
    // Unit normals of the limit surface at the refined corners, by the winding; those of the sides
    // of a sharp edge or corner are kept apart. Zero where there is none.
    std::vector<Vec3f> limit_normals(std::span<const Vec3d> cage_points) const;
    // Greatest distance, m, from the points that the last level added to the flat faces before it,
    // whose corners are on the limit surface. Wants a level of 1 or more.
    double chord_error(std::span<const Vec3d> cage_points) const;

    // Each refined point's value on the limit surface from the cage's, by the rules of its points.
    SparseRows limit_stencils() const;
    // The same, linear over the cage's faces.
    SparseRows varying_stencils() const;
    // Face-varying values on the limit surface from those of the cage.
    SparseRows face_varying_stencils() const;

  private:
    struct Refinement;
    std::unique_ptr<Refinement> refinement_;
};

} // namespace isolux
