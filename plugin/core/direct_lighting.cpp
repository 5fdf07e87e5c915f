#include "core/direct_lighting.h"

#include <cmath>

#include "core/parallel.h"

namespace isolux {
namespace {

// So few luminaires are looked at one by one.
constexpr std::size_t kFewLuminaires = 32;

// Luminaires of receivers that what is thought of edges is worth, beside those looked at again.
constexpr double kBelieved = 100.0;

double mean_illuminance(const Scene& scene) {
    double area = 0.0;
    for (const double a : scene.mesh().areas) {
        area += a;
    }
    return area > 0.0 ? scene.luminous_flux() / area : 0.0;
}

} // namespace

DirectLighting::DirectLighting(const Scene& scene, const DirectLightingSettings& settings)
    : sources_{scene, settings.seed, settings.accuracy, mean_illuminance(scene)} {
    for (const bool in_tree : {true, false}) {
        for (const Luminaire& luminaire : scene.luminaires()) {
            const bool plain = luminaire.links == nullptr && !luminaire.is_infinite();
            if (plain == in_tree && !SkyLighting::is_wide(luminaire)) {
                sources_.luminaires.emplace_back(luminaire);
            }
        }
        if (in_tree && sources_.luminaires.size() > kFewLuminaires) {
            sources_.tree.emplace(sources_.luminaires);
            sources_.in_tree = sources_.luminaires.size();
        }
    }
    for (const Luminaire& luminaire : scene.luminaires()) {
        if (SkyLighting::is_wide(luminaire)) {
            sources_.skies.push_back(&luminaire);
        }
    }
}

DirectIllumination DirectLighting::illuminate(std::span<const Receiver> receivers,
                                              std::span<const float> indirect, int threads) const {
    constexpr std::size_t kGrain = 64;
    DirectIllumination out{std::vector<Vec3f>(receivers.size()),
                           std::vector<float>(receivers.size())};
    std::vector<ShadowTesting::Found> all(receivers.size());
    parallel_blocks(
        threads, std::size_t{0}, receivers.size(), kGrain, [&](std::size_t begin, std::size_t end) {
            ShadowTesting testing(sources_);
            for (std::size_t i = begin; i < end; ++i) {
                all[i] = testing.illuminate(receivers[i], indirect.empty() ? 0.0F : indirect[i]);
            }
        });
    // Where one receiver's rays met no edge, those of all tell how often there is one.
    double met = 0.0, angle_tried = 0.0;
    Verified verified;
    for (const ShadowTesting::Found& found : all) {
        met += found.met;
        angle_tried += found.angle_tried;
        verified.missed += found.verified.missed;
        verified.edges += found.verified.edges;
        verified.shares += found.verified.shares;
    }
    double rate = edges_per_radian(met, angle_tried);
    if (verified.edges > 0.0) {
        const double thought = rate * verified.edges;
        const double believed = kBelieved * thought / static_cast<double>(verified.shares);
        rate *= (believed + verified.missed) / (believed + thought);
    }
    for (std::size_t i = 0; i < all.size(); ++i) {
        out.illuminance[i] = all[i].illuminance;
        out.standard_error[i] = static_cast<float>(std::sqrt(all[i].known + rate * all[i].edges));
        out.shadow_rays += all[i].shadow_rays;
    }
    return out;
}

} // namespace isolux
