#include "core/refined_mesh.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <unordered_map>

#include "core/position_hash.h"

namespace isolux {
namespace {

// Of the scene's diagonal: 1.2 mm in a room of 10 m.
constexpr double kLeastLength = 0x1p-13;

double diagonal(const std::vector<Vec3d>& positions) {
    if (positions.empty()) {
        return 0.0;
    }
    Vec3d low = positions.front(), high = low;
    for (const Vec3d& p : positions) {
        low = {std::min(low.x, p.x), std::min(low.y, p.y), std::min(low.z, p.z)};
        high = {std::max(high.x, p.x), std::max(high.y, p.y), std::max(high.z, p.z)};
    }
    return length(high - low);
}

// Points at the same position of one mesh share a number; one entry a vertex.
std::vector<std::int32_t> number_points(const IlluminationMesh& mesh) {
    std::vector<std::int32_t> out(mesh.positions.size());
    std::int32_t count = 0;
    for (const MeshRange& range : mesh.meshes) {
        std::unordered_map<Vec3d, std::int32_t, PositionHash> points;
        for (std::int32_t v = range.front_begin; v < range.back_end; ++v) {
            const auto [entry, is_new] = points.try_emplace(mesh.positions[v], count);
            count += is_new;
            out[v] = entry->second;
        }
    }
    return out;
}

} // namespace

RefinedMesh::RefinedMesh(const IlluminationMesh& mesh)
    : least_length_(kLeastLength * diagonal(mesh.positions)), twins_(mesh.positions.size(), -1) {
    reflectances_.reserve(mesh.elements.size());
    for (const MeshElement& element : mesh.elements) {
        const Surface& surface = mesh.surfaces[element.surface];
        reflectances_.push_back(surface.reflectance);
        for (const std::int32_t v : element.vertices) {
            twins_[v] = surface.back_offset >= 0 ? v + surface.back_offset : -1;
        }
    }
    const std::vector<std::int32_t> points = number_points(mesh);
    std::unordered_map<std::uint64_t, std::int32_t> edge_of_points;
    elements_.reserve(mesh.elements.size());
    for (std::size_t e = 0; e < mesh.elements.size(); ++e) {
        const auto& vertices = mesh.elements[e].vertices;
        const Vec3f& reflectance = reflectances_[e];
        RefinedElement element{
            vertices, {}, static_cast<std::int32_t>(e), {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}};
        const bool needle = is_needle(mesh.positions[vertices[0]], mesh.positions[vertices[1]],
                                      mesh.positions[vertices[2]]);
        for (int k = 0; k < 3; ++k) {
            std::int32_t a = vertices[k], b = vertices[(k + 1) % 3];
            if (points[a] > points[b]) {
                std::swap(a, b); // all sides of an edge run the same way
            }
            const auto [entry, is_new] = edge_of_points.try_emplace(
                static_cast<std::uint64_t>(points[a]) << 32 | static_cast<std::uint32_t>(points[b]),
                edge_count());
            if (is_new) {
                edges_.emplace_back();
            }
            element.edges[k] = entry->second;
            EdgeSide& front = sides_[add_side(entry->second, a, b, reflectance)];
            if (luminance(reflectance) > luminance(front.reflectance)) {
                front.reflectance = reflectance; // the brighter of two elements is the one seen
                if (front.back >= 0) {
                    sides_[front.back].reflectance = reflectance;
                }
            }
            edges_[entry->second].open |= !needle;
        }
        elements_.push_back(element);
    }
}

std::int32_t RefinedMesh::sample_of(std::int32_t vertex) const {
    const auto first = static_cast<std::int32_t>(vertex_count());
    return vertex < first ? vertex : split_vertices_[vertex - first].sample;
}

std::int32_t RefinedMesh::twin(std::int32_t vertex) const {
    const auto first = static_cast<std::int32_t>(vertex_count());
    return vertex < first ? twins_[vertex] : split_vertices_[vertex - first].twin;
}

bool RefinedMesh::is_needle(const Vec3d& a, const Vec3d& b, const Vec3d& c) const {
    const double longest = std::max({length(b - a), length(c - b), length(a - c)});
    return length(cross(b - a, c - a)) < least_length_ * longest;
}

// The front side from vertex a to b; -1: none.
std::int32_t RefinedMesh::find_side(std::int32_t edge, std::int32_t a, std::int32_t b) const {
    std::int32_t s = edges_[edge].first_side;
    while (s >= 0 && (sides_[s].is_back || sides_[s].ends != std::array{a, b})) {
        s = sides_[s].next;
    }
    return s;
}

// That which is there, or a new one, followed by its back.
std::int32_t RefinedMesh::add_side(std::int32_t edge, std::int32_t a, std::int32_t b,
                                   Vec3f reflectance) {
    const std::int32_t known = find_side(edge, a, b);
    if (known >= 0) {
        return known;
    }
    std::int32_t* last = &edges_[edge].first_side;
    while (*last >= 0) {
        last = &sides_[*last].next;
    }
    const auto front = *last = static_cast<std::int32_t>(sides_.size());
    EdgeSide side{{a, b}, {}, {}, reflectance};
    if (twin(a) >= 0 && twin(b) >= 0) {
        side.back = side.next = front + 1;
    }
    sides_.push_back(side);
    if (side.back >= 0) {
        EdgeSide back{{twin(a), twin(b)}, {}, {}, reflectance};
        back.is_back = true;
        sides_.push_back(back);
    }
    return front;
}

// Makes the vertices of an edge's splits, and the edges between them.
void RefinedMesh::divide(std::int32_t e) {
    const RefinedEdge whole = edges_[e];
    std::vector<int> cuts{-1}; // its splits between its ends
    for (int i = 0; i < whole.inner_count; ++i) {
        if ((whole.splits >> i & 1U) == 0) {
            continue;
        }
        cuts.push_back(i);
        for (std::int32_t s = whole.first_side; s >= 0; s = sides_[s].next) {
            EdgeSide& side = sides_[s];
            side.splits[i] = static_cast<std::int32_t>(vertex_count() + split_vertices_.size());
            split_vertices_.push_back({side.ends, whole.fractions[i],
                                       side.back >= 0 ? side.splits[i] + 1 : -1, point_count_,
                                       side.samples[i]});
        }
        ++point_count_;
    }
    cuts.push_back(whole.inner_count);

    edges_[e].first_part = edge_count();
    for (std::size_t c = 1; c < cuts.size(); ++c) {
        const int first = cuts[c - 1], last = cuts[c];
        const double from = first < 0 ? 0.0 : whole.fractions[first];
        const double to = last == whole.inner_count ? 1.0 : whole.fractions[last];
        RefinedEdge part;
        for (int i = first + 1; i < last; ++i) {
            part.fractions[part.inner_count++] = (whole.fractions[i] - from) / (to - from);
        }
        const std::int32_t id = edge_count();
        edges_.push_back(part);
        for (std::int32_t s = whole.first_side; s >= 0; s = sides_[s].next) {
            if (sides_[s].is_back) {
                continue; // comes with its front
            }
            const EdgeSide source = sides_[s];
            const std::int32_t target =
                add_side(id, first < 0 ? source.ends[0] : source.splits[first],
                         last == whole.inner_count ? source.ends[1] : source.splits[last],
                         source.reflectance);
            const auto inherit = [&](std::int32_t a, std::int32_t b) {
                std::copy_n(sides_[a].samples.begin() + first + 1, part.inner_count,
                            sides_[b].samples.begin());
            };
            inherit(s, target);
            if (source.back >= 0) {
                inherit(source.back, sides_[target].back);
            }
        }
    }
}

// Corners and splits round an element.
struct RefinedMesh::Outline {
    int count = 0;
    std::array<TemplateNode, kTemplateNodes> nodes;
    std::array<std::int32_t, kTemplateNodes> vertices;
    std::array<std::int32_t, kTemplateNodes> edges; // from each node to the next
    std::array<Vec3d, kTemplateNodes> barycentrics;

    void add(const TemplateNode& node, std::int32_t vertex, std::int32_t edge,
             const Vec3d& barycentric) {
        nodes[count] = node;
        vertices[count] = vertex;
        edges[count] = edge;
        barycentrics[count++] = barycentric;
    }
};

// Corner k of an element, and the splits on the edge that starts there.
void RefinedMesh::add_nodes(Outline& outline, const RefinedElement& element, int k,
                            const NodeOf& node_of) {
    const std::int32_t a = element.vertices[k], b = element.vertices[(k + 1) % 3];
    const Vec3d &from = element.barycentrics[k], &to = element.barycentrics[(k + 1) % 3];
    const unsigned on_edge = 1U << k, on_last = 1U << (k + 2) % 3;
    const std::int32_t e = element.edges[k];
    const Vec3f& reflectance = reflectances_[element.parent];
    TemplateNode corner = node_of(a, reflectance);
    corner.edges = on_edge | on_last;
    if (edges_[e].splits == 0) {
        outline.add(corner, a, e, from);
        return;
    }
    if (edges_[e].first_part < 0) {
        divide(e);
    }
    const RefinedEdge& edge = edges_[e];
    const std::int32_t ahead = find_side(e, a, b);
    const EdgeSide& side = sides_[ahead >= 0 ? ahead : find_side(e, b, a)];
    const int step = ahead >= 0 ? 1 : -1;
    std::int32_t part = edge.first_part + (ahead >= 0 ? 0 : std::popcount(edge.splits));
    outline.add(corner, a, part, from);
    for (int i = ahead >= 0 ? 0 : edge.inner_count - 1; 0 <= i && i < edge.inner_count; i += step) {
        if ((edge.splits >> i & 1U) != 0) {
            const double t = ahead >= 0 ? edge.fractions[i] : 1.0 - edge.fractions[i];
            TemplateNode node = node_of(side.splits[i], reflectance);
            node.edges = on_edge;
            part += step;
            outline.add(node, side.splits[i], part, from * (1.0 - t) + to * t);
        }
    }
}

void RefinedMesh::split_element(const RefinedElement& element, const NodeOf& node_of,
                                double threshold, std::int32_t first_new_edge,
                                std::vector<RefinedElement>& out) {
    Outline outline;
    for (int k = 0; k < 3; ++k) {
        add_nodes(outline, element, k, node_of);
    }
    const int n = outline.count;
    std::array<std::array<std::int32_t, kTemplateNodes>, kTemplateNodes> inner; // edge ij, i < j
    inner.fill({});
    const auto edge_between = [&](int i, int j) {
        if (j == (i + 1) % n) {
            return outline.edges[i];
        }
        std::int32_t& e = inner[std::min(i, j)][std::max(i, j)];
        if (e == 0) { // the first edge is the scene's
            e = edge_count();
            edges_.emplace_back();
            add_side(e, outline.vertices[i], outline.vertices[j], reflectances_[element.parent]);
        }
        return e;
    };
    const auto triangles = triangulate_template({outline.nodes.data(), std::size_t(n)}, threshold);
    for (const auto& [i, j, k] : triangles) {
        const RefinedElement part{
            {outline.vertices[i], outline.vertices[j], outline.vertices[k]},
            {edge_between(i, j), edge_between(j, k), edge_between(k, i)},
            element.parent,
            {outline.barycentrics[i], outline.barycentrics[j], outline.barycentrics[k]}};
        const auto& nodes = outline.nodes;
        if (!is_needle(nodes[i].position, nodes[j].position, nodes[k].position)) {
            for (const std::int32_t e : part.edges) {
                edges_[e].open |= e >= first_new_edge;
            }
        }
        out.push_back(part);
    }
}

void RefinedMesh::split(const NodeOf& node_of, double threshold) {
    const std::int32_t first_new_edge = edge_count();
    std::vector<RefinedElement> finer;
    finer.reserve(elements_.size());
    for (const RefinedElement& element : elements_) {
        const bool whole = std::ranges::all_of(
            element.edges, [&](std::int32_t e) { return edges_[e].splits == 0; });
        if (whole) {
            finer.push_back(element);
        } else {
            split_element(element, node_of, threshold, first_new_edge, finer);
        }
    }
    elements_ = std::move(finer);
}

} // namespace isolux
