#include "core/vertex_kdtree.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <ranges>

namespace isolux {
namespace {

constexpr std::uint32_t kLeafVertices = 4;
// Cells whose normals spread less than this decide by their axis alone.
constexpr double kTightAngle = 5.0; // °

// A cell is cut by its normals where they differ by more than its diameter in units of so many
// radii: 30° or more.
constexpr float kNormalScale = 4.0F;

double cosine(double degrees) { return std::cos(degrees * std::numbers::pi / 180.0); }

struct Extent {
    std::array<float, 6> low, high; // of position, normal

    Extent() {
        low.fill(std::numeric_limits<float>::max());
        high.fill(std::numeric_limits<float>::lowest());
    }
    void add(std::size_t axis, float value) {
        low[axis] = std::min(low[axis], value);
        high[axis] = std::max(high[axis], value);
    }
    float size(std::size_t axis) const { return high[axis] - low[axis]; }
};

// Sorts vertices into cells, larger cells first.
class CellBuilder {
  public:
    explicit CellBuilder(const IlluminationMesh& mesh)
        : mesh_(mesh), positions(mesh.positions.size()), component_cells(mesh.positions.size()) {
        Vec3d sum;
        for (const auto& p : mesh.positions) {
            sum += p;
        }
        const Vec3d centre =
            sum * (1.0 / static_cast<double>(std::max<std::size_t>(1, positions.size())));
        std::ranges::transform(mesh.positions, positions.begin(),
                               [&](const Vec3d& p) { return (p - centre).as<float>(); });
    }

    void build() {
        if (positions.empty()) {
            return;
        }
        std::vector<std::int32_t> by_component(positions.size());
        std::iota(by_component.begin(), by_component.end(), 0);
        std::ranges::stable_sort(by_component, {},
                                 [&](std::int32_t v) { return mesh_.components[v]; });
        std::vector<Component> components;
        for (std::size_t i = 0; i < by_component.size();) {
            Component component{{}, {}};
            const std::size_t begin = i;
            Extent extent;
            for (; i < by_component.size() &&
                   mesh_.components[by_component[i]] == mesh_.components[by_component[begin]];
                 ++i) {
                const Vec3f& p = positions[by_component[i]];
                extent.add(0, p.x);
                extent.add(1, p.y);
                extent.add(2, p.z);
            }
            component.vertices = std::span(by_component).subspan(begin, i - begin);
            component.middle = {0.5F * (extent.low[0] + extent.high[0]),
                                0.5F * (extent.low[1] + extent.high[1]),
                                0.5F * (extent.low[2] + extent.high[2])};
            components.push_back(component);
        }
        vertices.reserve(positions.size());
        cells.reserve(positions.size());
        cells.emplace_back();
        split_components(0, components);
    }

    std::vector<VertexCell> cells;
    std::vector<std::int32_t> component_cells, vertices;
    std::vector<Vec3f> positions; // of each vertex, recentred

  private:
    struct Component {
        std::span<const std::int32_t> vertices;
        Vec3f middle;
    };

    static float coordinate(const Vec3f& v, std::size_t axis) {
        return axis == 0 ? v.x : axis == 1 ? v.y : v.z;
    }
    float coordinate(std::int32_t vertex, std::size_t axis) const {
        return axis < 3 ? coordinate(positions[vertex], axis)
                        : coordinate(mesh_.normals[vertex], axis - 3);
    }

    std::int32_t add_children(std::size_t cell) {
        const auto first = static_cast<std::int32_t>(cells.size());
        cells[cell].first_child = first;
        cells.resize(cells.size() + 2);
        return first;
    }

    void split_components(std::size_t cell, std::span<Component> components) {
        const auto begin = static_cast<std::uint32_t>(vertices.size());
        if (components.size() == 1) {
            const auto members = components.front().vertices;
            vertices.insert(vertices.end(), members.begin(), members.end());
            cells[cell].component = mesh_.components[members.front()];
            for (const std::int32_t v : members) {
                component_cells[v] = static_cast<std::int32_t>(cell);
            }
            split_vertices(cell, begin, static_cast<std::uint32_t>(vertices.size()));
            return;
        }
        Extent extent;
        for (const Component& component : components) {
            for (std::size_t axis = 0; axis < 3; ++axis) {
                extent.add(axis, coordinate(component.middle, axis));
            }
        }
        std::size_t axis = 0;
        for (const std::size_t other : {1U, 2U}) {
            axis = extent.size(other) > extent.size(axis) ? other : axis;
        }
        const std::size_t half = components.size() / 2;
        std::ranges::nth_element(components, components.begin() + static_cast<std::ptrdiff_t>(half),
                                 [&](const Component& a, const Component& b) {
                                     const float x = coordinate(a.middle, axis),
                                                 y = coordinate(b.middle, axis);
                                     return x != y ? x < y : a.vertices[0] < b.vertices[0];
                                 });
        const auto first = static_cast<std::size_t>(add_children(cell));
        split_components(first, components.first(half));
        split_components(first + 1, components.subspan(half));
        measure(cell, begin, static_cast<std::uint32_t>(vertices.size()));
    }

    void split_vertices(std::size_t cell, std::uint32_t begin, std::uint32_t end) {
        const Extent extent = measure(cell, begin, end);
        if (end - begin <= kLeafVertices) {
            return;
        }
        // Sheets that face two ways in one place, or a thin tube, are parted by their normals.
        const float normal_scale = kNormalScale * cells[cell].radius;
        std::size_t axis = 0;
        float largest = extent.size(0);
        for (std::size_t other = 1; other < 6; ++other) {
            const float size = extent.size(other) * (other < 3 ? 1.0F : normal_scale);
            if (size > largest) {
                largest = size;
                axis = other;
            }
        }
        const std::uint32_t middle = begin + (end - begin) / 2;
        std::nth_element(vertices.begin() + begin, vertices.begin() + middle,
                         vertices.begin() + end, [&](std::int32_t a, std::int32_t b) {
                             const float x = coordinate(a, axis), y = coordinate(b, axis);
                             return x != y ? x < y : a < b;
                         });
        const std::int32_t component = cells[cell].component;
        const auto first = static_cast<std::size_t>(add_children(cell));
        cells[first].component = cells[first + 1].component = component;
        split_vertices(first, begin, middle);
        split_vertices(first + 1, middle, end);
    }

    Extent measure(std::size_t at, std::uint32_t begin, std::uint32_t end) {
        VertexCell& cell = cells[at];
        cell.begin = begin;
        cell.end = end;
        const auto members = std::span(vertices).subspan(begin, end - begin);
        Extent extent;
        Vec3d position_sum, normal_sum;
        for (const std::int32_t v : members) {
            for (std::size_t axis = 0; axis < 6; ++axis) {
                extent.add(axis, coordinate(v, axis));
            }
            position_sum += positions[v].as<double>();
            normal_sum += mesh_.normals[v].as<double>();
            cell.area += mesh_.areas[v];
        }
        cell.centre = (position_sum * (1.0 / static_cast<double>(members.size()))).as<float>();
        cell.axis = normalize(normal_sum).as<float>();
        float squared_radius = 0.0F, spread_cosine = 1.0F;
        for (const std::int32_t v : members) {
            const Vec3f from_centre = positions[v] - cell.centre;
            squared_radius = std::max(squared_radius, dot(from_centre, from_centre));
            // Vertices without a normal have no area: they go along unnoticed.
            if (mesh_.normals[v] != Vec3f{}) {
                spread_cosine = std::min(spread_cosine, dot(cell.axis, mesh_.normals[v]));
            }
        }
        cell.radius = std::sqrt(squared_radius);
        const double spread =
            std::acos(std::clamp<double>(spread_cosine, -1.0, 1.0)) * 180.0 / std::numbers::pi;
        if (spread <= kTightAngle) {
            cell.all_cosine = cell.none_cosine = static_cast<float>(cosine(kNormalAngle));
        } else {
            cell.all_cosine =
                spread < kNormalAngle ? static_cast<float>(cosine(kNormalAngle - spread)) : 2.0F;
            cell.none_cosine = spread + kNormalAngle < 180.0
                                   ? static_cast<float>(cosine(kNormalAngle + spread))
                                   : -2.0F;
        }
        return extent;
    }

    const IlluminationMesh& mesh_;
};

} // namespace

VertexKdTree::VertexKdTree(const IlluminationMesh& mesh) {
    CellBuilder builder(mesh);
    builder.build();
    cells_ = std::move(builder.cells);
    component_cells_ = std::move(builder.component_cells);
    vertices_ = std::move(builder.vertices);
    ranks_.resize(vertices_.size());
    positions_.reserve(vertices_.size());
    for (std::size_t rank = 0; rank < vertices_.size(); ++rank) {
        const std::int32_t v = vertices_[rank];
        ranks_[v] = static_cast<std::uint32_t>(rank);
        positions_.push_back(builder.positions[v]);
        normals_.push_back(mesh.normals[v]);
        areas_.push_back(mesh.areas[v]);
    }
    for (VertexCell& cell : cells_) {
        if (cell.component < 0) {
            continue;
        }
        float least = std::numeric_limits<float>::max();
        for (std::uint32_t rank = cell.begin; rank < cell.end; ++rank) {
            const Vec3f from_centre = positions_[rank] - cell.centre;
            if (dot(from_centre, from_centre) < least) {
                least = dot(from_centre, from_centre);
                cell.middle = rank;
            }
        }
    }
}

std::int32_t VertexKdTree::nearest_towards(const Vec3f& place, std::int32_t vertex,
                                           const std::vector<bool>& left_out) const {
    std::uint32_t found = rank(vertex);
    const Vec3f& normal = normals_[found];
    const Vec3f way_to_it = positions_[found] - place;
    const Vec3f towards = normalize(way_to_it);
    float least = dot(way_to_it, way_to_it);
    std::vector<const VertexCell*> open{&component_cell(vertex)};
    while (!open.empty()) {
        const VertexCell& cell = *open.back();
        open.pop_back();
        const Vec3f to_centre = cell.centre - place;
        const float reach = std::sqrt(least) + cell.radius;
        if (dot(to_centre, to_centre) > reach * reach ||
            dot(normal, cell.axis) < cell.none_cosine) {
            continue;
        }
        if (cell.first_child >= 0) {
            open.push_back(&cells_[cell.first_child]);
            open.push_back(&cells_[cell.first_child + 1]);
            continue;
        }
        for (std::uint32_t i = cell.begin; i < cell.end; ++i) {
            const Vec3f way = positions_[i] - place;
            const float squared = dot(way, way), along = dot(way, towards);
            if (squared < least && along > 0.0F && 2.0F * along * along >= squared &&
                areas_[i] > 0.0 && !left_out[vertices_[i]] &&
                dot(normal, normals_[i]) >= kNormalCosine) {
                least = squared;
                found = i;
            }
        }
    }
    return vertices_[found];
}

} // namespace isolux
