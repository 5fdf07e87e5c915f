#include "core/radiosity_exchange.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/random.h"

namespace isolux {
namespace {

constexpr double kPi = std::numbers::pi;

// A triangle of which all is within this fraction of its distance counts as a point: form factor
// off by its square.
constexpr double kFarField = 1.0 / 32.0;
// Of distances, when a corner counts as above a plane.
constexpr double kRounding = 0x1p-32;
// What one interaction may bring, in tolerances, even where nothing seems to be in the way: a
// blocker that the probes miss is off by no more.
constexpr double kLargestShare = 8.0;
// The same, where something is in the way.
constexpr double kLargestMixedShare = 2.0;

// How far light over a receiver may be from linear, in tolerances: such errors are of one sign.
constexpr double kBend = 0.25;
// What may be spread over the hidden parts of a receiver altogether, in tolerances.
constexpr double kMixedSlack = 8.0;

class Exchange {
  public:
    Exchange(const Scene& scene, const RadiosityHierarchy& hierarchy,
             std::span<const NodeExitance> exitance, double tolerance, std::uint64_t seed)
        : visibility_(scene.ray_caster(), hierarchy.nodes, exitance, tolerance, seed),
          nodes_(hierarchy.nodes), exitance_(exitance), tolerance_(tolerance) {}

    PointIlluminance at_point(const Receiver& receiver, std::uint64_t key) {
        PointIlluminance out;
        const RayOrigins origins{receiver.position, receiver.normal.as<double>(), nullptr};
        pending_.assign(1, 0);
        while (!pending_.empty()) {
            const std::int32_t s = pending_.back();
            pending_.pop_back();
            take_at(origins, s, key, out);
        }
        return out;
    }

    // linear : illuminance of the receiver's corners by what its ancestors took
    // slack : lx that may yet be spread over a receiver of which a part is hidden. A part hidden
    //     from one source is hidden from most: such errors don't average out
    void onto(std::int32_t r, const std::vector<std::int32_t>& sources, std::array<Vec3d, 3> linear,
              double slack, std::span<Vec3d> received) {
        const RadiosityNode& receiver = nodes_[r];
        const RayOrigins origins{receiver.centre, receiver.normal, &receiver};
        if (receiver.leaf() && receiver.hidden) {
            return;
        }
        if (receiver.leaf()) {
            PointIlluminance own;
            pending_.assign(sources.begin(), sources.end());
            while (!pending_.empty()) {
                const std::int32_t s = pending_.back();
                pending_.pop_back();
                take_at(origins, s, static_cast<std::uint64_t>(r), own);
            }
            received[r] = own.illuminance + (linear[0] + linear[1] + linear[2]) * (1.0 / 3.0);
            return;
        }
        std::vector<std::int32_t> for_children;
        pending_.assign(sources.begin(), sources.end());
        while (!pending_.empty()) {
            const std::int32_t s = pending_.back();
            pending_.pop_back();
            if (exitance_[s].high > 0.0 && may_see(origins, receiver.radius, s) &&
                !take_onto(r, origins, s, linear, slack)) {
                for_children.push_back(s);
            }
        }
        const auto& [a, b, c] = linear;
        const Vec3d ab = (a + b) * 0.5, bc = (b + c) * 0.5, ca = (c + a) * 0.5;
        const std::int32_t child = receiver.first_child;
        onto(child, for_children, {a, ab, ca}, slack, received);
        onto(child + 1, for_children, {ab, b, bc}, slack, received);
        onto(child + 2, for_children, {ca, bc, c}, slack, received);
        onto(child + 3, for_children, {bc, ca, ab}, slack, received);
    }

    std::uint64_t rays() const { return visibility_.rays(); }

  private:
    // Some of the source is above the receiver's horizon and looks to where the receiver is.
    bool may_see(const RayOrigins& origins, double receiver_radius, std::int32_t s) const {
        const RadiosityNode& source = nodes_[s];
        const Vec3d to = source.centre - origins.centre;
        const double reach = source.radius + receiver_radius;
        if (dot(to, origins.normal) <= -reach) {
            return false;
        }
        if (source.cluster()) {
            const double distance = length(to);
            return -dot(to, source.normal) > -(source.normal_sine * distance + 2.0 * reach);
        }
        // Coplanar neighbours, or those behind, are many.
        const double rounding = kRounding * (length(to) + reach);
        const auto above = [&](const Vec3d& p) {
            return dot(p - origins.centre, origins.normal) > rounding;
        };
        return dot(to, source.normal) < receiver_radius - rounding &&
               std::ranges::any_of(source.corners, above);
    }

    // Form factor from a point to a triangle in full view.
    double factor(const Vec3d& position, const Vec3d& normal, std::int32_t s) const {
        const RadiosityNode& source = nodes_[s];
        const Vec3d to = source.centre - position;
        const double d2 = dot(to, to);
        if (source.radius * source.radius > kFarField * kFarField * d2) {
            return form_factor(position, normal, source.corners);
        }
        const double cosines =
            std::max(0.0, dot(to, normal)) * std::max(0.0, -dot(to, source.normal));
        return source.area * cosines / (kPi * d2 * d2);
    }

    // Whether all that a cluster may give is too little to look closer.
    bool faint(const RayOrigins& origins, double receiver_radius, std::int32_t s) const {
        const RadiosityNode& source = nodes_[s];
        const double gap = length(source.centre - origins.centre) - source.radius - receiver_radius;
        return gap > 0.0 && source.area * exitance_[s].high <= tolerance_ * kPi * gap * gap;
    }

    // Whether a point is in the plane of a triangle, and near to it.
    bool touching(const Vec3d& p, std::int32_t s) const {
        const RadiosityNode& source = nodes_[s];
        const Vec3d to = source.centre - p;
        return dot(to, to) < 4.0 * source.radius * source.radius &&
               std::abs(dot(to, source.normal)) <= kRounding * source.radius;
    }

    void open(std::int32_t s) {
        const RadiosityNode& source = nodes_[s];
        for (std::int32_t k = source.child_count(); k-- > 0;) {
            pending_.push_back(source.first_child + k);
        }
    }

    // Too coarse a source: its light is uneven, or comes from too wide a region.
    bool coarse(double form_factor, std::int32_t s) const {
        const NodeExitance& light = exitance_[s];
        return !nodes_[s].leaf() && (form_factor * (light.high - light.low) > tolerance_ ||
                                     form_factor * light.high > kLargestShare * tolerance_);
    }

    // Takes the source's light at a point, or for a leaf, or puts off the source's children.
    void take_at(const RayOrigins& origins, std::int32_t s, std::uint64_t key,
                 PointIlluminance& out) {
        const NodeExitance& light = exitance_[s];
        if (light.high <= 0.0 || !may_see(origins, 0.0, s)) {
            return;
        }
        if (nodes_[s].cluster()) {
            if (!faint(origins, 0.0, s)) {
                open(s);
                return;
            }
            const SourceLight seen = visibility_.look(origins, key, s, 0.0);
            out.illuminance += seen.light;
            out.variance += seen.variance;
            return;
        }
        const double f = factor(origins.centre, origins.normal, s);
        if (f == 0.0) {
            return;
        }
        if (coarse(f, s)) {
            open(s);
            return;
        }
        const SourceLight seen = visibility_.look(origins, key, s, f * light.high);
        if (seen.mixed && !nodes_[s].leaf() && f * light.high > kLargestMixedShare * tolerance_) {
            open(s);
            return;
        }
        out.illuminance += seen.light * f;
        out.variance += f * f * seen.variance;
        const std::int32_t parent = nodes_[s].leaf() ? nodes_[s].parent : -1;
        if (parent >= 0) {
            const double own = luminance(light.mean);
            const double share = own > 0.0 ? luminance(seen.light) / own : 0.0;
            const Vec3d more = (exitance_[parent].mean - light.mean) * (f * share);
            // Of a leaf that is near, what the point sees most isn't its mean: off by the first
            // power of its edge, and alike in all leaves about a corner. Of others by the second:
            // parents, of twice the edge, are off four times as far.
            const Vec3d to = nodes_[s].centre - origins.centre;
            const double distance = std::sqrt(dot(to, to));
            const double near = std::min(1.0, nodes_[s].radius / std::max(distance, 1e-300));
            out.unevenness += more * (near + (1.0 - near) / 3.0);
        }
    }

    // The same for all of an inner receiver; false where its children shall see to it.
    bool take_onto(std::int32_t r, const RayOrigins& origins, std::int32_t s,
                   std::array<Vec3d, 3>& linear, double& slack) {
        const RadiosityNode& receiver = nodes_[r];
        const NodeExitance& light = exitance_[s];
        const bool larger = nodes_[s].area > receiver.area;
        if (nodes_[s].cluster()) {
            if (faint(origins, receiver.radius, s)) {
                const SourceLight seen =
                    visibility_.look(origins, static_cast<std::uint64_t>(r), s, 0.0);
                for (Vec3d& at_corner : linear) {
                    at_corner += seen.light;
                }
                return true;
            }
            if (larger) {
                open(s);
            }
            return larger;
        }
        const double middle = factor(origins.centre, origins.normal, s);
        std::array<double, 3> corner;
        bool touches = false;
        for (std::size_t k = 0; k < 3; ++k) {
            const bool jumps = touching(receiver.corners[k], s); // the form factor, there
            touches = touches || jumps;
            corner[k] = jumps ? middle : factor(receiver.corners[k], origins.normal, s);
        }
        const double most = std::max({middle, corner[0], corner[1], corner[2]});
        if (most == 0.0) {
            // Nothing at four points; a source that is near may yet be seen between them.
            return nodes_[s].radius + receiver.radius < length(nodes_[s].centre - receiver.centre);
        }
        const double bend = middle - (corner[0] + corner[1] + corner[2]) / 3.0;
        const double off = touches ? middle : std::abs(bend);
        const bool uneven = off * light.high > kBend * tolerance_;
        const bool too_coarse = coarse(most, s);
        if (too_coarse && (!uneven || larger)) {
            open(s);
            return true;
        }
        if (uneven) {
            return false;
        }
        const SourceLight seen =
            visibility_.look(origins, static_cast<std::uint64_t>(r), s, most * light.high);
        if (seen.mixed) {
            if (most * light.high > slack) {
                if (larger && !nodes_[s].leaf()) {
                    open(s);
                    return true;
                }
                return false;
            }
            slack -= most * light.high;
        }
        for (std::size_t k = 0; k < 3; ++k) {
            // The mean of a quadratic is three quarters its middle, one quarter its corners' mean.
            linear[k] += seen.light * (corner[k] + 0.75 * bend);
        }
        return true;
    }

    SourceVisibility visibility_;
    const std::vector<RadiosityNode>& nodes_;
    std::span<const NodeExitance> exitance_;
    double tolerance_;
    std::vector<std::int32_t> pending_;
};

} // namespace

RadiosityExchange::RadiosityExchange(const Scene& scene, const RadiosityHierarchy& hierarchy,
                                     std::span<const NodeExitance> exitance, double tolerance,
                                     std::uint64_t seed)
    : scene_(scene), hierarchy_(hierarchy), exitance_(exitance), tolerance_(tolerance),
      seed_(mix64(seed)) {}

PointIlluminance RadiosityExchange::at_point(const Receiver& receiver, std::uint64_t key,
                                             std::uint64_t& rays) const {
    Exchange exchange(scene_, hierarchy_, exitance_, tolerance_, seed_);
    const PointIlluminance out = exchange.at_point(receiver, key);
    rays += exchange.rays();
    return out;
}

void RadiosityExchange::onto(std::int32_t element_side, std::span<Vec3d> received,
                             std::uint64_t& rays) const {
    Exchange exchange(scene_, hierarchy_, exitance_, tolerance_, seed_);
    exchange.onto(element_side, {0}, {}, kMixedSlack * tolerance_, received);
    rays += exchange.rays();
}

} // namespace isolux
