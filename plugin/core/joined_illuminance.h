// Illuminance at vertices by two estimates in one: photons, whose mean over the bucket is right
// however coarse the mesh is, and what is known at the vertex. Where they differ by no more than
// photons do by chance the latter counts, else photons as far as they are sure. Each side of a mesh
// keeps the flux that its photons brought.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/illumination_mesh.h"
#include "core/visible_area.h"

namespace isolux {

// One a vertex.
struct TwoEstimates {
    std::span<const Vec3f> counted;   // lx by channel, means over the buckets
    double photon_flux;               // lm, of one of their photons
    std::span<const Vec3f> known;     // lx by channel, at the vertices
    std::span<const double> variance; // lx², photometric, of the latter
};

// Vertices of a mesh that face the same way: a floor, a wall, a ceiling. Six a mesh.
std::size_t mesh_side_count(const IlluminationMesh& mesh);
std::size_t mesh_side(const Receiver& receiver);

struct JoinedIlluminance {
    std::vector<Vec3f> illuminance; // lx by channel
    std::vector<double> variance;   // lx², photometric, by chance at one vertex
    // lm, one a side of a mesh, whose light one photon more there raises by its flux over this.
    std::vector<double> side_flux;
};

// lit : vertices that light can reach; the others keep what is known
// visible : empty where it isn't known: all
JoinedIlluminance joined_illuminance(const IlluminationMesh& mesh,
                                     std::span<const Receiver> receivers,
                                     std::span<const std::int32_t> lit, const VisibleArea& visible,
                                     const TwoEstimates& light);

} // namespace isolux
