#include "core/enclosed_light.h"

#include <algorithm>
#include <optional>

#include "core/sampling.h"

namespace isolux {
namespace {

// Ways that light may take from a luminaire, and reflections on each: a slit of a hundredth of the
// enclosure's surface is missed once in 10^17.
constexpr std::uint64_t kWays = 200;
constexpr int kReflections = 20;
// m³. Luminaires are smaller, rooms are larger: in both light stays, and only there it is news.
constexpr double kLargestFixture = 0.2;

struct Box {
    Vec3d low, high;

    void add(const Vec3d& p) {
        low = {std::min(low.x, p.x), std::min(low.y, p.y), std::min(low.z, p.z)};
        high = {std::max(high.x, p.x), std::max(high.y, p.y), std::max(high.z, p.z)};
    }
    Vec3d size() const { return high - low; }
    double volume() const { return size().x * size().y * size().z; }
    bool holds(const Vec3d& p) const {
        return p.x >= low.x && p.y >= low.y && p.z >= low.z && p.x <= high.x && p.y <= high.y &&
               p.z <= high.z;
    }
};

// The box of all that the light meets; none where some gets away. hits : by mesh
std::optional<Box> enclosure(const Scene& scene, const Luminaire& luminaire,
                             std::vector<int>& hits) {
    const RayCaster& caster = scene.ray_caster();
    Box box{luminaire.position, luminaire.position};
    for (std::uint64_t way = 0; way < kWays; ++way) {
        PhotonRandom random(0, way);
        const Emission emission = luminaire.sample_emission(random);
        const Vec3f start = (emission.origin - caster.origin()).as<float>();
        Ray ray{start, emission.direction.as<float>()};
        ray.origin += luminaire.clearance(ray.direction) * caster.offset(start, 0.0F);
        for (int i = 0; i <= kReflections; ++i) {
            const Hit hit = caster.closest_hit(ray);
            if (hit.triangle == kNoHit) {
                return std::nullopt;
            }
            const Vec3f p = ray.origin + ray.direction * hit.distance;
            box.add(p.as<double>() + caster.origin());
            if (box.volume() > kLargestFixture) {
                return std::nullopt;
            }
            const Surface& surface =
                scene.mesh().surface(scene.mesh().elements[static_cast<std::size_t>(hit.triangle)]);
            Vec3f normal = normalize(hit.normal);
            if (dot(ray.direction, normal) > 0.0F) {
                if (surface.back_offset < 0) {
                    break; // told of as a mesh turned inside out
                }
                normal = -normal;
            }
            ++hits[static_cast<std::size_t>(surface.mesh)];
            ray = {p + normal * caster.offset(p, hit.distance), cosine_direction(normal, random)};
        }
    }
    return box;
}

} // namespace

std::vector<EnclosedLight> enclosed_lights(const Scene& scene) {
    std::vector<EnclosedLight> out;
    std::vector<int> hits;
    for (const Luminaire& luminaire : scene.luminaires()) {
        const bool on_mesh = std::holds_alternative<TriangleLuminaire>(luminaire.shape);
        if (luminaire.is_infinite() || on_mesh || luminaire.links != nullptr) {
            continue;
        }
        hits.assign(scene.mesh().meshes.size(), 0);
        const auto box = enclosure(scene, luminaire, hits);
        const auto most = std::ranges::max_element(hits);
        if (!box || *most == 0) {
            continue;
        }
        const auto elsewhere = [&](const MeshRange& mesh) {
            const auto points = scene.mesh().positions.begin();
            return std::none_of(points + mesh.front_begin, points + mesh.front_end,
                                [&](const Vec3d& p) { return box->holds(p); });
        };
        if (std::ranges::any_of(scene.mesh().meshes, elsewhere)) {
            out.push_back(
                {luminaire.position, box->size(), static_cast<std::int32_t>(most - hits.begin())});
        }
    }
    return out;
}

} // namespace isolux
