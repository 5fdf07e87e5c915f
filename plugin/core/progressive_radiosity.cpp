#include "core/progressive_radiosity.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cassert>
#include <cmath>
#include <numbers>

#include "core/coincident_surfaces.h"
#include "core/parallel.h"
#include "core/random.h"
#include "core/sampling.h"
#include "core/sobol.h"

namespace isolux {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kLeaves = 6000.0;
// Of what remains unshot, of the accuracy: small beside what visibility leaves open.
constexpr double kTruncation = 0.1;
// Tolerance of one interaction, of the accuracy times the mean illuminance: errors of the some
// hundred interactions of a receiver are independent for the most part.
constexpr double kInteraction = 0.25;

// Directions from each leaf that tell how much of its light is lost: thousands of leaves together
// know it far better than each.
constexpr std::uint32_t kLossRays = 16;

// The share of a leaf that gives off light: a sieve does where it stops it, and of surfaces in one
// place the first does.
double solid_share(const RadiosityNode& leaf, const Surface& surface) {
    return leaf.owned * static_cast<double>(surface.opacity);
}
Vec3d reflected(const RadiosityNode& leaf, const Surface& surface, const Vec3d& illuminance) {
    return surface.reflectance.as<double>() * illuminance * solid_share(leaf, surface);
}

NodeExitance exitance_of(const Vec3d& colour) {
    return {colour, luminance(colour), luminance(colour)};
}

std::uint64_t position_key(const Receiver& receiver) {
    const auto bits = [](double x) { return std::bit_cast<std::uint64_t>(x); };
    const Vec3d& p = receiver.position;
    const Vec3d n = receiver.normal.as<double>();
    std::uint64_t key = 0;
    for (const double x : {p.x, p.y, p.z, n.x, n.y, n.z}) {
        key = mix64(key + bits(x));
    }
    return key;
}

} // namespace

ProgressiveRadiosity::ProgressiveRadiosity(const Scene& scene, const RadiositySettings& settings)
    : scene_(scene), settings_(settings), hierarchy_(radiosity_hierarchy(scene, kLeaves)) {
    begin(std::vector<Vec3f>(hierarchy_.leaves.size()));
}

std::vector<Receiver> ProgressiveRadiosity::receivers() const {
    std::vector<Receiver> out(hierarchy_.leaves.size());
    std::ranges::transform(hierarchy_.leaves, out.begin(), [this](std::int32_t leaf) {
        const RadiosityNode& node = hierarchy_.nodes[leaf];
        const Surface& surface = scene_.mesh().surfaces[static_cast<std::size_t>(node.surface)];
        return Receiver{node.centre, node.normal.as<float>(), surface.mesh};
    });
    return out;
}

void ProgressiveRadiosity::begin(std::span<const Vec3f> direct) {
    assert(direct.size() == hierarchy_.leaves.size());
    progress_ = {};
    sweep_ = 0;
    unshot_.assign(hierarchy_.nodes.size(), {});
    double area = 0.0, absorbed = 0.0, incident = 0.0;
    for (std::size_t i = 0; i < direct.size(); ++i) {
        const RadiosityNode& leaf = hierarchy_.nodes[hierarchy_.leaves[i]];
        const Surface& surface = scene_.mesh().surfaces[static_cast<std::size_t>(leaf.surface)];
        const double solid = leaf.area * solid_share(leaf, surface);
        unshot_[hierarchy_.leaves[i]] =
            exitance_of(reflected(leaf, surface, direct[i].as<double>()));
        area += leaf.area;
        incident += solid;
        absorbed += solid * (1.0 - static_cast<double>(luminance(surface.reflectance)));
    }
    pull(unshot_);
    total_ = unshot_;
    decay_ = incident > 0.0 ? 1.0 - absorbed / incident : 0.0;
    const double first = flux(unshot_);
    scale_ = area > 0.0 ? first / (area * std::max(1e-3, 1.0 - decay_)) : 0.0;
    progress_.finished = first <= 0.0;
    progress_.unshot = first > 0.0 ? 1.0 : 0.0;
}

ShootingProgress ProgressiveRadiosity::advance(std::uint64_t ray_budget, int threads) {
    const std::uint64_t end = progress_.rays + ray_budget;
    if (lost_.empty() && !progress_.finished) {
        find_losses(threads);
    }
    while (!progress_.finished) {
        const double before = flux(unshot_);
        // Late sweeps carry little; their errors add up like the light they carry.
        const double share = before / (progress_.shot_flux + before);
        const double tolerance = kInteraction * settings_.accuracy * scale_ * std::sqrt(share);
        const RadiosityExchange exchange(scene_, hierarchy_, unshot_, tolerance,
                                         settings_.seed + mix64(++sweep_));
        received_.assign(hierarchy_.nodes.size(), {});
        std::atomic<std::uint64_t> rays{0};
        parallel_for(threads, hierarchy_.element_sides.size(), [&](std::size_t i) {
            std::uint64_t own = 0;
            exchange.onto(hierarchy_.element_sides[i], received_, own);
            rays += own;
        });
        Vec3d shot, received, lost; // lm by channel
        for (std::size_t i = 0; i < hierarchy_.leaves.size(); ++i) {
            const std::int32_t leaf = hierarchy_.leaves[i];
            const Vec3d leaving = unshot_[leaf].mean * hierarchy_.nodes[leaf].area;
            shot += leaving;
            lost += leaving * lost_[i];
            const RadiosityNode& node = hierarchy_.nodes[leaf];
            const Surface& surface = scene_.mesh().surfaces[static_cast<std::size_t>(node.surface)];
            received += received_[leaf] * (node.area * solid_share(node, surface));
        }
        // Departure: what is received is made to fit what is shot and not lost, so that errors of
        // a tenth of a percent don't grow to percents where light is reflected twenty times
        // (tests/physics/test_radiosity.py, reflectance 0.95).
        const auto fit = [](double wanted, double found) {
            return found > 0.0 ? wanted / found : 1.0;
        };
        const Vec3d balance{fit(shot.x - lost.x, received.x), fit(shot.y - lost.y, received.y),
                            fit(shot.z - lost.z, received.z)};
        for (const std::int32_t leaf : hierarchy_.leaves) {
            const RadiosityNode& node = hierarchy_.nodes[leaf];
            const Surface& surface = scene_.mesh().surfaces[static_cast<std::size_t>(node.surface)];
            unshot_[leaf] = exitance_of(reflected(node, surface, received_[leaf] * balance));
            total_[leaf] = exitance_of(total_[leaf].mean + unshot_[leaf].mean);
        }
        pull(unshot_);
        const double after = flux(unshot_);
        decay_ = std::min(after / before, 1.0 - 1e-6);
        progress_.shot_flux += before;
        progress_.lost_flux += luminance(lost);
        progress_.received_flux += luminance(received);
        progress_.rays += rays;
        // What later reflections make of it counts, too.
        const double rest = after / (1.0 - decay_);
        progress_.unshot = rest / (progress_.shot_flux + rest);
        progress_.finished = progress_.unshot * decay_ <= kTruncation * settings_.accuracy;
        if (progress_.rays >= end) {
            break;
        }
    }
    pull(total_);
    return progress_;
}

std::vector<Vec3f> ProgressiveRadiosity::exitance() const {
    std::vector<Vec3f> out(hierarchy_.leaves.size());
    std::ranges::transform(hierarchy_.leaves, out.begin(),
                           [this](std::int32_t leaf) { return total_[leaf].mean.as<float>(); });
    return out;
}

IndirectIllumination ProgressiveRadiosity::indirect(std::span<const Receiver> receivers,
                                                    int threads) const {
    IndirectIllumination out{std::vector<Vec3f>(receivers.size()),
                             std::vector<float>(receivers.size())};
    const double tolerance = kInteraction * settings_.accuracy * scale_;
    const RadiosityExchange exchange(scene_, hierarchy_, total_, tolerance, settings_.seed);
    const double area = hierarchy_.nodes.empty() ? 1.0 : hierarchy_.nodes.front().area;
    const double truncated = flux(unshot_) * decay_ / ((1.0 - decay_) * area);
    std::atomic<std::uint64_t> rays{0};
    const auto illuminate = [&](std::size_t i) {
        if (dot(receivers[i].normal, receivers[i].normal) == 0.0F) {
            return; // of a degenerate element
        }
        std::uint64_t own = 0;
        const PointIlluminance found =
            exchange.at_point(receivers[i], position_key(receivers[i]), own);
        rays += own;
        out.illuminance[i] = found.illuminance.as<float>();
        const double leaves = luminance(found.unevenness);
        out.standard_error[i] =
            static_cast<float>(std::sqrt(found.variance + leaves * leaves + truncated * truncated));
    };
    if (!hierarchy_.nodes.empty()) {
        parallel_for(threads, receivers.size(), illuminate);
    }
    out.rays = rays;
    return out;
}

void ProgressiveRadiosity::find_losses(int threads) {
    lost_.resize(hierarchy_.leaves.size());
    const RayCaster& caster = scene_.ray_caster();
    const auto find = [&](std::size_t i) {
        const RadiosityNode& leaf = hierarchy_.nodes[hierarchy_.leaves[i]];
        const Vec3f normal = leaf.normal.as<float>();
        const auto [s, t] = tangents(leaf.normal);
        const std::uint64_t scramble = mix64(mix64(settings_.seed + 1) + i);
        std::uint32_t lost = 0;
        for (std::uint32_t k = 0; k < kLossRays; ++k) {
            const auto [u, v] = sobol_point(k, scramble);
            const auto [at_u, at_v] = sobol_point(k, ~scramble);
            const double root = std::sqrt(at_u), sine = std::sqrt(u), turn = 2.0 * kPi * v;
            const auto& [a, b, c] = leaf.corners;
            const Vec3d at = a * (1.0 - root) + b * (root * (1.0 - at_v)) + c * (root * at_v);
            const Vec3d direction = s * (sine * std::cos(turn)) + t * (sine * std::sin(turn)) +
                                    leaf.normal * std::sqrt(1.0 - u);
            const Vec3f local = (at - caster.origin()).as<float>();
            const Ray ray{local + normal * caster.offset(local, 0.0F), direction.as<float>()};
            Hit hit = caster.closest_hit(ray);
            if (hit.triangle != kNoHit) {
                hit = facing_hit(scene_.mesh(), caster, ray, hit);
            }
            const bool back =
                hit.triangle != kNoHit && dot(hit.normal.as<double>(), direction) > 0.0;
            lost +=
                hit.triangle == kNoHit || (back && scene_.mesh().one_sided(hit.triangle)) ? 1 : 0;
        }
        lost_[i] = static_cast<double>(lost) / kLossRays;
    };
    parallel_for(threads, lost_.size(), find);
    progress_.rays += lost_.size() * kLossRays;
}

// From the leaves to all nodes.
void ProgressiveRadiosity::pull(std::vector<NodeExitance>& exitance) const {
    for (std::size_t i = hierarchy_.nodes.size(); i-- > 0;) {
        const RadiosityNode& node = hierarchy_.nodes[i];
        if (node.leaf()) {
            continue;
        }
        const std::int32_t child = node.first_child;
        NodeExitance sum{{}, exitance[child].low, exitance[child].high};
        for (std::int32_t k = child; k < child + node.child_count(); ++k) {
            sum.mean += exitance[k].mean * (hierarchy_.nodes[k].area / node.area);
            sum.low = std::min(sum.low, exitance[k].low);
            sum.high = std::max(sum.high, exitance[k].high);
        }
        exitance[i] = sum;
    }
}

// lm, photometric
double ProgressiveRadiosity::flux(const std::vector<NodeExitance>& exitance) const {
    return hierarchy_.nodes.empty()
               ? 0.0
               : luminance(exitance.front().mean) * hierarchy_.nodes.front().area;
}

} // namespace isolux
