#include "core/sky_lighting.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>
#include <span>

#include "core/random.h"
#include "core/sampling.h"
#include "core/sobol.h"

namespace isolux {
namespace {

constexpr double kPi = std::numbers::pi;
// Directions from a receiver, powers of 2: at first, and at most.
constexpr std::uint32_t kFirstSamples = 64, kMostSamples = 1024;
// Variance that n directions that agree leave open, times n³, in units of the squared illuminance:
// two edges for each radian of a dome, of which ShadowTesting's figure is missed.
constexpr double kMissedVariance = 1.0;
// Half the angle of a cone from which on its shadow rays are counted like a dome's, rad.
constexpr double kWide = 0.05;

} // namespace

SkyLighting::SkyLighting(const Luminaire& luminaire, const RayCaster& caster)
    : luminaire_(luminaire), distant_(std::get_if<DistantLuminaire>(&luminaire.shape)),
      dome_(std::get_if<DomeLuminaire>(&luminaire.shape)), caster_(caster) {}

bool SkyLighting::is_wide(const Luminaire& luminaire) {
    const auto* distant = std::get_if<DistantLuminaire>(&luminaire.shape);
    return distant != nullptr ? distant->half_angle > kWide
                              : std::holds_alternative<DomeLuminaire>(luminaire.shape);
}

SkyLighting::Found SkyLighting::illuminate(const Receiver& receiver, std::uint64_t key,
                                           const std::function<double(double)>& allowed) {
    const Vec3d normal = receiver.normal.as<double>();
    const Vec3d unoccluded =
        distant_ != nullptr
            ? luminaire_.colour.as<double>() * distant_->illuminance(luminaire_.z, normal)
            : dome_->luminance->illuminance(luminaire_.to_local(normal));
    if (luminance(unoccluded) <= 0.0 || !luminaire_.lights(receiver.mesh)) {
        return {};
    }
    samples_.clear();
    cells_.clear();
    Found found;
    std::uint64_t shadow_rays = 0;
    for (std::uint32_t count = kFirstSamples; count <= kMostSamples; count *= 2) {
        add_samples(receiver, mix64(key + mix64(~std::uint64_t{0})), count);
        shadow_rays += rays_.size();
        found = estimate(unoccluded);
        const double limit = allowed(luminance(found.illuminance));
        if (found.variance <= limit * limit) {
            break;
        }
    }
    found.shadow_rays = shadow_rays;
    return found;
}

SkyLighting::Direction SkyLighting::distant_direction(const Vec3d& normal, double u,
                                                      double v) const {
    const Vec3d to_light = distant_->direction(luminaire_.z, u, v);
    const double weight = std::max(0.0, dot(to_light, normal));
    return {to_light, luminaire_.colour * static_cast<float>(weight)};
}

// The first half of the square is for directions by cosine, the other for those by luminance; each
// counts by the density of both.
SkyLighting::Direction SkyLighting::dome_direction(const Vec3d& normal, double u, double v) const {
    const DomeLuminance& map = *dome_->luminance;
    const bool by_cosine = map.is_constant() || u < 0.5;
    Vec3d direction; // world space
    Vec3f colour;
    double density = 0.0;
    if (by_cosine) {
        const double share = map.is_constant() ? u : 2.0 * u;
        const double r = std::sqrt(share);
        const auto [s, t] = tangents(normal);
        direction = s * (r * std::cos(2.0 * kPi * v)) + t * (r * std::sin(2.0 * kPi * v)) +
                    normal * std::sqrt(1.0 - share);
        colour = map.luminance(luminaire_.to_local(direction));
        density = static_cast<double>(luminance(colour)) / luminance(map.flux_density());
    } else {
        const auto sample = map.sample(2.0 * u - 1.0, v);
        direction = luminaire_.to_world(sample.direction);
        colour = sample.luminance;
        density = sample.density;
    }
    const double cosine = std::max(0.0, dot(direction, normal));
    density = map.is_constant() ? cosine / kPi : 0.5 * (density + cosine / kPi);
    return {direction, colour * static_cast<float>(cosine > 0.0 ? cosine / density : 0.0)};
}

void SkyLighting::add_samples(const Receiver& receiver, std::uint64_t scramble,
                              std::uint32_t count) {
    const Vec3d normal = receiver.normal.as<double>();
    const Vec3f local = (receiver.position - caster_.origin()).as<float>();
    const Vec3f from = local + receiver.normal * caster_.offset(local, 0.0F);
    const SceneEntry& entry = distant_ != nullptr ? *distant_->entry : *dome_->entry;
    rays_.clear();
    of_ray_.clear();
    for (auto i = static_cast<std::uint32_t>(samples_.size()); i < count; ++i) {
        const auto [u, v] = sobol_point(i, scramble);
        const auto [to_light, light] =
            distant_ != nullptr ? distant_direction(normal, u, v) : dome_direction(normal, u, v);
        samples_.push_back({light, 0.0F});
        if (light != Vec3f{}) {
            const Vec3d end = entry.beyond(receiver.position, to_light);
            rays_.push_back(
                {from, (end - receiver.position).as<float>(), 0.0F, luminaire_.shadow_meshes()});
            of_ray_.push_back(i);
        }
    }
    transmitted_.resize(rays_.size());
    caster_.transmitted(rays_, transmitted_);
    for (std::size_t k = 0; k < rays_.size(); ++k) {
        samples_[of_ray_[k]].seen = transmitted_[k];
    }
    // Each cell of this grid holds one of the points.
    const auto bits = static_cast<std::uint32_t>(std::countr_zero(count));
    columns_ = std::uint32_t{1} << (bits + 1) / 2;
    const double rows = std::uint32_t{1} << bits / 2;
    cells_.resize(count);
    for (std::uint32_t i = 0; i < count; ++i) {
        const auto [u, v] = sobol_point(i, scramble);
        cells_[i] = static_cast<std::uint32_t>(v * rows) * columns_ +
                    static_cast<std::uint32_t>(u * columns_);
    }
}

// The variance of a stratified sum by the contrasts of two by two neighbouring strata, which what
// changes evenly along a row or a column of them has no part in [after collapsed strata, Cochran
// 1977, §5A.12]: no less than the true one.
SkyLighting::Found SkyLighting::estimate(const Vec3d& unoccluded) {
    Vec3d all, seen;
    for (const Sample& sample : samples_) {
        all += sample.light.as<double>();
        seen += sample.light.as<double>() * static_cast<double>(sample.seen);
    }
    const auto share = [](double part, double whole) { return whole > 0.0 ? part / whole : 0.0; };
    const Vec3d visible{share(seen.x, all.x), share(seen.y, all.y), share(seen.z, all.z)};
    const Vec3d scale{share(unoccluded.x, all.x), share(unoccluded.y, all.y),
                      share(unoccluded.z, all.z)};
    deviations_.resize(samples_.size());
    for (std::size_t i = 0; i < samples_.size(); ++i) {
        const auto part = static_cast<double>(samples_[i].seen);
        const Vec3d off = Vec3d{part, part, part} - visible;
        deviations_[cells_[i]] = luminance(samples_[i].light.as<double>() * scale * off);
    }
    Found out;
    out.illuminance = unoccluded * visible;
    const std::size_t columns = columns_;
    for (std::size_t row = 0; row < deviations_.size(); row += 2 * columns) {
        for (std::size_t i = row; i < row + columns; i += 2) {
            const double contrast = deviations_[i] - deviations_[i + 1] - deviations_[i + columns] +
                                    deviations_[i + columns + 1];
            out.variance += contrast * contrast;
        }
    }
    const double n = static_cast<double>(samples_.size());
    const double whole = luminance(unoccluded);
    out.variance += kMissedVariance * whole * whole / (n * n * n);
    return out;
}

} // namespace isolux
