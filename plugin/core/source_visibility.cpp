#include "core/source_visibility.h"

#include <algorithm>
#include <array>
#include <numbers>

#include "core/random.h"
#include "core/sobol.h"
#include "core/triangle_region.h"

namespace isolux {
namespace {

constexpr double kPi = std::numbers::pi;

// Visibility rays of an interaction: some, and more where they disagree.
constexpr std::uint32_t kProbes = 4, kRays = 16;

} // namespace

SourceLight SourceVisibility::look(const RayOrigins& origins, std::uint64_t key, std::int32_t s,
                                   double brings) {
    const std::uint64_t pair = mix64(mix64(seed_ + key) + static_cast<std::uint64_t>(s));
    const RadiosityNode& source = nodes_[s];
    // Only points that face each other.
    const TriangleRegion to_region =
        source.cluster() ? TriangleRegion(Triangle{})
                         : TriangleRegion(source.corners, origins.centre, origins.normal);
    const TriangleRegion from_region =
        origins.node == nullptr ? TriangleRegion(Triangle{})
        : source.cluster()      ? TriangleRegion(origins.node->corners)
                           : TriangleRegion(origins.node->corners, source.centre, source.normal);
    std::array<double, kRays> weights, values;
    double weight = 0.0, least = 1.0, most = 0.0; // of the shares seen
    SourceLight out;
    std::uint32_t count = 0, used = 0;
    for (const std::uint32_t end : {kProbes, kRays}) {
        for (; count < end; ++count) {
            Vec3d from = origins.centre;
            if (origins.node != nullptr) {
                const auto [u, v] = sobol_point(count, ~pair);
                from = from_region.point(u, v);
                if (origins.node->hidden && !origins.node->leaf()) {
                    const auto r = static_cast<std::int32_t>(origins.node - nodes_.data());
                    if (nodes_[triangle_point(r, from).leaf].hidden) {
                        continue; // it will get nothing
                    }
                }
            }
            const auto [u, v] = sobol_point(count, pair);
            const SourcePoint at = source.cluster() ? cluster_point(s, u, v)
                                                    : triangle_point(s, to_region.point(u, v));
            const Vec3d& normal = nodes_[at.leaf].normal;
            const Vec3d to = at.position - from;
            const double d2 = dot(to, to);
            const double cosines =
                std::max(0.0, dot(to, origins.normal)) * std::max(0.0, -dot(to, normal));
            if (cosines <= 0.0) {
                continue;
            }
            const double w = cosines / (d2 * d2);
            weight += w;
            weights[used] = w;
            const double visible = sees(from, origins.normal, at.position, normal);
            least = std::min(least, visible);
            most = std::max(most, visible);
            out.light += exitance_[at.leaf].mean * (w * visible);
            values[used] = luminance(exitance_[at.leaf].mean) * visible;
            ++used;
        }
        out.mixed = least < most;
        if (!out.mixed || brings < 0.25 * tolerance_) {
            break;
        }
    }
    if (weight <= 0.0) {
        return {};
    }
    const double scale = source.cluster() ? source.area / (kPi * count) : 1.0 / weight;
    out.light = out.light * scale;
    const double mean = luminance(out.light) / (scale * weight);
    for (std::uint32_t k = 0; k < used; ++k) { // of a ratio of sums
        const double off = weights[k] * (values[k] - mean) * scale;
        out.variance += off * off;
    }
    return out;
}

// u, v uniform in [0, 1): uniform over the cluster's area.
SourceVisibility::SourcePoint SourceVisibility::cluster_point(std::int32_t s, double u,
                                                              double v) const {
    while (nodes_[s].cluster()) {
        const std::int32_t child = nodes_[s].first_child;
        const double first = nodes_[child].area / nodes_[s].area;
        const bool second = u >= first;
        u = second ? (u - first) / (1.0 - first) : u / first;
        s = second ? child + 1 : child;
    }
    return triangle_point(s, TriangleRegion(nodes_[s].corners).point(u, v));
}

// Finds the leaf of a triangle where a point of it is.
SourceVisibility::SourcePoint SourceVisibility::triangle_point(std::int32_t s,
                                                               const Vec3d& position) const {
    if (nodes_[s].leaf()) {
        return {position, s};
    }
    const Triangle& t = nodes_[s].corners;
    std::array<double, 3> b;
    for (std::size_t k = 0; k < 3; ++k) {
        const Vec3d &p = t[(k + 1) % 3], &q = t[(k + 2) % 3];
        b[k] = dot(cross(p - position, q - position), nodes_[s].normal) / (2.0 * nodes_[s].area);
    }
    while (!nodes_[s].leaf()) {
        std::int32_t child = 3;
        for (std::int32_t k = 0; k < 3; ++k) {
            child = b[k] >= 0.5 ? k : child;
        }
        for (std::int32_t k = 0; k < 3; ++k) {
            b[k] = child == 3 ? 1.0 - 2.0 * b[k] : 2.0 * b[k] - (child == k ? 1.0 : 0.0);
        }
        s = nodes_[s].first_child + child;
    }
    return {position, s};
}

// Share of the light that passes.
double SourceVisibility::sees(const Vec3d& from, const Vec3d& from_normal, const Vec3d& to,
                              const Vec3d& to_normal) {
    ++rays_;
    const auto off_surface = [this](const Vec3d& p, const Vec3d& n) {
        const Vec3f local = (p - caster_.origin()).as<float>();
        return local + n.as<float>() * caster_.offset(local, 0.0F);
    };
    const Vec3f a = off_surface(from, from_normal), b = off_surface(to, to_normal);
    return static_cast<double>(caster_.transmitted(Ray{a, b - a}));
}

} // namespace isolux
