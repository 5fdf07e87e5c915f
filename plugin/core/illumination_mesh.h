// Mesh elements and illumination vertices: the places where light is bucketed and illuminance kept.
//
// A mesh point becomes as many illumination vertices as it has sides of creases, so that each has
// one normal. A vertex stands for a third of each element around it: its bucket
// [Volevich 2000, §3.1.3: light is reconstructed at mesh vertices from neighbouring elements].
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "core/receiver.h"
#include "core/triangulation.h"
#include "core/vec3.h"

namespace isolux {

struct SurfaceMesh : PolygonMesh {
    std::span<const Vec3f> corner_normals; // front side, unit; empty: creases by angle
    std::span<const Vec3f> reflectance;    // one for all faces or one a face, linear Rec. 709
    bool double_sided = false;             // else the back absorbs
    std::span<const float> opacity = {};   // one for all faces or one a face, (0, 1]; empty: all 1
};

// What a photon meets on an element, on either side.
struct Surface {
    Vec3f reflectance;
    std::int32_t mesh = 0;
    std::int32_t back_offset = -1; // from a front vertex to its twin on the back; -1: one-sided
    float opacity = 1.0F;          // share of the light that it stops
};

// 16 bytes: all that a photon needs of the element that it hits.
struct MeshElement {
    std::array<std::int32_t, 3> vertices; // front side, counter-clockwise
    std::int32_t surface = 0;
};

// Where one mesh's vertices lie in IlluminationMesh's arrays.
struct MeshRange {
    std::int32_t front_begin = 0, front_end = 0, back_end = 0; // the back begins at front_end
    std::int32_t element_begin = 0, element_end = 0;           // in the order of triangulate()
    std::vector<std::int32_t> corner_vertices;                 // from front_begin; -1 at holes
};

struct IlluminationMesh {
    std::vector<MeshElement> elements;
    std::vector<Surface> surfaces;
    std::vector<MeshRange> meshes;
    // One entry a vertex:
    std::vector<Vec3d> positions;         // m, world space
    std::vector<Vec3f> normals;           // unit; zero where all elements around are degenerate
    std::vector<double> areas;            // m², a third of area() of the elements around
    std::vector<std::int32_t> components; // topologically connected surface, its lowest vertex

    // Adds a mesh: triangulates it and splits its points at creases sharper than crease_angle
    // (rad), or where authored normals differ.
    void add(const SurfaceMesh& mesh, double crease_angle);

    const Surface& surface(const MeshElement& element) const {
        return surfaces[static_cast<std::size_t>(element.surface)];
    }
    // Whether an element absorbs what meets its back.
    bool one_sided(std::int32_t element) const {
        return surface(elements[static_cast<std::size_t>(element)]).back_offset < 0;
    }
    // m², of what stops light: a surface of opacity a is a sieve, of which the share a is there.
    // What photons leave on it, over this area, is its illuminance.
    double area(const MeshElement& element) const;
};

// Calls each(element, vertices) for the front of every element, and for its back where it has one.
template <typename Each> void for_each_side(const IlluminationMesh& mesh, const Each& each) {
    for (const MeshElement& element : mesh.elements) {
        each(element, element.vertices);
        if (const std::int32_t back = mesh.surface(element).back_offset; back >= 0) {
            const auto& [a, b, c] = element.vertices;
            each(element, std::array{a + back, b + back, c + back});
        }
    }
}

// Where a surface ends: of each vertex whether the elements around it don't go all the way round.
std::vector<bool> border_vertices(const IlluminationMesh& mesh);

// Where each vertex samples light: a little towards the middle of the elements around it, so that a
// vertex in a corner of the room doesn't lie in the plane of the other wall; never behind one of
// them. The normal is zero where all elements around are degenerate: no light is defined there.
// closed : by element, a bit for each corner, of the front first, whose element doesn't count
// there,
//     but for one at least of each vertex; empty: none
std::vector<Receiver> vertex_receivers(const IlluminationMesh& mesh,
                                       std::span<const std::uint8_t> closed = {});
// Of the way to the middle of the elements around: small beside an element, large beside the
// rounding of its coordinates.
inline constexpr double kReceiverInset = 1.0 / 64.0;

} // namespace isolux
