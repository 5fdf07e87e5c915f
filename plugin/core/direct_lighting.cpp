#include "core/direct_lighting.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <memory>
#include <numbers>

#include "core/parallel.h"
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

std::uint64_t position_key(const Vec3d& p) {
    return mix64(
        std::bit_cast<std::uint64_t>(p.x) ^
        mix64(std::bit_cast<std::uint64_t>(p.y) ^ mix64(std::bit_cast<std::uint64_t>(p.z))));
}

// What is known beforehand counts like one edge.
double edges_per_radian(double met, double angle_tried) {
    return (1.0 + met) / (1.0 / kEdgesPerRadian + angle_tried);
}

// Of the visible share, where an edge crosses and n rays agree.
double missed_variance(double n) { return std::min(kEdgeVariance, kMissedVariance / (n * n * n)); }

double mean_illuminance(const Scene& scene) {
    double area = 0.0;
    for (const double a : scene.mesh().areas) {
        area += a;
    }
    return area > 0.0 ? scene.luminous_flux() / area : 0.0;
}

} // namespace

DirectLighting::DirectLighting(const Scene& scene, const DirectLightingSettings& settings)
    : scene_(scene), settings_(settings), mean_illuminance_(mean_illuminance(scene)) {
    for (const bool in_tree : {true, false}) {
        for (const Luminaire& luminaire : scene.luminaires()) {
            const bool plain = luminaire.links == nullptr && !luminaire.is_infinite();
            if (plain == in_tree && !SkyLighting::is_wide(luminaire)) {
                luminaires_.emplace_back(luminaire);
            }
        }
        if (in_tree && luminaires_.size() > kFewLuminaires) {
            tree_.emplace(luminaires_);
            in_tree_ = luminaires_.size();
        }
    }
    for (const Luminaire& luminaire : scene.luminaires()) {
        if (SkyLighting::is_wide(luminaire)) {
            skies_.push_back(&luminaire);
        }
    }
}

double DirectLighting::allowed(double total) const {
    return settings_.accuracy *
           std::clamp(total, kDark * mean_illuminance_, kBright * mean_illuminance_);
}

// Light at one receiver after another; keeps its memory.
class DirectLighting::Gathering {
  public:
    explicit Gathering(const DirectLighting& lighting) : lighting_(lighting) {
        for (const Luminaire* sky : lighting.skies_) {
            skies_.emplace_back(*sky, lighting.scene_.ray_caster());
        }
    }

    struct Found {
        Vec3f illuminance;
        double known, edges;     // lx², variance; the second for each edge a radian
        double met, angle_tried; // edges; 1, rad
        std::uint64_t shadow_rays;
    };
    Found gather(const Receiver& receiver, float indirect);

  private:
    struct Probe {
        std::int32_t share;
        double weight;
    };
    // One luminaire's light, or that of a cluster by one of its luminaires.
    struct Share {
        std::int32_t luminaire = 0;
        const LightCluster* cluster = nullptr; // null: the luminaire alone
        int bin = 0;                           // of directions, that it was chosen for
        double unoccluded = 0.0;               // lx
        double expected = 0.0; // lx, the same whichever of a cluster's luminaires is looked at
        double geometry = 0.0; // lx², variance of unoccluded light in a cluster
        double angle = 0.0;    // rad, radius as seen from the receiver
        std::uint32_t samples = 0, wanted = 1; // points of the luminaire tried, to be tried
        double seen = 0.0, all = 0.0;          // sums of their weights
        float least = 1.0F, most = 0.0F;       // of what reaches the receiver from one of them
        bool mixed = false;                    // its sibling's shadow rays met something else
        std::int32_t sibling = -1;             // the other half of a cluster just split
        double direct = 0.0;                   // lx
        std::uint32_t agreed = 0;              // samples that did, before more were tried
        double agreed_on = 0.0;                // visible share by these
        double known = 0.0, edges = 0.0;       // lx², variance; the second for each edge a radian

        double visible() const { return all > 0.0 ? seen / all : 0.0; }
        bool decided() const { return all > 0.0 && least >= most; }
        // Of a further shadow ray, lx².
        double gain(double edges_per_radian) const {
            const double variance = known + edges_per_radian * edges;
            return cluster != nullptr       ? variance
                   : samples < kMostSamples ? variance / samples
                                            : 0.0;
        }
    };
    struct Candidate {
        double gain;
        std::int32_t share;
    };

    void add_clusters();
    bool add(std::int32_t luminaire, double unoccluded, const LightCluster* cluster,
             const ClusterIlluminance& bound, int bin = 0);
    bool add_sampled(const LightCluster& cluster, const ClusterIlluminance& bound);
    void split(std::int32_t share);
    void refine();
    void cast();
    void settle();
    double edges_per_radian() const;
    double variance() const { return known_ + edges_per_radian() * edges_; }
    double allowed() const;

    const DirectLighting& lighting_;
    std::vector<SkyLighting> skies_;
    Receiver receiver_;
    std::uint64_t key_ = 0;
    double indirect_ = 0.0;                           // lx
    double direct_ = 0.0, known_ = 0.0, edges_ = 0.0; // sums over the shares
    double edges_met_ = 0.0, angle_tried_ = 0.0;      // 1, rad
    double found_ = 0.0, sought_ = 0.0; // the same, by more shadow rays to one luminaire
    std::uint64_t shadow_rays_ = 0;
    std::vector<Share> shares_;
    std::vector<std::int32_t> pending_; // shares that want shadow rays
    std::vector<ChosenCluster> chosen_;
    std::vector<Candidate> candidates_; // a heap
    std::vector<Ray> rays_;
    std::vector<Probe> probes_; // one a ray
    std::vector<float> transmitted_;
};

DirectLighting::Gathering::Found DirectLighting::Gathering::gather(const Receiver& receiver,
                                                                   float indirect) {
    if (receiver.normal == Vec3f{}) {
        return {};
    }
    receiver_ = receiver;
    key_ = position_key(receiver.position) ^ mix64(lighting_.settings_.seed);
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
                return lighting_.allowed(illuminance + indirect_);
            });
        sum += found.illuminance.as<float>();
        indirect_ += luminance(found.illuminance); // light beside that of the others
        sky_variance += found.variance;
        shadow_rays_ += found.shadow_rays;
    }
    if (lighting_.tree_) {
        add_clusters();
    }
    for (std::size_t i = lighting_.in_tree_; i < lighting_.luminaires_.size(); ++i) {
        const LuminaireIlluminance& light = lighting_.luminaires_[i];
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
    known_ = edges_ = 0.0; // anew: differences have rounded
    for (const Share& s : shares_) {
        sum += lighting_.luminaires_[s.luminaire].luminaire().colour * static_cast<float>(s.direct);
        known_ += s.known;
        edges_ += s.edges;
    }
    return {sum,         known_ + sky_variance, edges_, edges_met_ + found_, angle_tried_ + sought_,
            shadow_rays_};
}

double DirectLighting::Gathering::allowed() const { return lighting_.allowed(direct_ + indirect_); }

void DirectLighting::Gathering::add_clusters() {
    lighting_.tree_->choose_clusters(
        receiver_, [this](double expected) { return lighting_.allowed(expected + indirect_); },
        chosen_);
    // Neighbours in pairs, which tell where there are edges.
    for (const ChosenCluster& chosen : chosen_) {
        const auto index = static_cast<std::int32_t>(shares_.size());
        if (add_sampled(*chosen.cluster, chosen.bound) && index % 2 != 0) {
            shares_[index - 1].sibling = index;
        }
    }
}

// unoccluded : lx, of the luminaire alone or over its probability in the cluster. False where it
// gives no light.
bool DirectLighting::Gathering::add(std::int32_t luminaire, double unoccluded,
                                    const LightCluster* cluster, const ClusterIlluminance& bound,
                                    int bin) {
    const LuminaireIlluminance& light = lighting_.luminaires_[luminaire];
    Share share{.luminaire = luminaire, .cluster = cluster, .bin = bin};
    if (cluster != nullptr) {
        share.unoccluded = unoccluded;
        share.expected = bound.middle;
        share.geometry = bound.variance();
        share.angle = bound.angle;
    } else if (unoccluded > 0.0) {
        share.unoccluded = share.expected = unoccluded;
        if (const auto* far = std::get_if<DistantLuminaire>(&light.luminaire().shape)) {
            share.angle = far->half_angle;
        } else {
            const double distance = length(light.luminaire().position - receiver_.position);
            share.angle = distance > light.radius() ? light.radius() / distance : 1.0;
            share.angle += share.angle > kPointAngle ? kFixtureAngle : 0.0;
        }
    } else {
        return false;
    }
    pending_.push_back(static_cast<std::int32_t>(shares_.size()));
    shares_.push_back(share);
    return true;
}

bool DirectLighting::Gathering::add_sampled(const LightCluster& cluster,
                                            const ClusterIlluminance& bound) {
    if (bound.most == 0.0) {
        return false;
    }
    const auto node = static_cast<std::uint64_t>(&cluster - lighting_.tree_->clusters().data());
    const double u = static_cast<double>(mix64(key_ + mix64(~node)) >> 11) * 0x1p-53;
    const int bin =
        cluster.follows_cosine ? 0 : ClusterIntensity::bin(receiver_.position - cluster.centre);
    const auto [luminaire, probability] = lighting_.tree_->choose(cluster, bin, u);
    const double unoccluded = lighting_.luminaires_[luminaire].unoccluded(receiver_);
    return cluster.children[0] >= 0 ? add(luminaire, unoccluded / probability, &cluster, bound, bin)
                                    : add(luminaire, unoccluded, nullptr, bound);
}

// The half that holds the sampled luminaire keeps its shadow ray.
void DirectLighting::Gathering::split(std::int32_t index) {
    const Share parent = shares_[index];
    shares_[index] = {};
    const LightTree& tree = *lighting_.tree_;
    const LightCluster* kept = &tree.clusters()[parent.cluster->children[0]];
    const LightCluster* other = &tree.clusters()[parent.cluster->children[1]];
    double share = tree.first_half(*parent.cluster, parent.bin);
    if (tree.place(parent.luminaire) >= kept->last) {
        std::swap(kept, other);
        share = 1.0 - share;
    }
    const auto first = static_cast<std::int32_t>(shares_.size());
    const ClusterIlluminance bound = cluster_illuminance(*kept, receiver_);
    const bool halved =
        bound.most > 0.0 && add(parent.luminaire, parent.unoccluded * share,
                                kept->children[0] >= 0 ? kept : nullptr, bound, parent.bin);
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

void DirectLighting::Gathering::refine() {
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
            s.wanted = 2 * s.samples;
            s.agreed = s.decided() ? s.samples : 0;
            s.agreed_on = s.visible();
            pending_.push_back(index);
        }
    }
}

void DirectLighting::Gathering::cast() {
    const RayCaster& caster = lighting_.scene_.ray_caster();
    const Vec3f local = (receiver_.position - caster.origin()).as<float>();
    const Vec3f from = local + receiver_.normal * caster.offset(local, 0.0F);
    rays_.clear();
    probes_.clear();
    for (const std::int32_t i : pending_) {
        Share& s = shares_[i];
        if (s.unoccluded == 0.0) {
            continue;
        }
        const LuminaireIlluminance& light = lighting_.luminaires_[s.luminaire];
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
void DirectLighting::Gathering::settle() {
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
        const double gain = s.gain(edges_per_radian());
        if (gain > 0.0) {
            candidates_.push_back({gain, i});
            std::ranges::push_heap(candidates_, {}, &Candidate::gain);
        }
    }
}

double DirectLighting::Gathering::edges_per_radian() const {
    return isolux::edges_per_radian(edges_met_, angle_tried_);
}

DirectIllumination DirectLighting::illuminate(std::span<const Receiver> receivers,
                                              std::span<const float> indirect, int threads) const {
    constexpr std::size_t kGrain = 64;
    DirectIllumination out{std::vector<Vec3f>(receivers.size()),
                           std::vector<float>(receivers.size())};
    std::vector<Gathering::Found> all(receivers.size());
    parallel_blocks(
        threads, std::size_t{0}, receivers.size(), kGrain, [&](std::size_t begin, std::size_t end) {
            Gathering gathering(*this);
            for (std::size_t i = begin; i < end; ++i) {
                all[i] = gathering.gather(receivers[i], indirect.empty() ? 0.0F : indirect[i]);
            }
        });
    // Where one receiver's rays met no edge, those of all tell how often there is one.
    double met = 0.0, angle_tried = 0.0;
    for (const Gathering::Found& found : all) {
        met += found.met;
        angle_tried += found.angle_tried;
    }
    const double rate = edges_per_radian(met, angle_tried);
    for (std::size_t i = 0; i < all.size(); ++i) {
        out.illuminance[i] = all[i].illuminance;
        out.standard_error[i] = static_cast<float>(std::sqrt(all[i].known + rate * all[i].edges));
        out.shadow_rays += all[i].shadow_rays;
    }
    return out;
}

} // namespace isolux
