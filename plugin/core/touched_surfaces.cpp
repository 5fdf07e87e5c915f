#include "core/touched_surfaces.h"

#include <algorithm>
#include <cmath>

#include "core/sampling.h"

namespace isolux {
namespace {

// Short ways past the point: a few find out whether there is any surface, more find all of them.
constexpr std::uint64_t kFirst = 16, kAll = 128;
// In offsets of a ray from its surface: how far from the point they start, how far aside they pass,
// and how far off a plane the point may be.
constexpr float kStart = 8.0F, kAside = 4.0F, kInPlane = 0.5F;
constexpr float kParallel = 0.999F;

} // namespace

std::vector<Vec3f> touched_surfaces(const RayCaster& caster, const Vec3d& point) {
    const Vec3f at = (point - caster.origin()).as<float>();
    const float offset = caster.offset(at, 0.0F);
    std::vector<Vec3f> out;
    for (std::uint64_t i = 0; i < (out.empty() ? kFirst : kAll); ++i) {
        PhotonRandom random(0, i);
        const auto direction = uniform_direction<float>(random);
        const auto [a, b, _] = uniform_disk<float>(random);
        const auto [s, t] = tangents(direction);
        const Vec3f from = at + ((s * a + t * b) * kAside - direction * kStart) * offset;
        const Hit hit = caster.closest_hit({from, direction});
        if (hit.triangle == kNoHit || hit.distance > 2.0F * kStart * offset) {
            continue;
        }
        const Vec3f normal = normalize(hit.normal);
        const float height = dot(at - from - direction * hit.distance, normal);
        const auto parallel = [&](const Vec3f& n) { return std::abs(dot(n, normal)) > kParallel; };
        if (std::abs(height) <= kInPlane * offset && std::ranges::none_of(out, parallel)) {
            out.push_back(normal);
        }
    }
    return out;
}

} // namespace isolux
