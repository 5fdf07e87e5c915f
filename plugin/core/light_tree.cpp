#include "core/light_tree.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <utility>

namespace isolux {
namespace {

constexpr double kPi = std::numbers::pi;
// Well above the rounding of the angles, rad.
constexpr double kAngleSlack = 1e-6;

// Relative variance where the horizon passes through a cluster: large.
constexpr double kUnknownSpread = 1e6;

// The largest number below 1.
constexpr double kBelowOne = 1.0 - 0x1p-53;

// Of half a bin of directions: clusters that look wider may shine elsewhere than their bin tells.
constexpr double kNarrow = 0.5;

// A cluster that may give so much more than from its centre is split whatever is allowed.
constexpr double kNear = 30.0;

double angle_between(const Vec3d& a, const Vec3d& b) {
    return std::atan2(length(cross(a, b)), dot(a, b));
}

} // namespace

LightTree::LightTree(std::span<const LuminaireIlluminance> luminaires)
    : order_(luminaires.size()), places_(luminaires.size()) {
    std::iota(order_.begin(), order_.end(), 0);
    clusters_.reserve(2 * luminaires.size());
    add_cluster(luminaires, 0, static_cast<std::int32_t>(luminaires.size()));
    if (!follows_cosine_) {
        clusters_.front().intensity->settle();
    }
    cumulative_flux_.push_back(0.0);
    for (std::size_t i = 0; i < order_.size(); ++i) {
        places_[order_[i]] = static_cast<std::int32_t>(i);
        cumulative_flux_.push_back(cumulative_flux_.back() +
                                   luminaires[order_[i]].luminaire().luminous_flux);
    }
}

std::int32_t LightTree::add_cluster(std::span<const LuminaireIlluminance> luminaires,
                                    std::int32_t first, std::int32_t last) {
    const auto index = static_cast<std::int32_t>(clusters_.size());
    LightCluster cluster{.first = first, .last = last};
    const std::span members(order_.begin() + first, order_.begin() + last);

    // Where the luminaires are and where they point, in the same unit: a turn of one radian counts
    // like half of the extent.
    Vec3d low = luminaires[members[0]].luminaire().position, high = low, axis;
    for (const std::int32_t i : members) {
        const Luminaire& l = luminaires[i].luminaire();
        low = {std::min(low.x, l.position.x), std::min(low.y, l.position.y),
               std::min(low.z, l.position.z)};
        high = {std::max(high.x, l.position.x), std::max(high.y, l.position.y),
                std::max(high.z, l.position.z)};
        axis += -l.z;
        cluster.luminous_flux += l.luminous_flux;
        cluster.peak_intensity =
            std::max(cluster.peak_intensity, luminaires[i].peak_intensity() / l.luminous_flux);
        cluster.follows_cosine &= luminaires[i].follows_cosine();
    }
    cluster.peak_intensity *= cluster.luminous_flux;
    cluster.centre = (low + high) * 0.5;
    cluster.half = (high - low) * 0.5;
    cluster.axis = normalize(axis);
    for (const std::int32_t i : members) {
        const Luminaire& l = luminaires[i].luminaire();
        cluster.radius =
            std::max(cluster.radius, length(l.position - cluster.centre) + luminaires[i].radius());
        cluster.spread = std::max(cluster.spread, angle_between(cluster.axis, -l.z));
        cluster.reach = std::max(cluster.reach, luminaires[i].reach());
        cluster.own_radius = std::max(cluster.own_radius, luminaires[i].radius());
    }
    // Luminaires that point in opposite directions, as the sides of a box, have no common one.
    if (length(axis) < kAngleSlack * static_cast<double>(members.size())) {
        cluster.spread = kPi;
    }
    cluster.follows_cosine &= cluster.spread < kAngleSlack;
    follows_cosine_ = index == 0 ? cluster.follows_cosine : follows_cosine_;
    if (members.size() == 1) {
        if (!follows_cosine_) {
            cluster.intensity = std::make_shared<ClusterIntensity>(luminaires[members[0]]);
        }
        clusters_.push_back(std::move(cluster));
        return index;
    }
    clusters_.push_back(std::move(cluster));

    const double turn = 0.5 * length(high - low);
    const auto coordinates = [&](std::int32_t i) -> std::array<double, 6> {
        const Luminaire& l = luminaires[i].luminaire();
        return {l.position.x,  l.position.y,  l.position.z,
                -turn * l.z.x, -turn * l.z.y, -turn * l.z.z};
    };
    std::array<double, 6> least = coordinates(members[0]), most = least;
    for (const std::int32_t i : members) {
        const auto c = coordinates(i);
        for (std::size_t k = 0; k < c.size(); ++k) {
            least[k] = std::min(least[k], c[k]);
            most[k] = std::max(most[k], c[k]);
        }
    }
    std::size_t widest = 0;
    for (std::size_t k = 1; k < least.size(); ++k) {
        widest = most[k] - least[k] > most[widest] - least[widest] ? k : widest;
    }
    const auto middle = members.begin() + members.size() / 2;
    std::nth_element(members.begin(), middle, members.end(), [&](std::int32_t a, std::int32_t b) {
        const double ca = coordinates(a)[widest], cb = coordinates(b)[widest];
        return ca < cb || (ca == cb && a < b);
    });
    const std::int32_t split = first + static_cast<std::int32_t>(members.size() / 2);
    const std::int32_t low_child = add_cluster(luminaires, first, split);
    const std::int32_t high_child = add_cluster(luminaires, split, last);
    clusters_[index].children[0] = low_child;
    clusters_[index].children[1] = high_child;
    if (!follows_cosine_) {
        ClusterIntensity& low_half = *clusters_[low_child].intensity;
        ClusterIntensity& high_half = *clusters_[high_child].intensity;
        clusters_[index].intensity = std::make_shared<ClusterIntensity>(low_half, high_half);
        low_half.settle();
        high_half.settle();
    }
    return index;
}

double LightTree::first_half(const LightCluster& cluster, int bin) const {
    const auto weight = [&](const LightCluster& half) {
        return cluster.follows_cosine
                   ? half.luminous_flux
                   : half.intensity->at(bin).mean +
                         LuminaireIlluminance::kEvenIntensity * half.luminous_flux;
    };
    const double first = weight(clusters_[cluster.children[0]]);
    return first / (first + weight(clusters_[cluster.children[1]]));
}

LightTree::Choice LightTree::choose(const LightCluster& cluster, int bin, double u) const {
    const LightCluster* c = &cluster;
    double probability = 1.0;
    while (!c->follows_cosine && !c->alone()) {
        const double first = first_half(*c, bin);
        const bool second = u >= first;
        const double share = second ? 1.0 - first : first;
        u = std::min((second ? u - first : u) / share, kBelowOne);
        probability *= share;
        c = &clusters_[c->children[second ? 1 : 0]];
    }
    const auto begin = cumulative_flux_.begin() + c->first;
    const auto end = cumulative_flux_.begin() + c->last;
    const double all = *end - *begin;
    const auto above = std::upper_bound(begin + 1, end, *begin + u * all);
    return {order_[above - cumulative_flux_.begin() - 1],
            probability * (*above - *(above - 1)) / all};
}

// By place to first order or as if even up to the most, and by luminaire; few can be that bright
// [Bhatia & Davis 2000].
double ClusterIlluminance::variance() const {
    const double above = std::max(0.0, most - middle);
    const double places = std::min(above * above / 3.0, spread * middle * middle);
    return middle > 0.0 ? std::min(above * middle, places + between * middle * middle)
                        : above * above / 12.0;
}

ClusterIlluminance cluster_illuminance(const LightCluster& cluster, const Receiver& receiver) {
    const Vec3d to = cluster.centre - receiver.position;
    const Vec3d normal = receiver.normal.as<double>();
    const auto extent = [&](const Vec3d& n) {
        return cluster.own_radius + std::abs(n.x) * cluster.half.x +
               std::abs(n.y) * cluster.half.y + std::abs(n.z) * cluster.half.z;
    };
    const double height = dot(to, normal), up = extent(normal);
    const double below = -dot(to, cluster.axis), down = extent(cluster.axis);
    if (height <= -up || (cluster.follows_cosine && below <= -down)) {
        return {};
    }
    const double squared = dot(to, to);
    const double widest = cluster.spread + cluster.reach;
    if (!cluster.follows_cosine && widest < kPi && squared > cluster.radius * cluster.radius &&
        angle_between(cluster.axis, -to) - std::asin(cluster.radius / std::sqrt(squared)) >
            widest + kAngleSlack) {
        return {};
    }
    const auto beyond = [](double a, double half) { return std::max(0.0, std::abs(a) - half); };
    const Vec3d gap{beyond(to.x, cluster.half.x), beyond(to.y, cluster.half.y),
                    beyond(to.z, cluster.half.z)};
    ClusterIlluminance out;
    const bool alone = cluster.alone();
    const double gap_squared = alone ? squared : dot(gap, gap); // a lone one's box is a point
    if (gap_squared == 0.0) { // among its luminaires, which nothing bounds
        out.most = std::numeric_limits<double>::infinity();
        out.angle = 1.0;
        return out;
    }
    const double per_squared = 1.0 / squared, per_distance = std::sqrt(per_squared);
    const double nearest_squared = alone ? per_squared : 1.0 / gap_squared;
    const double nearest = alone ? per_distance : std::sqrt(nearest_squared);
    const auto cosine = [](double a) { return std::min(1.0, std::max(0.0, a)); };

    out.angle = std::min(1.0, cluster.radius * per_distance);
    out.middle = cluster.peak_intensity * cosine(height * per_distance) * per_squared;
    out.most = cluster.peak_intensity * cosine((height + up) * nearest) * nearest_squared;
    bool first_order = height > up;
    if (cluster.follows_cosine) {
        out.middle *= cosine(below * per_distance);
        out.most *= cosine((below + down) * nearest);
        first_order &= below > down;
    }
    double across = 0.0;
    if (!cluster.follows_cosine) {
        const DirectionalIntensity& towards = cluster.intensity->at(ClusterIntensity::bin(-to));
        const double wide = out.angle / ClusterIntensity::kBinAngle;
        out.middle *= towards.mean / cluster.peak_intensity;
        // Beams so narrow that the bins may have missed them are looked for.
        out.most *=
            wide < kNarrow && towards.most > 0.0F ? towards.most / cluster.peak_intensity : 1.0;
        out.between = towards.between;
        across = towards.across * wide * wide;
    }
    if (alone) {
        return out;
    }
    if (!first_order) {
        out.spread = kUnknownSpread;
        return out;
    }
    // Logarithmic derivative of height / distance³, or of height * below / distance⁴.
    Vec3d slope = normal * (1.0 / height) + to * (-3.0 * per_squared);
    if (cluster.follows_cosine) {
        slope += cluster.axis * (-1.0 / below) + to * -per_squared;
    }
    const Vec3d change{slope.x * cluster.half.x, slope.y * cluster.half.y,
                       slope.z * cluster.half.z};
    out.spread = dot(change, change) / 3.0 + across;
    return out;
}

// The largest variance is split first.
std::span<const ClusterChoice::Chosen>
ClusterChoice::choose(const LightTree& tree, const Receiver& receiver,
                      const std::function<double(double)>& allowed) {
    clusters_ = tree.clusters();
    receiver_ = receiver;
    least_ = allowed(0.0);
    variance_ = expected_ = 0.0;
    looked_at_.clear();
    candidates_.clear();
    chosen_.clear();
    look_at(clusters_.front());
    weigh(0);
    while (!candidates_.empty() && candidates_.front().variance > 0.0 &&
           std::sqrt(variance_) > allowed(expected_)) {
        std::ranges::pop_heap(candidates_, {}, &Candidate::variance);
        const auto [variance, place] = candidates_.back();
        candidates_.pop_back();
        variance_ = std::max(0.0, variance_ - variance);
        expected_ -= looked_at_[place].cluster.bound.middle;
        split(place);
    }
    take(0);
    return chosen_;
}

void ClusterChoice::look_at(const LightCluster& cluster) {
    looked_at_.push_back({{cluster_illuminance(cluster, receiver_), &cluster}, -1});
}

void ClusterChoice::weigh(std::int32_t place) {
    const auto& [bound, cluster] = looked_at_[place].cluster;
    if (bound.most == 0.0) {
        return;
    }
    const bool alone = cluster->alone();
    if (!alone && bound.most > kNear * std::max(bound.middle, least_)) {
        split(place);
        return;
    }
    const double own = alone ? 0.0 : bound.variance();
    variance_ += own;
    expected_ += bound.middle;
    candidates_.push_back({own, place});
    std::ranges::push_heap(candidates_, {}, &Candidate::variance);
}

void ClusterChoice::split(std::int32_t place) {
    const auto halves = static_cast<std::int32_t>(looked_at_.size());
    looked_at_[place].halves = halves;
    const LightCluster& cluster = *looked_at_[place].cluster.cluster;
    for (const std::int32_t child : cluster.children) {
        look_at(clusters_[child]);
    }
    weigh(halves);
    weigh(halves + 1);
}

void ClusterChoice::take(std::int32_t place) {
    const auto& [cluster, halves] = looked_at_[place];
    if (halves >= 0) {
        take(halves);
        take(halves + 1);
    } else if (cluster.bound.most != 0.0) {
        chosen_.push_back(cluster);
    }
}

} // namespace isolux
