#include "core/illumination_mesh.h"

#include "core/nearest_normals.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <numeric>
#include <tuple>

namespace isolux {
namespace {

// Authored normals of one smooth vertex agree to the rounding of their export.
const float kSameNormalCosine = static_cast<float>(std::cos(1.0 * std::numbers::pi / 180.0));

// Faces of one edge that are compared with each other; more of them are no surface, and would take
// time with their square.
constexpr std::size_t kMostFacesOfEdge = 64;

class DisjointSets {
  public:
    explicit DisjointSets(std::size_t n) : parent_(n) {
        std::iota(parent_.begin(), parent_.end(), 0);
    }

    std::int32_t root(std::int32_t i) {
        while (parent_[i] != i) {
            i = parent_[i] = parent_[parent_[i]];
        }
        return i;
    }
    // The lowest member is the root, so that the outcome does not depend on the order of calls.
    void join(std::int32_t a, std::int32_t b) {
        a = root(a);
        b = root(b);
        parent_[std::max(a, b)] = std::min(a, b);
    }

  private:
    std::vector<std::int32_t> parent_;
};

struct Corners {
    std::vector<std::int32_t> face, next, previous; // face, and the neighbouring corners in it
};

Corners corner_neighbours(const SurfaceMesh& mesh) {
    const std::size_t n = mesh.face_vertex_indices.size();
    Corners out{std::vector<std::int32_t>(n), std::vector<std::int32_t>(n),
                std::vector<std::int32_t>(n)};
    std::int32_t first = 0;
    for (std::size_t f = 0; f < mesh.face_vertex_counts.size(); ++f) {
        const std::int32_t count = mesh.face_vertex_counts[f];
        for (std::int32_t i = 0; i < count; ++i) {
            out.face[first + i] = static_cast<std::int32_t>(f);
            out.next[first + i] = first + (i + 1) % count;
            out.previous[first + i] = first + (i + count - 1) % count;
        }
        first += count;
    }
    return out;
}

// Corners of each mesh point, in rising order: those of point p are at [begin[p], begin[p + 1]).
struct PointCorners {
    std::vector<std::int32_t> begin, corners;
};

PointCorners corners_of_points(const SurfaceMesh& mesh) {
    PointCorners out{std::vector<std::int32_t>(mesh.points.size() + 1, 0),
                     std::vector<std::int32_t>(mesh.face_vertex_indices.size())};
    for (const std::int32_t p : mesh.face_vertex_indices) {
        ++out.begin[p + 1];
    }
    std::partial_sum(out.begin.begin(), out.begin.end(), out.begin.begin());
    std::vector<std::int32_t> at(out.begin.begin(), out.begin.end() - 1);
    for (std::size_t c = 0; c < mesh.face_vertex_indices.size(); ++c) {
        out.corners[at[mesh.face_vertex_indices[c]]++] = static_cast<std::int32_t>(c);
    }
    return out;
}

// Joins corners of a point whose authored normals agree.
void join_by_normals(const SurfaceMesh& mesh, std::span<const std::int32_t> corners,
                     DisjointSets& smooth, std::vector<std::int32_t>& leaders) {
    leaders.clear();
    for (const std::int32_t c : corners) {
        const auto same = std::ranges::find_if(leaders, [&](std::int32_t leader) {
            return dot(mesh.corner_normals[leader], mesh.corner_normals[c]) >= kSameNormalCosine;
        });
        if (same == leaders.end()) {
            leaders.push_back(c);
        } else {
            smooth.join(*same, c);
        }
    }
}

struct EdgeAtPoint {
    std::int32_t other_point, corner;
    auto operator<=>(const EdgeAtPoint&) const = default;
};

// Joins corners of a point whose faces share an edge there that is no crease, and those of faces
// without area, which have no normal of their own, to the first of a face that has one.
void join_by_angle(const SurfaceMesh& mesh, std::span<const std::int32_t> corners,
                   const Corners& neighbours, std::span<const Vec3f> face_normals,
                   float crease_cosine, DisjointSets& smooth, std::vector<EdgeAtPoint>& edges) {
    const auto has_area = [&](std::int32_t c) {
        return face_normals[neighbours.face[c]] != Vec3f{};
    };
    const auto first = std::ranges::find_if(corners, has_area);
    edges.clear();
    for (const std::int32_t c : corners) {
        if (first != corners.end() && !has_area(c)) {
            smooth.join(*first, c);
        }
        edges.push_back({mesh.face_vertex_indices[neighbours.next[c]], c});
        edges.push_back({mesh.face_vertex_indices[neighbours.previous[c]], c});
    }
    std::ranges::sort(edges);
    for (std::size_t i = 1; i < edges.size(); ++i) {
        const std::size_t last = i > kMostFacesOfEdge ? i - kMostFacesOfEdge : 0;
        for (std::size_t j = i; j-- > last && edges[j].other_point == edges[i].other_point;) {
            const Vec3f& a = face_normals[neighbours.face[edges[i].corner]];
            const Vec3f& b = face_normals[neighbours.face[edges[j].corner]];
            if (dot(a, b) >= crease_cosine) {
                smooth.join(edges[i].corner, edges[j].corner);
            }
        }
    }
}

// One surface for each reflectance and opacity that occur in the mesh; out[f] is that of face f.
std::vector<std::int32_t> add_surfaces(const SurfaceMesh& mesh, Surface surface,
                                       std::vector<Surface>& surfaces) {
    std::vector<std::int32_t> of_face(mesh.face_vertex_counts.size());
    std::map<std::tuple<float, float, float, float>, std::int32_t> known;
    const bool one = mesh.reflectance.size() == 1 && mesh.opacity.size() <= 1;
    for (std::size_t f = 0; f < of_face.size(); ++f) {
        const Vec3f& rho = mesh.reflectance[mesh.reflectance.size() == 1 ? 0 : f];
        const float opacity =
            mesh.opacity.empty() ? 1.0F : mesh.opacity[mesh.opacity.size() == 1 ? 0 : f];
        const auto [entry, is_new] = known.try_emplace({rho.x, rho.y, rho.z, opacity},
                                                       static_cast<std::int32_t>(surfaces.size()));
        if (is_new) {
            surface.reflectance = rho;
            surface.opacity = opacity;
            surfaces.push_back(surface);
        }
        of_face[f] = entry->second;
        if (one) {
            std::ranges::fill(of_face, entry->second);
            break;
        }
    }
    return of_face;
}

} // namespace

void IlluminationMesh::add(const SurfaceMesh& mesh, double crease_angle) {
    const std::size_t corner_count = mesh.face_vertex_indices.size();
    const Corners neighbours = corner_neighbours(mesh);
    std::vector<Vec3d> face_areas(mesh.face_vertex_counts.size());
    std::vector<Vec3f> face_normals(mesh.face_vertex_counts.size());
    std::int32_t first = 0;
    for (std::size_t f = 0; f < face_areas.size(); ++f) {
        face_areas[f] = area_vector(mesh, first, mesh.face_vertex_counts[f]);
        face_normals[f] = normalize(face_areas[f]).as<float>();
        first += mesh.face_vertex_counts[f];
    }

    DisjointSets smooth(corner_count);
    const PointCorners of_points = corners_of_points(mesh);
    const float crease_cosine = static_cast<float>(std::cos(crease_angle));
    std::vector<std::int32_t> leaders;
    std::vector<EdgeAtPoint> edges;
    for (std::size_t p = 0; p < mesh.points.size(); ++p) {
        const std::span corners(of_points.corners.data() + of_points.begin[p],
                                of_points.corners.data() + of_points.begin[p + 1]);
        if (mesh.corner_normals.empty()) {
            join_by_angle(mesh, corners, neighbours, face_normals, crease_cosine, smooth, edges);
        } else {
            join_by_normals(mesh, corners, smooth, leaders);
        }
    }

    // Vertices in the order of points, so that neighbours lie near each other in memory.
    MeshRange range;
    range.front_begin = static_cast<std::int32_t>(positions.size());
    range.corner_vertices.assign(corner_count, -1);
    const std::vector<bool> hole = hole_flags(mesh);
    std::vector<Vec3d> normal_sums;
    for (const std::int32_t c : of_points.corners) {
        if (hole[neighbours.face[c]]) {
            continue;
        }
        // The root is the group's lowest corner, yet may lie in a hole: keep the id with the root.
        std::int32_t& at_root = range.corner_vertices[smooth.root(c)];
        if (at_root < 0) {
            at_root = static_cast<std::int32_t>(normal_sums.size());
            positions.push_back(mesh.points[mesh.face_vertex_indices[c]]);
            normal_sums.emplace_back();
        }
        range.corner_vertices[c] = at_root;
        normal_sums[at_root] += mesh.corner_normals.empty() ? face_areas[neighbours.face[c]]
                                                            : mesh.corner_normals[c].as<double>();
    }
    for (std::size_t c = 0; c < corner_count; ++c) {
        if (hole[neighbours.face[c]]) {
            range.corner_vertices[c] = -1;
        }
    }
    const auto front_count = static_cast<std::int32_t>(normal_sums.size());
    range.front_end = range.front_begin + front_count;
    range.back_end = range.front_end + (mesh.double_sided ? front_count : 0);
    for (const Vec3d& sum : normal_sums) {
        normals.push_back(normalize(sum).as<float>());
    }
    fill_normals(std::span(positions).subspan(range.front_begin),
                 std::span(normals).subspan(range.front_begin));

    const std::vector<std::int32_t> surface_of_face =
        add_surfaces(mesh,
                     {.reflectance = {},
                      .mesh = static_cast<std::int32_t>(meshes.size()),
                      .back_offset = mesh.double_sided ? front_count : -1},
                     surfaces);
    DisjointSets connected(static_cast<std::size_t>(front_count));
    areas.resize(static_cast<std::size_t>(range.back_end), 0.0);
    const Triangulation triangles = triangulate(mesh);
    range.element_begin = static_cast<std::int32_t>(elements.size());
    range.element_end = range.element_begin + static_cast<std::int32_t>(triangles.faces.size());
    if (elements.empty()) { // else room for each of many meshes would be a copy for each
        elements.reserve(triangles.corners.size());
    }
    for (std::size_t t = 0; t < triangles.corners.size(); ++t) {
        MeshElement element{{}, surface_of_face[triangles.faces[t]]};
        for (std::size_t k = 0; k < 3; ++k) {
            const std::int32_t corner = triangles.corners[t][k];
            element.vertices[k] = range.front_begin + range.corner_vertices[corner];
            connected.join(range.corner_vertices[triangles.corners[t][0]],
                           range.corner_vertices[corner]);
        }
        const double third = area(element) / 3.0;
        for (const std::int32_t v : element.vertices) {
            areas[v] += third;
        }
        elements.push_back(element);
    }
    for (std::int32_t v = 0; v < front_count; ++v) {
        components.push_back(range.front_begin + connected.root(v));
    }
    if (mesh.double_sided) {
        for (std::int32_t v = range.front_begin; v < range.front_end; ++v) {
            positions.push_back(Vec3d(positions[v]));
            normals.push_back(-normals[v]);
            areas[v + front_count] = areas[v];
            components.push_back(components[v] + front_count);
        }
    }
    meshes.push_back(std::move(range));
}

double IlluminationMesh::area(const MeshElement& element) const {
    const auto [a, b, c] = element.vertices;
    const Vec3d& p = positions[a];
    return 0.5 * static_cast<double>(surface(element).opacity) *
           length(cross(positions[b] - p, positions[c] - p));
}

std::vector<bool> border_vertices(const IlluminationMesh& mesh) {
    // Edges that lie opposite a vertex end where the next one begins, but for a gap.
    std::vector<std::int64_t> gaps(mesh.areas.size());
    for_each_side(mesh, [&](const MeshElement&, const auto& vertices) {
        for (std::size_t k = 0; k < 3; ++k) {
            gaps[vertices[k]] += vertices[(k + 2) % 3] - vertices[(k + 1) % 3];
        }
    });
    std::vector<bool> out(gaps.size());
    for (std::size_t v = 0; v < out.size(); ++v) {
        out[v] = gaps[v] != 0;
    }
    return out;
}

std::vector<Receiver> vertex_receivers(const IlluminationMesh& mesh,
                                       std::span<const std::uint8_t> closed) {
    std::vector<Vec3d> middles(mesh.positions.size()); // times area
    std::vector<double> areas = mesh.areas;
    for (std::size_t e = 0; e < mesh.elements.size(); ++e) {
        const MeshElement& element = mesh.elements[e];
        const Surface& surface = mesh.surface(element);
        const auto [a, b, c] = element.vertices;
        const Vec3d &p = mesh.positions[a], &q = mesh.positions[b], &r = mesh.positions[c];
        const double area = mesh.area(element) / 3.0;
        const unsigned shut = closed.empty() ? 0U : closed[e];
        const auto take = [&](std::int32_t v, unsigned bit) {
            if ((shut >> bit & 1U) == 0) {
                middles[v] += (p + q + r) * (area / 3.0);
            } else {
                areas[v] -= area;
            }
        };
        for (unsigned k = 0; k < 3; ++k) {
            take(element.vertices[k], k);
            if (surface.back_offset >= 0) {
                take(element.vertices[k] + surface.back_offset, 3 + k);
            }
        }
    }
    std::vector<Receiver> out(mesh.positions.size());
    for (std::size_t v = 0; v < out.size(); ++v) {
        const Vec3d& p = mesh.positions[v];
        const double area = areas[v];
        out[v] = {area > 0.0 ? p + (middles[v] * (1.0 / area) - p) * kReceiverInset : p,
                  mesh.normals[v]};
    }
    for (std::size_t m = 0; m < mesh.meshes.size(); ++m) {
        for (std::int32_t v = mesh.meshes[m].front_begin; v < mesh.meshes[m].back_end; ++v) {
            out[v].mesh = static_cast<std::int32_t>(m);
        }
    }

    // The middle lies within a convex body: lifted in front of all elements around.
    constexpr double kLeastCosine = 0.1; // between vertex and element; bounds the lift
    std::vector<double> lifts(out.size());
    for (const MeshElement& element : mesh.elements) {
        const Surface& surface = mesh.surfaces[static_cast<std::size_t>(element.surface)];
        const auto [a, b, c] = element.vertices;
        const Vec3d& p = mesh.positions[a];
        const Vec3d front = normalize(cross(mesh.positions[b] - p, mesh.positions[c] - p));
        const auto lift = [&](std::int32_t v, const Vec3d& normal) {
            const double depth = -dot(out[v].position - mesh.positions[v], normal);
            const double cosine = dot(out[v].normal.as<double>(), normal);
            lifts[v] = std::max(lifts[v], depth / std::max(cosine, kLeastCosine));
        };
        for (const std::int32_t v : element.vertices) {
            lift(v, front);
            if (surface.back_offset >= 0) {
                lift(v + surface.back_offset, -front);
            }
        }
    }
    for (std::size_t v = 0; v < out.size(); ++v) {
        out[v].position += out[v].normal.as<double>() * lifts[v];
    }
    return out;
}

} // namespace isolux
