#include "core/joined_illuminance.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace isolux {
namespace {

// Square deviation of photons from what is known, in their variances, that is put down to chance.
constexpr double kChance = 2.0;
// The same in squares of one photon. Where few photons are expected, two or three that meet by
// chance deviate by many variances: at λ expected ones two come with λ²/2, and believed by half
// they leave a square error of half the light's own, however small λ is. With this it is 1 % at
// most, at any λ.
constexpr double kFewPhotons = 8.0;
// Photons that a side of a mesh is thought to have beside its own, as many as are expected, where
// its own differ from what is known by no more than chance.
constexpr double kPhotonsOfSide = 1000.0;
// Visible share of a bucket, below which its photons say nothing of the light beside.
constexpr double kLeastVisible = 0.125;
// Independent points that would tell the visible share as well as those of a sequence.
constexpr double kVisiblePoints = 256.0;
// Of a mesh, by the axis that they face along, both ways.
constexpr std::size_t kSides = 6;

} // namespace

std::size_t mesh_side_count(const IlluminationMesh& mesh) { return kSides * mesh.meshes.size(); }

std::size_t mesh_side(const Receiver& receiver) {
    const Vec3f& n = receiver.normal;
    const float x = std::abs(n.x), y = std::abs(n.y), z = std::abs(n.z);
    const std::size_t axis = x >= y && x >= z ? 0U : (y >= z ? 1U : 2U);
    const float along = std::array{n.x, n.y, n.z}[axis];
    return kSides * static_cast<std::size_t>(receiver.mesh) + 2 * axis + (along < 0.0F ? 1U : 0U);
}

JoinedIlluminance joined_illuminance(const IlluminationMesh& mesh,
                                     std::span<const Receiver> receivers,
                                     std::span<const std::int32_t> lit, const VisibleArea& visible,
                                     const TwoEstimates& light) {
    const auto& [counted, photon_flux, known, variance] = light;
    const std::vector<double>& areas = mesh.areas;
    const std::size_t sides = mesh_side_count(mesh);
    JoinedIlluminance joined_light{
        {known.begin(), known.end()}, {variance.begin(), variance.end()}, {}};
    joined_light.side_flux.resize(sides);
    auto& [out, square_errors, side_flux] = joined_light;
    std::vector<std::array<double, 2>> flux(sides); // lm: counted, joined
    for (const std::int32_t v : lit) {
        const double nearest = visible.nearest.empty() ? 1.0 : visible.nearest[v];
        const Vec3f found = counted[v] * static_cast<float>(nearest > 0.0 ? 1.0 / nearest : 0.0);
        const double n = luminance(found.as<double>()), k = luminance(out[v].as<double>());
        if (nearest >= kLeastVisible) {
            const double photon = photon_flux / (areas[v] * nearest); // lx
            // Of the known light, lest low counts seem surer than high ones; and of one more.
            const double chance =
                (k + photon) * photon + k * k * (1.0 - nearest) / (nearest * kVisiblePoints);
            const double both = chance + variance[v];
            const double square = (n - k) * (n - k);
            const double plausible = kChance * both + kFewPhotons * photon * photon;
            const double by_chance = square > plausible ? plausible / square : 1.0;
            const double best = both > 0.0 ? variance[v] / both : 1.0; // share of the photons
            const double share = 1.0 - (1.0 - best) * by_chance;
            out[v] += (found - out[v]) * static_cast<float>(share);
            // What photons change by chance: beyond it the share changes with them, but together
            // they change no more than they do.
            const double slope = by_chance < 1.0 ? 2.0 - share : share;
            const double changed = by_chance < 1.0 ? square : chance;
            square_errors[v] = std::min(slope * slope * chance, share * share * changed) +
                               (1.0 - share) * (1.0 - share) * variance[v];
        }
        auto& [all, joined] = flux[mesh_side(receivers[v])];
        all += areas[v] * luminance(counted[v].as<double>());
        const double linear = visible.linear.empty() ? 1.0 : visible.linear[v];
        joined += areas[v] * linear * luminance(out[v].as<double>());
    }
    std::vector<float> scale(sides);
    for (std::size_t side = 0; side < sides; ++side) {
        const auto [all, joined] = flux[side];
        const double square = (all - joined) * (all - joined);
        const double chance = kChance * (joined + photon_flux) * photon_flux;
        const double by_chance = square > chance ? chance / square : 1.0;
        const double prior = by_chance * kPhotonsOfSide * photon_flux;
        side_flux[side] = joined + prior;
        scale[side] = static_cast<float>(joined > 0.0 ? (all + prior) / (joined + prior) : 1.0);
    }
    for (const std::int32_t v : lit) {
        out[v] = out[v] * scale[mesh_side(receivers[v])];
    }
    return joined_light;
}

} // namespace isolux
