#include "core/contact_receivers.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <span>
#include <utility>

#include "core/parallel.h"
#include "core/random.h"
#include "core/sampling.h"

namespace isolux {
namespace {

// Of a step, off the surface: above it where it curves, below what stands on it.
constexpr float kLift = 0.125F;
// Steps are many times the rounding of a ray.
constexpr float kLeastStep = 32.0F;
// Direction across a vertex, in its tangents: far from those in which grids and their diagonals go.
constexpr float kAlong = 0.8F, kAcross = 0.6F;
constexpr std::uint32_t kPairs = 4; // of opposite rays, alike for all elements around a vertex
// Of a free path, in steps, that is looked at: some ten elements.
constexpr float kFarthest = 1000.0F;
// Share of the longest free path around a vertex; elements of less are within what stands there.
constexpr float kClosed = 0.5F;

// A corner of an element, on one side.
struct Corner {
    std::int32_t vertex = 0, element = 0;
    std::uint8_t corner = 0, side = 0;

    std::uint8_t bit() const { return static_cast<std::uint8_t>(1U << (3U * side + corner)); }
};

template <typename Each> void for_each_corner(const IlluminationMesh& mesh, const Each& each) {
    for (std::size_t e = 0; e < mesh.elements.size(); ++e) {
        const MeshElement& element = mesh.elements[e];
        const std::int32_t back = mesh.surface(element).back_offset;
        for (std::uint8_t k = 0; k < 3; ++k) {
            const auto number = static_cast<std::int32_t>(e);
            each(Corner{element.vertices[k], number, k, 0});
            if (back >= 0) {
                each(Corner{element.vertices[k] + back, number, k, 1});
            }
        }
    }
}

std::array<Vec3f, 3> corners_of(const IlluminationMesh& mesh, const RayCaster& caster,
                                std::size_t element) {
    std::array<Vec3f, 3> p;
    for (std::size_t k = 0; k < 3; ++k) {
        p[k] = (mesh.positions[mesh.elements[element].vertices[k]] - caster.origin()).as<float>();
    }
    return p;
}

// m, one a vertex: how far it lies from the places around it where its elements sample light; 0
// where the surface ends, whose vertices sample light within it, and where rays can't tell.
std::vector<float> steps_around(const IlluminationMesh& mesh, const RayCaster& caster) {
    std::vector<float> steps(mesh.positions.size(), std::numeric_limits<float>::max());
    for_each_side(mesh, [&](const MeshElement& element, const auto& vertices) {
        const auto& [a, b, c] = element.vertices;
        const Vec3d middle =
            (mesh.positions[a] + mesh.positions[b] + mesh.positions[c]) * (1.0 / 3.0);
        for (const std::int32_t v : vertices) {
            const Vec3d to = middle - mesh.positions[v];
            steps[v] =
                std::min(steps[v], static_cast<float>(kReceiverInset * std::sqrt(dot(to, to))));
        }
    });
    const std::vector<bool> border = border_vertices(mesh);
    for (std::size_t v = 0; v < steps.size(); ++v) {
        const Vec3f at = (mesh.positions[v] - caster.origin()).as<float>();
        if (border[v] || mesh.areas[v] == 0.0 || steps[v] < kLeastStep * caster.offset(at, 0.0F)) {
            steps[v] = 0.0F;
        }
    }
    return steps;
}

// Whether something stands across a vertex.
bool is_met(const IlluminationMesh& mesh, const RayCaster& caster, std::size_t v, float step) {
    const Vec3f normal = mesh.normals[v];
    const Vec3f at = (mesh.positions[v] - caster.origin()).as<float>() + normal * (kLift * step);
    const auto [s, t] = tangents(normal);
    const Vec3f along = (s * kAlong + t * kAcross) * step;
    return caster.transmitted(Ray{at - along, along * 2.0F}) < 1.0F;
}

// Mean way that light can come from to the element, at its step from the vertex, in steps. Backs
// that absorb are at no distance.
float free_path(const IlluminationMesh& mesh, const IlluminationMesh& traced,
                const RayCaster& caster, const Corner& corner) {
    const std::array<Vec3f, 3> p =
        corners_of(mesh, caster, static_cast<std::size_t>(corner.element));
    const Vec3f across = cross(p[1] - p[0], p[2] - p[0]);
    if (across == Vec3f{}) {
        return 0.0F;
    }
    const Vec3f& vertex = p[corner.corner];
    const Vec3f by =
        ((p[0] + p[1] + p[2]) * (1.0F / 3.0F) - vertex) * static_cast<float>(kReceiverInset);
    const Vec3f normal = normalize(across) * (corner.side == 0 ? 1.0F : -1.0F);
    const float step = std::sqrt(dot(by, by));
    const Vec3f from = vertex + by + normal * (kLift * step);
    const auto path = [&](const Vec3f& direction) {
        const Hit hit = caster.closest_hit({from, direction});
        if (hit.triangle == kNoHit) {
            return kFarthest;
        }
        const bool absorbed = dot(direction, hit.normal) > 0.0F && traced.one_sided(hit.triangle);
        return absorbed ? 0.0F : std::min(kFarthest, hit.distance / step);
    };
    float sum = 0.0F;
    for (std::uint32_t i = 0; i < kPairs; ++i) {
        PhotonRandom random(static_cast<std::uint64_t>(corner.vertex), i);
        const Vec3f direction = cosine_direction(normal, random);
        sum += path(direction) + path(normal * (2.0F * dot(normal, direction)) - direction);
    }
    return sum;
}

} // namespace

PlacedReceivers contact_receivers(const IlluminationMesh& mesh, const IlluminationMesh& traced,
                                  const RayCaster& caster, int threads) {
    const std::vector<float> steps = steps_around(mesh, caster);
    std::vector<std::uint8_t> met(steps.size());
    parallel_blocks(threads, std::size_t{0}, steps.size(), std::size_t{256},
                    [&](std::size_t begin, std::size_t end) {
                        for (std::size_t v = begin; v < end; ++v) {
                            met[v] = steps[v] > 0.0F && is_met(mesh, caster, v, steps[v]) ? 1 : 0;
                        }
                    });
    PlacedReceivers out;
    if (std::ranges::find(met, 1) == met.end()) {
        return out;
    }
    std::vector<Corner> around; // of all vertices that are met
    for_each_corner(mesh, [&](const Corner& corner) {
        if (met[corner.vertex] != 0) {
            around.push_back(corner);
        }
    });
    std::ranges::stable_sort(around, {}, &Corner::vertex);
    std::vector<float> paths(around.size());
    parallel_for(threads, around.size(),
                 [&](std::size_t i) { paths[i] = free_path(mesh, traced, caster, around[i]); });

    std::vector<std::uint8_t> closed(mesh.elements.size()); // bits of corners
    for (std::size_t begin = 0, end = 0; begin < around.size(); begin = end) {
        const std::int32_t vertex = around[begin].vertex;
        while (end < around.size() && around[end].vertex == vertex) {
            ++end;
        }
        const auto own = std::span(paths).subspan(begin, end - begin);
        const float least = kClosed * std::ranges::max(own);
        for (std::size_t i = begin; i < end; ++i) {
            if (paths[i] < least) {
                closed[static_cast<std::size_t>(around[i].element)] |= around[i].bit();
            }
        }
        if (std::ranges::min(own) < least) {
            out.vertices.push_back(vertex);
        }
    }
    if (!out.vertices.empty()) {
        const std::vector<Receiver> placed = vertex_receivers(mesh, closed);
        for (const std::int32_t v : out.vertices) {
            out.receivers.push_back(placed[static_cast<std::size_t>(v)]);
        }
    }
    return out;
}

} // namespace isolux
