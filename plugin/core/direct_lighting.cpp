#include "core/direct_lighting.h"

#include <atomic>
#include <bit>
#include <cmath>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include "core/random.h"
#include "core/sobol.h"

namespace isolux {
namespace {

constexpr std::uint32_t kShadowRays = 16;

std::uint64_t position_key(const Vec3d& p) {
    return mix64(
        std::bit_cast<std::uint64_t>(p.x) ^
        mix64(std::bit_cast<std::uint64_t>(p.y) ^ mix64(std::bit_cast<std::uint64_t>(p.z))));
}

} // namespace

DirectLighting::DirectLighting(const Scene& scene, const DirectLightingSettings& settings)
    : scene_(scene), settings_(settings) {}

DirectIllumination DirectLighting::illuminate(std::span<const Receiver> receivers,
                                              std::span<const float>, int threads) const {
    DirectIllumination out{std::vector<Vec3f>(receivers.size()),
                           std::vector<float>(receivers.size())};
    std::atomic<std::uint64_t> shadow_rays{0};
    const RayCaster& caster = scene_.ray_caster();
    const auto illuminate_one = [&](std::size_t i) {
        const Receiver& receiver = receivers[i];
        const Vec3f local = (receiver.position - caster.origin()).as<float>();
        const Vec3f from = local + receiver.normal * caster.offset(local, 0.0F);
        const std::uint64_t key = position_key(receiver.position) ^ mix64(settings_.seed);
        std::uint64_t rays = 0, index = 0;
        Vec3f sum;
        double variance = 0.0;
        for (const Luminaire& luminaire : scene_.luminaires()) {
            const std::uint64_t scramble = mix64(key + ++index);
            double mean = 0.0, square = 0.0;
            for (std::uint32_t k = 0; k < kShadowRays; ++k) {
                const auto [u, v] = sobol_point(k, scramble);
                const ShadowSample sample = shadow_sample(luminaire, receiver, u, v);
                if (sample.illuminance <= 0.0) {
                    continue;
                }
                ++rays;
                const Vec3f to = (sample.point - caster.origin()).as<float>() - from;
                if (!caster.occluded({from, to}, 1.0F - 0x1p-12F)) {
                    mean += sample.illuminance / kShadowRays;
                    square += sample.illuminance * sample.illuminance / kShadowRays;
                }
            }
            sum += luminaire.colour * static_cast<float>(mean);
            variance += (square - mean * mean) / kShadowRays;
        }
        out.illuminance[i] = sum;
        out.standard_error[i] = static_cast<float>(std::sqrt(std::max(0.0, variance)));
        shadow_rays += rays;
    };
    tbb::task_arena(threads).execute(
        [&] { tbb::parallel_for(std::size_t{0}, receivers.size(), illuminate_one); });
    out.shadow_rays = shadow_rays;
    return out;
}

} // namespace isolux
