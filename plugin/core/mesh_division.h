// The mesh that light is solved on: large elements of the scene are divided.
//
// Light that an element reflects is linear between its vertices. A wall of one quad would pass on
// what its four corners know; divided, it reflects what falls on it [a priori meshing: Cohen &
// Wallace 1993, §6]. The surface stays where it is, and what its vertices tell their own.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "core/illumination_mesh.h"

namespace isolux {

// How the former mesh lies in the divided one; all empty: nothing was divided. A vertex is added in
// the middle between two others of one side.
struct MeshDivision {
    std::vector<std::int32_t> vertices; // of each former vertex, where it is now
    // One a vertex: m² of the former mesh that it stood for; 0 of added ones.
    std::vector<double> areas;
    IlluminationMesh former;                          // for the scene, which lets it go
    std::vector<Receiver> receivers;                  // of each former vertex, as it was
    std::vector<std::int32_t> added;                  // vertices, fronts and backs
    std::vector<std::array<std::int32_t, 2>> between; // of each of those
    std::vector<std::int32_t> twins;                  // of each: of a front its back; else -1
    std::vector<std::int32_t> parts;                  // elements, rising
    std::vector<std::int32_t> parents;                // former element of each of those
    std::vector<std::array<Vec3d, 3>> barycentrics;   // place of its vertices in the parent
};

// Divides elements in the middle of their edges. An edge is divided alike for all elements around
// it, of all meshes: no T-junction arises, no gap opens.
// whole : one a mesh: it stays as it is
MeshDivision divide_large_elements(IlluminationMesh& mesh, const std::vector<bool>& whole);

} // namespace isolux
