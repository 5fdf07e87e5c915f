#include "core/direct_lighting.h"

#include <atomic>
#include <bit>
#include <cmath>
#include <memory>
#include <numbers>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include "core/random.h"
#include "core/sobol.h"

namespace isolux {
namespace {

// So few luminaires are looked at one by one.
constexpr std::size_t kFewLuminaires = 32;
// Shadow rays from a receiver to one luminaire, at most.
constexpr std::uint32_t kMostSamples = 1024;
// Points tried, without rays, to find one above the horizon.
constexpr std::uint32_t kHorizonSamples = 64;
// Edges of shadows that a luminaire's image meets, for each radian of its radius: measured in the
// office and the hall, 1 to 4.
constexpr double kEdgesPerRadian = 2.0;
// Variance of the unknown visible share of a luminaire that an edge crosses somewhere: the mean of
// p (1 - p).
constexpr double kEdgeVariance = 1.0 / 6.0;
// Totals below this share of the mean illuminance that the luminaires could give are dark.
constexpr double kDark = 0.1;
// Shares of light whose variance for each shadow ray is at least this part of the largest are
// refined together.
constexpr double kRefinedTogether = 0.25;
// Spread of places in a cluster along one axis, of its radius: a disk's.
constexpr double kSpread = 0.5;
constexpr double kMostClusterVariance = 4.0; // relative

std::uint64_t position_key(const Vec3d& p) {
    return mix64(
        std::bit_cast<std::uint64_t>(p.x) ^
        mix64(std::bit_cast<std::uint64_t>(p.y) ^ mix64(std::bit_cast<std::uint64_t>(p.z))));
}

double mean_illuminance(const Scene& scene) {
    double area = 0.0;
    for (const double a : scene.mesh().areas) {
        area += a;
    }
    return area > 0.0 ? scene.luminous_flux() / area : 0.0;
}

} // namespace

DirectLighting::DirectLighting(const Scene& scene, const DirectLightingSettings& settings)
    : scene_(scene), settings_(settings),
      luminaires_(scene.luminaires().begin(), scene.luminaires().end()),
      least_total_(kDark * mean_illuminance(scene)) {
    if (luminaires_.size() > kFewLuminaires) {
        tree_.emplace(luminaires_);
    }
}

// Light at one receiver after another; keeps its memory.
class DirectLighting::Gathering {
  public:
    explicit Gathering(const DirectLighting& lighting) : lighting_(lighting) {}

    struct Found {
        Vec3f illuminance;
        float standard_error;
        std::uint64_t shadow_rays;
    };
    Found gather(const Receiver& receiver, float indirect);

  private:
    struct Probe {
        std::size_t share;
        double weight;
    };
    // One luminaire's light, or that of a cluster by one of its luminaires.
    struct Share {
        std::int32_t luminaire;
        const LightCluster* cluster; // null: the luminaire alone
        double unoccluded = 0.0;     // lx
        double angle = 0.0;          // rad, radius as seen from the receiver
        double spread = 0.0;         // relative variance of unoccluded light within a cluster
        std::uint32_t samples = 0;   // shadow rays that the sums hold
        std::uint32_t wanted = 1;
        double seen = 0.0, all = 0.0; // sums of weights
        bool mixed = false;           // its sibling's rays met something else
        std::int32_t sibling = -1;    // the other half of a cluster just split
        double variance = 0.0;        // lx²

        double visible() const { return all > 0.0 ? seen / all : 0.0; }
        bool decided() const { return all > 0.0 && (seen == 0.0 || seen == all); }
    };

    void add(std::int32_t luminaire, const LightCluster* cluster);
    void add_sampled(const LightCluster& cluster);
    void split(std::size_t share);
    void cast();
    double variance_of(const Share& share) const;
    bool accurate();
    void refine();

    const DirectLighting& lighting_;
    Receiver receiver_;
    std::uint64_t key_ = 0;
    double indirect_ = 0.0;                // lx
    double direct_ = 0.0, variance_ = 0.0; // lx, lx²
    std::uint64_t shadow_rays_ = 0;
    std::vector<Share> shares_;
    std::vector<Ray> rays_;
    std::vector<Probe> probes_; // one a ray
    std::unique_ptr<bool[]> occluded_;
    std::size_t occluded_size_ = 0;
};

DirectLighting::Gathering::Found DirectLighting::Gathering::gather(const Receiver& receiver,
                                                                   float indirect) {
    receiver_ = receiver;
    key_ = position_key(receiver.position) ^ mix64(lighting_.settings_.seed);
    indirect_ = indirect;
    shadow_rays_ = 0;
    shares_.clear();
    if (receiver.normal == Vec3f{}) {
        return {};
    }
    if (lighting_.tree_) {
        add_sampled(lighting_.tree_->clusters().front());
    } else {
        for (std::size_t i = 0; i < lighting_.luminaires_.size(); ++i) {
            add(static_cast<std::int32_t>(i), nullptr);
        }
    }
    cast();
    while (!accurate()) {
        refine();
        cast();
    }
    Vec3f sum;
    for (const Share& s : shares_) {
        sum += lighting_.luminaires_[s.luminaire].luminaire().colour *
               static_cast<float>(s.unoccluded * s.visible());
    }
    return {sum, static_cast<float>(std::sqrt(variance_)), shadow_rays_};
}

void DirectLighting::Gathering::add(std::int32_t luminaire, const LightCluster* cluster) {
    const LuminaireIlluminance& light = lighting_.luminaires_[luminaire];
    Share share{.luminaire = luminaire, .cluster = cluster};
    share.unoccluded = light.unoccluded(receiver_);
    const Vec3d to =
        (cluster != nullptr ? cluster->centre : light.luminaire().position) - receiver_.position;
    const double radius = cluster != nullptr ? cluster->radius : light.radius();
    const double distance = length(to);
    share.angle = distance > radius ? radius / distance : 0.5 * std::numbers::pi;
    if (cluster != nullptr) {
        share.unoccluded *= cluster->luminous_flux / light.luminaire().luminous_flux;
        const Vec3d normal = receiver_.normal.as<double>();
        const double height = dot(to, normal);
        if (share.unoccluded > 0.0) {
            const double emitted = -dot(to, cluster->axis);
            Vec3d change = to * (-4.0 / (distance * distance)) +
                           normal * (1.0 / std::max(height, 0.1 * radius)) +
                           cluster->axis * (-1.0 / std::max(emitted, 0.1 * radius));
            share.spread = std::min(kMostClusterVariance,
                                    kSpread * kSpread * radius * radius * dot(change, change));
        } else {
            const double nearest = std::max(distance - radius, radius);
            const double most = cluster->luminous_flux / std::numbers::pi *
                                std::min(1.0, (height + radius) / nearest) / (nearest * nearest);
            share.spread = kEdgeVariance * most * most;
        }
    }
    if (share.unoccluded > 0.0 || cluster != nullptr) {
        shares_.push_back(share);
    }
}

void DirectLighting::Gathering::add_sampled(const LightCluster& cluster) {
    if (!may_light(cluster, receiver_)) {
        return;
    }
    const auto node = static_cast<std::uint64_t>(&cluster - lighting_.tree_->clusters().data());
    const double u = static_cast<double>(mix64(key_ + mix64(~node)) >> 11) * 0x1p-53;
    add(lighting_.tree_->choose(cluster, u), cluster.last - cluster.first > 1 ? &cluster : nullptr);
}

// The child that holds the sampled luminaire keeps its shadow rays.
void DirectLighting::Gathering::split(std::size_t index) {
    const Share parent = shares_[index];
    const LightTree& tree = *lighting_.tree_;
    const std::int32_t place = tree.place(parent.luminaire);
    const LightCluster* half[2] = {&tree.clusters()[parent.cluster->children[0]],
                                   &tree.clusters()[parent.cluster->children[1]]};
    if (place >= half[0]->last) {
        std::swap(half[0], half[1]);
    }
    const std::size_t before = shares_.size();
    if (may_light(*half[0], receiver_)) {
        add(parent.luminaire, half[0]->last - half[0]->first > 1 ? half[0] : nullptr);
    }
    const bool kept = shares_.size() > before;
    if (kept) {
        Share& s = shares_.back();
        s.samples = s.wanted = parent.samples;
        s.seen = parent.seen;
        s.all = parent.all;
    }
    add_sampled(*half[1]);
    if (kept && shares_.size() > before + 1) {
        shares_[before].sibling = static_cast<std::int32_t>(before + 1);
    }
    shares_[index].cluster = nullptr;
    shares_[index].unoccluded = 0.0;
}

void DirectLighting::Gathering::cast() {
    const RayCaster& caster = lighting_.scene_.ray_caster();
    const Vec3f local = (receiver_.position - caster.origin()).as<float>();
    const Vec3f from = local + receiver_.normal * caster.offset(local, 0.0F);
    rays_.clear();
    probes_.clear();
    for (std::size_t i = 0; i < shares_.size(); ++i) {
        Share& s = shares_[i];
        if (s.unoccluded == 0.0 || s.samples == s.wanted) {
            continue;
        }
        const LuminaireIlluminance& light = lighting_.luminaires_[s.luminaire];
        const std::uint64_t scramble = mix64(key_ + mix64(static_cast<std::uint64_t>(s.luminaire)));
        const Vec3f plane = light.luminaire().z.as<float>();
        for (; s.samples < s.wanted || (s.all == 0.0 && s.samples < kHorizonSamples);
             ++s.samples) {
            const auto [u, v] = sobol_point(s.samples, scramble);
            const ShadowSample sample = light.shadow_sample(receiver_, u, v);
            s.all += sample.weight;
            if (sample.weight > 0.0) {
                // It ends where photons start: off the luminaire and off the luminaire's plane.
                const Vec3f at = (sample.point - caster.origin()).as<float>();
                const Vec3f direction = normalize(from - at);
                const Vec3f away = direction + plane * std::copysign(1.0F, dot(direction, plane));
                rays_.push_back({from, at + away * caster.offset(at, 0.0F) - from});
                probes_.push_back({i, sample.weight});
            }
        }
    }
    if (occluded_size_ < rays_.size()) {
        occluded_size_ = 2 * rays_.size();
        occluded_ = std::make_unique<bool[]>(occluded_size_);
    }
    caster.occluded(rays_, {occluded_.get(), rays_.size()});
    shadow_rays_ += rays_.size();
    for (std::size_t k = 0; k < probes_.size(); ++k) {
        if (!occluded_[k]) {
            shares_[probes_[k].share].seen += probes_[k].weight;
        }
    }
}

// Where all shadow rays of a luminaire agree, an edge may still pass between them: with n even
// rays it takes a strip of 1/n at most. Where they don't, each of the about sqrt(n) cells of a
// grid that an edge crosses adds its variance.
double DirectLighting::Gathering::variance_of(const Share& s) const {
    if (s.unoccluded == 0.0) {
        return s.cluster != nullptr ? s.spread : 0.0;
    }
    const double edge = std::min(1.0, kEdgesPerRadian * s.angle);
    const double n = s.samples;
    const double share = s.mixed || !s.decided() ? 1.0 / (n * std::sqrt(n)) : edge / (n * n * n);
    const double visible = s.visible();
    const double spread = s.cluster != nullptr ? s.spread * visible * visible : 0.0;
    return s.unoccluded * s.unoccluded * (kEdgeVariance * share + spread);
}

bool DirectLighting::Gathering::accurate() {
    for (Share& s : shares_) {
        if (s.sibling >= 0) {
            Share& other = shares_[s.sibling];
            if (s.all > 0.0 && other.all > 0.0) {
                const bool differ = (s.seen > 0.0) != (other.seen > 0.0);
                s.mixed = s.cluster != nullptr && differ;
                other.mixed = other.cluster != nullptr && differ;
            }
            s.sibling = -1;
        }
    }
    std::erase_if(shares_,
                  [](const Share& s) { return s.unoccluded == 0.0 && s.cluster == nullptr; });
    direct_ = variance_ = 0.0;
    bool refinable = false;
    for (Share& s : shares_) {
        s.variance = variance_of(s);
        variance_ += s.variance;
        direct_ += s.unoccluded * s.visible();
        refinable |= s.variance > 0.0 && (s.cluster != nullptr || s.samples < kMostSamples);
    }
    const double total = std::max(direct_ + indirect_, lighting_.least_total_);
    const double allowed = lighting_.settings_.accuracy * total;
    return !refinable || variance_ <= allowed * allowed;
}

void DirectLighting::Gathering::refine() {
    const auto gain = [](const Share& s) {
        return s.cluster != nullptr       ? s.variance
               : s.samples < kMostSamples ? s.variance / s.samples
                                          : 0.0;
    };
    double largest = 0.0;
    for (const Share& s : shares_) {
        largest = std::max(largest, gain(s));
    }
    const std::size_t count = shares_.size();
    for (std::size_t i = 0; i < count; ++i) {
        if (gain(shares_[i]) < kRefinedTogether * largest) {
            continue;
        }
        if (shares_[i].cluster != nullptr) {
            split(i);
        } else {
            shares_[i].wanted = 2 * shares_[i].samples;
        }
    }
}

DirectIllumination DirectLighting::illuminate(std::span<const Receiver> receivers,
                                              std::span<const float> indirect, int threads) const {
    constexpr std::size_t kGrain = 64;
    DirectIllumination out{std::vector<Vec3f>(receivers.size()),
                           std::vector<float>(receivers.size())};
    std::atomic<std::uint64_t> shadow_rays{0};
    tbb::task_arena(threads).execute([&] {
        tbb::parallel_for(
            tbb::blocked_range<std::size_t>(0, receivers.size(), kGrain), [&](const auto& block) {
                Gathering gathering(*this);
                std::uint64_t rays = 0;
                for (std::size_t i = block.begin(); i < block.end(); ++i) {
                    const auto found =
                        gathering.gather(receivers[i], indirect.empty() ? 0.0F : indirect[i]);
                    out.illuminance[i] = found.illuminance;
                    out.standard_error[i] = found.standard_error;
                    rays += found.shadow_rays;
                }
                shadow_rays += rays;
            });
    });
    out.shadow_rays = shadow_rays;
    return out;
}

} // namespace isolux
