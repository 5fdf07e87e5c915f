#include "core/visible_area.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "core/coincident_surfaces.h"
#include "core/parallel.h"
#include "core/random.h"
#include "core/sampling.h"
#include "core/sobol.h"

namespace isolux {
namespace {

constexpr std::uint32_t kPoints = 32; // of an element that something cuts
constexpr int kTries = 2;             // rays of a point
// Share of the way to the middle by which an element's edges are moved in, lest they graze a wall.
constexpr float kInset = 0x1p-6F;

} // namespace

VisibleArea visible_area(const Scene& scene, std::span<const std::uint8_t> lit, std::uint64_t seed,
                         int threads) {
    const IlluminationMesh& mesh = scene.mesh();
    const RayCaster& caster = scene.ray_caster();
    // By element and side, of each corner: the parts that are nearest to it, and by weight.
    struct Covered {
        std::array<float, 3> nearest{}, linear{};
    };
    std::vector<std::array<Covered, 2>> covered(mesh.elements.size());
    const auto meets_light = [&](const Ray& ray) {
        const Hit met = caster.closest_hit(ray);
        if (met.triangle == kNoHit) {
            return true;
        }
        const bool at_back = dot(ray.direction, met.normal) > 0.0F;
        const Hit hit = at_back ? facing_hit(mesh, caster, ray, met) : met;
        const MeshElement& element = mesh.elements[static_cast<std::size_t>(hit.triangle)];
        const std::int32_t back = mesh.surface(element).back_offset;
        if (back < 0) {
            return dot(ray.direction, hit.normal) <= 0.0F;
        }
        const std::int32_t offset = dot(ray.direction, hit.normal) > 0.0F ? back : 0;
        return std::ranges::any_of(element.vertices,
                                   [&](std::int32_t v) { return lit[v + offset] != 0; });
    };
    // Whether something stands in the way along an element's edges.
    const auto is_cut = [&](const std::array<Vec3f, 3>& corners, const Vec3f& normal) {
        const Vec3f middle = (corners[0] + corners[1] + corners[2]) * (1.0F / 3.0F);
        const Vec3f up = normal * caster.offset(middle, 0.0F);
        std::array<Vec3f, 3> ends;
        std::array<Ray, 3> rays;
        std::array<float, 3> free{};
        for (std::size_t k = 0; k < 3; ++k) {
            ends[k] = corners[k] + (middle - corners[k]) * kInset + up;
        }
        for (std::size_t k = 0; k < 3; ++k) {
            rays[k] = {ends[k], ends[(k + 1) % 3] - ends[k]};
        }
        caster.transmitted(rays, free);
        return std::ranges::min(free) < 1.0F;
    };
    const auto look = [&](std::size_t e) {
        const MeshElement& element = mesh.elements[e];
        std::array<Vec3f, 3> corners;
        for (std::size_t k = 0; k < 3; ++k) {
            corners[k] = (mesh.positions[element.vertices[k]] - caster.origin()).as<float>();
        }
        const Vec3f across = cross(corners[1] - corners[0], corners[2] - corners[0]);
        if (across == Vec3f{}) {
            return;
        }
        const Vec3f front = normalize(across);
        for (std::size_t side = 0; side < 2; ++side) {
            if (side == 1 && mesh.surface(element).back_offset < 0) {
                break;
            }
            const Vec3f normal = side == 0 ? front : -front;
            const std::int32_t offset = side == 0 ? 0 : mesh.surface(element).back_offset;
            const bool all_lit = std::ranges::all_of(
                element.vertices, [&](std::int32_t v) { return lit[v + offset] != 0; });
            const bool cut = is_cut(corners, normal);
            if (all_lit && !cut) {
                continue;
            }
            const std::uint64_t key = mix64(seed) + e * 2 + side;
            const std::uint32_t points = cut ? kPoints : 1;
            const float share = 1.0F / static_cast<float>(points);
            for (std::uint32_t i = 0; i < points; ++i) {
                PhotonRandom random(key, i);
                const SobolPoint u = sobol_point(i, mix64(key));
                const auto root = static_cast<float>(std::sqrt(u.u)); // areas kept
                const auto v = static_cast<float>(u.v);
                const std::array<float, 3> weights{1.0F - root, root * (1.0F - v), root * v};
                Vec3f p;
                for (std::size_t k = 0; k < 3; ++k) {
                    p += corners[k] * weights[k];
                }
                const Vec3f from = p + normal * caster.offset(p, 0.0F);
                bool visible = false;
                for (int t = 0; t < kTries && !visible; ++t) {
                    visible = meets_light({from, cosine_direction(normal, random)});
                }
                if (!visible) {
                    Covered& c = covered[e][side];
                    const auto most = std::ranges::max_element(weights) - weights.begin();
                    c.nearest[static_cast<std::size_t>(most)] += share;
                    for (std::size_t k = 0; k < 3; ++k) {
                        c.linear[k] += weights[k] * share;
                    }
                }
            }
        }
    };
    parallel_blocks(threads, std::size_t{0}, mesh.elements.size(), std::size_t{64},
                    [&](std::size_t begin, std::size_t end) {
                        for (std::size_t e = begin; e < end; ++e) {
                            look(e);
                        }
                    });
    VisibleArea out{std::vector<float>(mesh.areas.size(), 1.0F),
                    std::vector<float>(mesh.areas.size(), 1.0F)};
    for (std::size_t e = 0; e < covered.size(); ++e) {
        const MeshElement& element = mesh.elements[e];
        const double area = mesh.area(element);
        const std::int32_t back = std::max(0, mesh.surface(element).back_offset);
        for (std::size_t side = 0; side < 2; ++side) {
            for (std::size_t k = 0; k < 3; ++k) {
                const std::int32_t v = element.vertices[k] + (side == 0 ? 0 : back);
                if (mesh.areas[v] > 0.0) {
                    const auto share = static_cast<float>(area / mesh.areas[v]);
                    out.nearest[v] -= share * covered[e][side].nearest[k];
                    out.linear[v] -= share * covered[e][side].linear[k];
                }
            }
        }
    }
    for (std::size_t v = 0; v < mesh.areas.size(); ++v) {
        out.nearest[v] = std::max(0.0F, out.nearest[v]);
        out.linear[v] = std::max(0.0F, out.linear[v]);
    }
    return out;
}

} // namespace isolux
