#include "core/buried_receivers.h"

#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "core/coincident_surfaces.h"
#include "core/parallel.h"
#include "core/random.h"
#include "core/sampling.h"

namespace isolux {
namespace {

// Rays that tell a buried vertex: by the backs that some meet, and the light that few could bring,
// as within a body may be others.
constexpr std::uint32_t kRays = 8, kLeastBacks = 2, kMostLit = 2;
// In tangents and normal, unnormalized: across most bodies, few of which lie askew.
constexpr float kFirst[] = {0.8F, 0.6F, 1.0F};

class Burial {
  public:
    Burial(const IlluminationMesh& mesh, const RayCaster& caster, bool lit_from_afar)
        : mesh_(mesh), caster_(caster), lit_from_afar_(lit_from_afar) {}

    bool operator()(const Receiver& receiver, std::uint64_t key) const {
        const Vec3f at = (receiver.position - caster_.origin()).as<float>();
        const Vec3f from = at + receiver.normal * caster_.offset(at, 0.0F);
        const auto [s, t] = tangents(receiver.normal);
        const Vec3f first = s * kFirst[0] + t * kFirst[1] + receiver.normal * kFirst[2];
        // One direction of all neighbours: such rays are traced the fastest.
        if (meets({from, normalize(first)}) == Met::light) {
            return false;
        }
        std::uint32_t backs = 0, lit = 0;
        for (std::uint32_t i = 0; i < kRays && lit <= kMostLit; ++i) {
            PhotonRandom random(key, i);
            const Met met = meets({from, cosine_direction(receiver.normal, random)});
            backs += met == Met::back ? 1 : 0;
            lit += met == Met::light ? 1 : 0;
        }
        return backs >= kLeastBacks && lit <= kMostLit;
    }

  private:
    enum class Met : std::uint8_t { back, nothing, light }; // that absorbs; may bring light

    Met meets(const Ray& ray) const {
        Hit hit = caster_.closest_hit(ray);
        if (hit.triangle == kNoHit) {
            return lit_from_afar_ ? Met::light : Met::nothing;
        }
        if (dot(ray.direction, hit.normal) > 0.0F) {
            hit = facing_hit(mesh_, caster_, ray, hit);
        }
        const bool at_back = dot(ray.direction, hit.normal) > 0.0F;
        return at_back && mesh_.one_sided(hit.triangle) ? Met::back : Met::light;
    }

    const IlluminationMesh& mesh_;
    const RayCaster& caster_;
    bool lit_from_afar_;
};

} // namespace

BuriedReceivers buried_receivers(const IlluminationMesh& mesh, const IlluminationMesh& traced,
                                 const RayCaster& caster, std::span<const Receiver> receivers,
                                 bool lit_from_afar, int threads) {
    const Burial is_buried(traced, caster, lit_from_afar);
    std::vector<std::uint8_t> buried(receivers.size());
    parallel_blocks(threads, std::size_t{0}, receivers.size(), std::size_t{256},
                    [&](std::size_t begin, std::size_t end) {
                        for (std::size_t v = begin; v < end; ++v) {
                            buried[v] = mesh.areas[v] > 0.0 && is_buried(receivers[v], v);
                        }
                    });
    // From a vertex in the light towards a buried one, to what covers that.
    std::vector<double> nearest(receivers.size(), std::numeric_limits<double>::max());
    std::vector<Receiver> out(receivers.begin(), receivers.end());
    std::vector<std::int32_t> from(receivers.size());
    const auto come_out = [&](std::int32_t v, std::int32_t lit) {
        const Vec3f at = (receivers[lit].position - caster.origin()).as<float>();
        // Kept in the place found: an edge that leaves the surface in a cover's own plane goes
        // below that at once, and a place on the edge itself would be below, too.
        const Vec3d lift = (mesh.normals[lit] * caster.offset(at, 0.0F)).as<double>();
        const Vec3d start = receivers[lit].position + lift;
        const Vec3d along = mesh.positions[v] - receivers[lit].position;
        const Hit hit =
            caster.closest_hit({(start - caster.origin()).as<float>(), along.as<float>()});
        if (hit.triangle == kNoHit || hit.distance >= 1.0F) {
            return;
        }
        const double share = static_cast<double>(hit.distance) * (1.0 - kReceiverInset);
        const double left = (1.0 - share) * std::sqrt(dot(along, along));
        if (left < nearest[v]) {
            nearest[v] = left;
            out[v].position = start + along * share;
            from[v] = lit;
        }
    };
    for_each_side(mesh, [&](const MeshElement&, const auto& vertices) {
        for (const std::int32_t v : vertices) {
            for (const std::int32_t lit : vertices) {
                if (buried[v] != 0 && buried[lit] == 0) {
                    come_out(v, lit);
                }
            }
        }
    });
    BuriedReceivers buried_ones;
    for (std::size_t v = 0; v < out.size(); ++v) {
        if (nearest[v] < std::numeric_limits<double>::max()) {
            buried_ones.placed.vertices.push_back(static_cast<std::int32_t>(v));
            buried_ones.placed.receivers.push_back(out[v]);
            buried_ones.lit.push_back(from[v]);
        }
    }
    return buried_ones;
}

} // namespace isolux
