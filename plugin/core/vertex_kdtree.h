// Illumination vertices in a static balanced kd-tree [Volevich 2000, §3.1.3]. Its cells stand for
// their vertices where these are seen from afar, so that a wide support costs hardly more than a
// small one.
#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>
#include <span>
#include <vector>

#include "core/illumination_mesh.h"

namespace isolux {

// Normals of a support agree within 25°, so that a curved surface is not taken for flat.
inline constexpr double kNormalAngle = 25.0; // °
inline const float kNormalCosine =
    std::cos(static_cast<float>(kNormalAngle * std::numbers::pi / 180.0));

struct VertexCell {
    std::uint32_t begin = 0, end = 0; // ranks of its vertices
    std::int32_t first_child = -1;    // the other follows; -1: none, a few vertices
    std::int32_t component = -1;      // of all its vertices; -1: they have several
    std::uint32_t middle = 0;         // rank of the vertex nearest to the centre
    double area = 0.0;                // m²
    Vec3f centre;                     // m, mean of the positions
    float radius = 0.0F;              // m, of a sphere around the centre that holds all
    Vec3f axis;                       // mean of the normals
    // Cosine of the angle between the axis and a normal within which all vertices agree with that
    // normal, and beyond which none does.
    float all_cosine = 0.0F, none_cosine = 0.0F;
};

class VertexKdTree {
  public:
    explicit VertexKdTree(const IlluminationMesh& mesh);

    // The root is first. Cells of several components lie above those of one alone.
    std::span<const VertexCell> cells() const { return cells_; }
    // The cell that holds all of the vertex's component.
    const VertexCell& component_cell(std::int32_t vertex) const {
        return cells_[component_cells_[vertex]];
    }

    // By rank, in the order of the cells:
    std::span<const std::int32_t> vertices() const { return vertices_; }
    std::span<const Vec3f> positions() const { return positions_; } // m, recentred
    std::span<const Vec3f> normals() const { return normals_; }
    std::span<const double> areas() const { return areas_; } // m²

    std::uint32_t rank(std::int32_t vertex) const { return ranks_[vertex]; }

    // Of a vertex's surface the one nearest to a place, within 45° of the way from there to it.
    // place : m, recentred
    // left_out : by vertex
    std::int32_t nearest_towards(const Vec3f& place, std::int32_t vertex,
                                 const std::vector<bool>& left_out) const;

  private:
    std::vector<VertexCell> cells_;
    std::vector<std::int32_t> component_cells_; // of each vertex
    std::vector<std::int32_t> vertices_;
    std::vector<std::uint32_t> ranks_;
    std::vector<Vec3f> positions_, normals_;
    std::vector<double> areas_;
};

} // namespace isolux
