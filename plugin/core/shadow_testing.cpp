#include "core/shadow_testing.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "core/random.h"
#include "core/sobol.h"

namespace isolux {
namespace {

// Shadow rays from a receiver to one luminaire, at most.
constexpr std::uint32_t kMostSamples = 1024;
// Points tried, without rays, to find one above the horizon.
constexpr std::uint32_t kHorizonSamples = 64;
// Edges of shadows that a luminaire's image meets, for each radian of its radius, before the shadow
// rays tell more.
constexpr double kEdgesPerRadian = 2.0;
// Luminaires hang from cords and sit in cans, whose edges are near whatever the distance: as many
// as meet this angle, rad. A luminaire that looks smaller than the other is a point.
constexpr double kFixtureAngle = 0.05;
constexpr double kPointAngle = 1e-4;
// Variance of the unknown visible share of a luminaire that an edge crosses somewhere: the mean of
// p (1 - p).
constexpr double kEdgeVariance = 1.0 / 6.0;
// Variance of the visible share by n rays of the sequence that don't agree, times n^1.5: of
// straight edges and corners drawn at random 0.10 to 0.15, for 2 to 1024 rays.
constexpr double kMixedVariance = 0.12;
// Of what n rays that agree miss, times n³: 0.1 where one edge crosses, but what is narrow hides
// from all rays. With 0.1 the error told in the office is half of the true one.
constexpr double kMissedVariance = 0.5;
// Of the mean illuminance that the luminaires could give: totals below are dark, and what is above
// adds nothing to the error allowed, since few bright places would make most of a scene's.
constexpr double kDark = 0.1, kBright = 4.0;
// Shares of light whose variance for each shadow ray is at least this part of the largest are
// refined together.
constexpr double kRefinedTogether = 0.25;

// One of so many receivers is looked at again where shadow rays agreed, for 2 % more of them.
constexpr std::uint64_t kVerified = 32;

std::uint64_t position_key(const Vec3d& p) {
    return mix64(
        std::bit_cast<std::uint64_t>(p.x) ^
        mix64(std::bit_cast<std::uint64_t>(p.y) ^ mix64(std::bit_cast<std::uint64_t>(p.z))));
}

// Of the visible share, where an edge crosses and n rays agree.
double missed_variance(double n) { return std::min(kEdgeVariance, kMissedVariance / (n * n * n)); }

} // namespace

double DirectSources::allowed(double total) const {
    return accuracy * std::clamp(total, kDark * mean_illuminance, kBright * mean_illuminance);
}

double edges_per_radian(double met, double angle_tried) {
    // What is known beforehand counts like one edge.
    return (1.0 + met) / (1.0 / kEdgesPerRadian + angle_tried);
}

ShadowTesting::ShadowTesting(const DirectSources& sources) : sources_(sources) {
    for (const Luminaire* sky : sources.skies) {
        skies_.emplace_back(*sky, sources.scene.ray_caster());
    }
}

double ShadowTesting::Share::gain(double edges_per_radian) const {
    const double variance = known + edges_per_radian * edges;
    return cluster != nullptr ? variance : samples < kMostSamples ? variance / samples : 0.0;
}

ShadowTesting::Found ShadowTesting::illuminate(const Receiver& receiver, float indirect) {
    if (receiver.normal == Vec3f{}) {
        return {};
    }
    receiver_ = receiver;
    key_ = position_key(receiver.position) ^ mix64(sources_.seed);
    indirect_ = indirect;
    direct_ = known_ = edges_ = edges_met_ = angle_tried_ = found_ = sought_ = 0.0;
    shadow_rays_ = 0;
    shares_.clear();
    pending_.clear();
    candidates_.clear();
    Vec3f sum;
    double sky_variance = 0.0;
    for (std::size_t i = 0; i < skies_.size(); ++i) {
        const auto found =
            skies_[i].illuminate(receiver, key_ + mix64(i), [this](double illuminance) {
                return sources_.allowed(illuminance + indirect_);
            });
        sum += found.illuminance.as<float>();
        indirect_ += luminance(found.illuminance); // light beside that of the others
        sky_variance += found.variance;
        shadow_rays_ += found.shadow_rays;
    }
    if (sources_.tree) {
        add_clusters();
    }
    for (std::size_t i = sources_.in_tree; i < sources_.luminaires.size(); ++i) {
        const LuminaireIlluminance& light = sources_.luminaires[i];
        if (light.luminaire().lights(receiver.mesh)) {
            add(static_cast<std::int32_t>(i), light.unoccluded(receiver), nullptr, {});
        }
    }
    cast();
    settle();
    while (!candidates_.empty() && variance() > allowed() * allowed()) {
        refine();
        cast();
        settle();
    }
    const Verified verified = mix64(key_) % kVerified == 0 ? verify() : Verified{};
    known_ = edges_ = 0.0; // anew: differences have rounded
    for (const Share& s : shares_) {
        sum += sources_.luminaires[s.luminaire].luminaire().colour * static_cast<float>(s.direct);
        known_ += s.known;
        edges_ += s.edges;
    }
    return {sum,      known_ + sky_variance, edges_, edges_met_ + found_, angle_tried_ + sought_,
            verified, shadow_rays_};
}

double ShadowTesting::allowed() const { return sources_.allowed(direct_ + indirect_); }

void ShadowTesting::add_clusters() {
    const auto chosen_clusters =
        clusters_.choose(*sources_.tree, receiver_, [this](double expected) {
            return sources_.allowed(expected + indirect_);
        });
    // Neighbours in pairs, which tell where there are edges.
    for (const auto& [bound, cluster] : chosen_clusters) {
        const auto index = static_cast<std::int32_t>(shares_.size());
        if (add_sampled(*cluster, bound) && index % 2 != 0) {
            shares_[index - 1].sibling = index;
        }
    }
}

// unoccluded : lx, of the luminaire alone or over its probability in the cluster. False where it
// gives no light.
bool ShadowTesting::add(std::int32_t luminaire, double unoccluded, const LightCluster* cluster,
                        const ClusterIlluminance& bound, int bin) {
    if (cluster == nullptr && !(unoccluded > 0.0)) {
        return false;
    }
    pending_.push_back(static_cast<std::int32_t>(shares_.size()));
    Share& share = shares_.emplace_back(luminaire, unoccluded, cluster, bin);
    if (cluster != nullptr) {
        share.expected = bound.middle;
        share.geometry = bound.variance();
        share.angle = bound.angle;
        return true;
    }
    const LuminaireIlluminance& light = sources_.luminaires[luminaire];
    if (const auto* far = std::get_if<DistantLuminaire>(&light.luminaire().shape)) {
        share.angle = far->half_angle;
    } else {
        const double distance = length(light.luminaire().position - receiver_.position);
        share.angle = distance > light.radius() ? light.radius() / distance : 1.0;
        share.angle += share.angle > kPointAngle ? kFixtureAngle : 0.0;
    }
    return true;
}

bool ShadowTesting::add_sampled(const LightCluster& cluster, const ClusterIlluminance& bound) {
    if (bound.most == 0.0) {
        return false;
    }
    const LightTree& tree = *sources_.tree;
    if (cluster.alone()) {
        const std::int32_t luminaire = tree.luminaire(cluster);
        return add(luminaire, sources_.luminaires[luminaire].unoccluded(receiver_), nullptr, bound);
    }
    const auto node = static_cast<std::uint64_t>(&cluster - tree.clusters().data());
    const double u = static_cast<double>(mix64(key_ + mix64(~node)) >> 11) * 0x1p-53;
    const int bin =
        cluster.follows_cosine ? 0 : ClusterIntensity::bin(receiver_.position - cluster.centre);
    const auto [luminaire, probability] = tree.choose(cluster, bin, u);
    const double unoccluded = sources_.luminaires[luminaire].unoccluded(receiver_);
    return add(luminaire, unoccluded / probability, &cluster, bound, bin);
}

// The half that holds the sampled luminaire keeps its shadow ray.
void ShadowTesting::split(std::int32_t index) {
    const Share parent = shares_[index];
    shares_[index] = Share(0, 0.0, nullptr, 0);
    const LightTree& tree = *sources_.tree;
    const LightCluster* kept = &tree.clusters()[parent.cluster->children[0]];
    const LightCluster* other = &tree.clusters()[parent.cluster->children[1]];
    double share = tree.first_half(*parent.cluster, parent.bin);
    if (tree.place(parent.luminaire) >= kept->last) {
        std::swap(kept, other);
        share = 1.0 - share;
    }
    const auto first = static_cast<std::int32_t>(shares_.size());
    const ClusterIlluminance bound = cluster_illuminance(*kept, receiver_);
    const bool halved = bound.most > 0.0 && add(parent.luminaire, parent.unoccluded * share,
                                                kept->alone() ? nullptr : kept, bound, parent.bin);
    if (halved) {
        Share& s = shares_.back();
        s.samples = s.wanted = parent.samples;
        s.seen = parent.seen;
        s.all = parent.all;
        s.least = parent.least;
        s.most = parent.most;
    }
    if (add_sampled(*other, cluster_illuminance(*other, receiver_)) && halved) {
        shares_[first].sibling = first + 1;
    }
}

void ShadowTesting::refine() {
    pending_.clear();
    const double least = kRefinedTogether * candidates_.front().gain;
    while (!candidates_.empty() && candidates_.front().gain >= least) {
        const std::int32_t index = candidates_.front().share;
        std::ranges::pop_heap(candidates_, {}, &Candidate::gain);
        candidates_.pop_back();
        Share& s = shares_[index];
        direct_ -= s.direct;
        known_ -= s.known;
        edges_ -= s.edges;
        if (s.cluster != nullptr) {
            split(index);
        } else {
            s.agreed = s.decided() ? s.samples : 0;
            double_samples(index);
        }
    }
}

void ShadowTesting::double_samples(std::int32_t index) {
    Share& s = shares_[index];
    s.agreed_on = s.visible();
    s.wanted = 2 * s.samples;
    pending_.push_back(index);
}

void ShadowTesting::cast() {
    const RayCaster& caster = sources_.scene.ray_caster();
    const Vec3f local = (receiver_.position - caster.origin()).as<float>();
    const Vec3f from = local + receiver_.normal * caster.offset(local, 0.0F);
    rays_.clear();
    probes_.clear();
    for (const std::int32_t i : pending_) {
        Share& s = shares_[i];
        if (s.unoccluded == 0.0) {
            continue;
        }
        const LuminaireIlluminance& light = sources_.luminaires[s.luminaire];
        const std::uint64_t scramble = mix64(key_ + mix64(static_cast<std::uint64_t>(s.luminaire)));
        for (; s.samples < s.wanted || (s.all == 0.0 && s.samples < kHorizonSamples); ++s.samples) {
            const auto [u, v] = sobol_point(s.samples, scramble);
            const ShadowSample sample = light.shadow_sample(receiver_, u, v);
            s.all += sample.weight;
            if (sample.weight > 0.0) {
                // It ends where photons start.
                const Vec3f at = (sample.point - caster.origin()).as<float>();
                const Vec3f direction = normalize(from - at);
                const Vec3f away = light.luminaire().clearance(direction);
                rays_.push_back({from, at + away * caster.offset(at, 0.0F) - from, 0.0F,
                                 light.luminaire().shadow_meshes()});
                probes_.push_back({i, sample.weight});
            }
        }
    }
    transmitted_.resize(rays_.size());
    caster.transmitted(rays_, transmitted_);
    shadow_rays_ += rays_.size();
    for (std::size_t k = 0; k < probes_.size(); ++k) {
        Share& s = shares_[probes_[k].share];
        s.seen += probes_[k].weight * static_cast<double>(transmitted_[k]);
        s.least = std::min(s.least, transmitted_[k]);
        s.most = std::max(s.most, transmitted_[k]);
    }
}

// Adds the pending shares to the sums, and to the candidates for more shadow rays.
//
// Where all shadow rays of a luminaire agree, an edge may still pass beside them: the hidden part
// that n even rays miss is about 1/n. Where they don't, each of the about sqrt(n) cells of a grid
// that an edge crosses adds its variance. It is the same for light seen and hidden: to look closer
// at one of them alone would have the rest outweigh it.
void ShadowTesting::settle() {
    for (const std::int32_t i : pending_) {
        Share& s = shares_[i];
        if (s.sibling >= 0) {
            Share& other = shares_[s.sibling];
            if (s.all > 0.0 && other.all > 0.0) {
                s.mixed = other.mixed = (s.seen > 0.0) != (other.seen > 0.0);
                edges_met_ += s.mixed ? 1.0 : 0.0;
                angle_tried_ += s.angle + other.angle;
            }
            s.sibling = -1;
        }
    }
    const double rate = edges_per_radian();
    for (const std::int32_t i : pending_) {
        Share& s = shares_[i];
        const double n = std::max(1.0, static_cast<double>(s.samples));
        const double squared = s.expected * s.expected;
        // What rays that agreed had missed, in edges: what one is thought to hide from them. As
        // many again show half of its square where they are like independent ones, as the first two
        // are.
        if (s.agreed > 0) {
            const double missed = s.visible() - s.agreed_on;
            found_ += 2.0 * missed * missed / kEdgeVariance;
            sought_ += s.angle * missed_variance(s.agreed) / kEdgeVariance;
            s.agreed = 0;
        }
        const bool mixed = (s.cluster != nullptr && s.mixed) || !s.decided();
        s.direct = s.unoccluded * s.visible();
        s.known = s.geometry + (mixed ? squared * kMixedVariance / (n * std::sqrt(n)) : 0.0);
        s.edges = mixed ? 0.0 : squared * s.angle * missed_variance(n);
        direct_ += s.direct;
        known_ += s.known;
        edges_ += s.edges;
        const double gain = s.gain(rate);
        if (gain > 0.0) {
            candidates_.push_back({gain, i});
            std::ranges::push_heap(candidates_, {}, &Candidate::gain);
        }
    }
}

// What is narrow, as the cord of a lamp, hides from all rays that agree; how much is so missed only
// more rays tell, at receivers that nothing chose but chance.
Verified ShadowTesting::verify() {
    Verified out;
    pending_.clear();
    for (std::size_t i = 0; i < shares_.size(); ++i) {
        const Share& s = shares_[i];
        if (s.cluster == nullptr && s.decided() && s.angle > kPointAngle &&
            s.samples < kMostSamples) {
            out.edges += s.edges;
            ++out.shares;
            double_samples(static_cast<std::int32_t>(i));
        }
    }
    cast();
    for (const std::int32_t i : pending_) {
        const Share& s = shares_[i];
        const double missed = s.expected * (s.visible() - s.agreed_on);
        out.missed += 2.0 * missed * missed; // see settle
    }
    settle();
    return out;
}

} // namespace isolux
