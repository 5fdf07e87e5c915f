#include "core/illumination_filter.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include "core/support_selection.h"
#include "core/tone_mapping.h"

namespace isolux {
namespace {

// Vertices are filtered in blocks of neighbours; values are shared within a block only, so that
// the outcome does not depend on which thread takes which block.
constexpr std::size_t kBlock = 1024;

// Relative to the largest coordinate: floats of recentred positions resolve 2^-24 of it.
constexpr float kCoincident = 0x1p-22F;

std::vector<Vec3f> recentred(const std::vector<Vec3d>& positions) {
    Vec3d sum;
    for (const auto& p : positions) {
        sum += p;
    }
    const Vec3d centre =
        sum * (1.0 / static_cast<double>(std::max<std::size_t>(1, positions.size())));
    std::vector<Vec3f> out(positions.size());
    std::ranges::transform(positions, out.begin(),
                           [&](const Vec3d& p) { return (p - centre).as<float>(); });
    return out;
}

float least_squared_radius(std::span<const Vec3f> positions) {
    float largest = std::numeric_limits<float>::min();
    for (const auto& p : positions) {
        largest = std::max({largest, std::abs(p.x), std::abs(p.y), std::abs(p.z)});
    }
    const float radius = kCoincident * largest;
    return std::max(radius * radius, std::numeric_limits<float>::min());
}

// Area-weighted over the elements around each vertex, both sides alike.
std::vector<double> luminance_reflectance(const IlluminationMesh& mesh) {
    std::vector<double> sum(mesh.areas.size(), 0.0), weight(mesh.areas.size(), 0.0);
    for (const auto& element : mesh.elements) {
        const Surface& surface = mesh.surfaces[static_cast<std::size_t>(element.surface)];
        const double reflectance = luminance(surface.reflectance.as<double>());
        for (const std::int32_t front : element.vertices) {
            for (const std::int32_t v :
                 {front, surface.back_offset < 0 ? front : front + surface.back_offset}) {
                sum[v] += reflectance;
                weight[v] += 1.0;
            }
        }
    }
    for (std::size_t v = 0; v < sum.size(); ++v) {
        sum[v] /= std::max(1.0, weight[v]);
    }
    return sum;
}

constexpr std::array kLightPaths{LightPath::direct, LightPath::indirect};

// One vertex's filtered light of one light path.
struct VertexEstimate {
    FilteredIllumination::Halves halves{};
    Vec3f illuminance;
    float relative_deviation = 1.0F;
    float radius = 0.0F, least_radius = 0.0F;
};

VertexEstimate estimate(const PhotonBuckets& buckets, LightPath path,
                        const std::array<std::vector<double>, 2>& counts,
                        std::span<const Neighbour> accepted, const std::array<Support, 2>& supports,
                        double half_photon_flux) {
    VertexEstimate out;
    Vec3d colours;
    double hits = 0.0, illuminance = 0.0, variance = 0.0;
    for (const std::size_t half : {0U, 1U}) {
        const Support& support = supports[half];
        double other_hits = 0.0;
        for (const auto& member : accepted.first(support.size)) {
            other_hits += counts[1 - half][member.vertex];
            hits += counts[0][member.vertex] + counts[1][member.vertex];
            colours += buckets.colour_sum(member.vertex, path);
        }
        const double to_illuminance = support.area > 0.0 ? half_photon_flux / support.area : 0.0;
        out.halves[half] = {static_cast<float>(other_hits * to_illuminance), support.area};
        illuminance += 0.5 * other_hits * to_illuminance;
        variance += 0.25 * other_hits * to_illuminance * to_illuminance;
    }
    out.illuminance = (colours * (hits > 0.0 ? illuminance / hits : 0.0)).as<float>();
    if (illuminance > 0.0) {
        out.relative_deviation = static_cast<float>(std::sqrt(variance) / illuminance);
    }
    out.radius = std::max(supports[0].radius, supports[1].radius);
    out.least_radius = std::min(supports[0].radius, supports[1].radius);
    return out;
}

void assign(const VertexEstimate& estimate, std::size_t vertex, FilteredIllumination& out) {
    out.halves[vertex] = estimate.halves;
    out.illuminance[vertex] = estimate.illuminance;
    out.relative_deviation[vertex] = estimate.relative_deviation;
    out.support_radius[vertex] = estimate.radius;
}

} // namespace

IlluminationFilter::IlluminationFilter(const IlluminationMesh& mesh)
    : mesh_(mesh), positions_(recentred(mesh.positions)), reflectance_(luminance_reflectance(mesh)),
      component_sizes_(mesh.positions.size()),
      least_squared_radius_(least_squared_radius(positions_)), tree_(positions_, {}),
      connected_tree_(positions_, mesh.components), rank_(mesh.positions.size()) {
    for (const std::int32_t component : mesh.components) {
        ++component_sizes_[component];
    }
    for (std::size_t v = 0; v < component_sizes_.size(); ++v) {
        component_sizes_[v] = component_sizes_[mesh.components[v]]; // roots come first
    }
    const auto order = tree_.spatial_order();
    for (std::size_t i = 0; i < order.size(); ++i) {
        rank_[order[i]] = static_cast<std::uint32_t>(i);
    }
}

std::array<FilteredIllumination, 2> IlluminationFilter::filter(const PhotonBuckets& buckets,
                                                               double photon_flux,
                                                               const FilterSettings& settings,
                                                               int threads) const {
    const std::size_t n = positions_.size();
    SupportSelection::Counts counts;
    std::vector<double> seen(n); // cd/m²
    for (const LightPath path : kLightPaths) {
        auto& [even, odd] = counts[static_cast<std::size_t>(path)];
        even.resize(n);
        odd.resize(n);
        for (std::size_t v = 0; v < n; ++v) {
            const auto halves = buckets.half_hit_counts(static_cast<std::int32_t>(v), path);
            even[v] = static_cast<double>(halves[0]);
            odd[v] = static_cast<double>(halves[1]);
            if (mesh_.areas[v] > 0.0) {
                seen[v] += (even[v] + odd[v]) * photon_flux / mesh_.areas[v] * reflectance_[v] /
                           std::numbers::pi;
            }
        }
    }
    const SupportCriteria criteria{settings.accuracy * std::numbers::sqrt2, 2.0 * photon_flux,
                                   dark_luminance(adaptation_luminance(seen, mesh_.areas)),
                                   IntervalTable(settings.rule)};

    std::array<FilteredIllumination, 2> out;
    for (auto& filtered : out) {
        filtered = {std::vector<FilteredIllumination::Halves>(n), std::vector<Vec3f>(n),
                    std::vector<float>(n), std::vector<float>(n)};
    }
    const auto order = tree_.spatial_order();
    const auto filter_block = [&](std::size_t begin, std::size_t end) {
        SupportSelection selection(*this, counts, criteria);
        std::vector<std::array<bool, 2>> wanted(end - begin, {true, true});
        for (std::size_t i = begin; i < end; ++i) {
            const std::array<bool, 2> here = wanted[i - begin];
            if (!here[0] && !here[1]) {
                continue;
            }
            const auto supports = selection.select(static_cast<std::int32_t>(order[i]), here);
            for (const LightPath light : kLightPaths) {
                const auto path = static_cast<std::size_t>(light);
                if (!here[path]) {
                    continue;
                }
                const VertexEstimate found =
                    estimate(buckets, light, counts[path], selection.accepted(), supports[path],
                             criteria.photon_flux);
                assign(found, order[i], out[path]);
                const float sharing_radius =
                    found.least_radius * static_cast<float>(settings.sharing);
                for (const auto& member : selection.accepted()) {
                    if (member.squared_distance > sharing_radius * sharing_radius) {
                        break;
                    }
                    const std::size_t rank = rank_[member.vertex];
                    if (rank > i && rank < end && wanted[rank - begin][path]) {
                        wanted[rank - begin][path] = false;
                        assign(found, static_cast<std::size_t>(member.vertex), out[path]);
                    }
                }
            }
        }
    };
    tbb::task_arena(threads).execute([&] {
        tbb::parallel_for(std::size_t{0}, (n + kBlock - 1) / kBlock, [&](std::size_t block) {
            filter_block(block * kBlock, std::min(n, (block + 1) * kBlock));
        });
    });
    return out;
}

} // namespace isolux
