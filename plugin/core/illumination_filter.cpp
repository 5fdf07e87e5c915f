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

FilteredIllumination IlluminationFilter::filter(const PhotonBuckets& buckets, LightPath path,
                                                double photon_flux, const FilterSettings& settings,
                                                int threads) const {
    const std::size_t n = positions_.size();
    std::array<std::vector<double>, 2> counts{std::vector<double>(n), std::vector<double>(n)};
    std::vector<double> seen(n);
    for (std::size_t v = 0; v < n; ++v) {
        const auto vertex = static_cast<std::int32_t>(v);
        const auto halves = buckets.half_hit_counts(vertex, path);
        counts[0][v] = static_cast<double>(halves[0]);
        counts[1][v] = static_cast<double>(halves[1]);
        const auto all = static_cast<double>(buckets.hit_count(vertex, LightPath::direct) +
                                             buckets.hit_count(vertex, LightPath::indirect));
        seen[v] = mesh_.areas[v] > 0.0
                      ? all * photon_flux / mesh_.areas[v] * reflectance_[v] / std::numbers::pi
                      : 0.0;
    }
    const SupportCriteria criteria{settings.accuracy * std::numbers::sqrt2, 2.0 * photon_flux,
                                   dark_luminance(adaptation_luminance(seen, mesh_.areas)),
                                   IntervalTable(settings.rule)};

    FilteredIllumination out{std::vector<std::array<FilteredIllumination::Half, 2>>(n),
                             std::vector<Vec3f>(n), std::vector<float>(n, 1.0F),
                             std::vector<float>(n)};
    const auto order = tree_.spatial_order();
    const auto filter_block = [&](std::size_t begin, std::size_t end) {
        SupportSelection selection(*this, counts, criteria);
        std::vector<bool> done(end - begin, false);
        for (std::size_t i = begin; i < end; ++i) {
            if (done[i - begin]) {
                continue;
            }
            std::array<FilteredIllumination::Half, 2> halves{};
            Vec3d colours;
            double hits = 0.0, estimate = 0.0, variance = 0.0;
            float least_radius = std::numeric_limits<float>::infinity(), radius = 0.0F;
            const auto supports = selection.select(static_cast<std::int32_t>(order[i]));
            for (const std::size_t half : {0U, 1U}) {
                const Support& support = supports[half];
                double other_hits = 0.0;
                for (const auto& member : selection.accepted().first(support.size)) {
                    other_hits += counts[1 - half][member.vertex];
                    colours += buckets.colour_sum(member.vertex, path);
                    hits += counts[0][member.vertex] + counts[1][member.vertex];
                }
                const double to_illuminance =
                    support.area > 0.0 ? criteria.photon_flux / support.area : 0.0;
                halves[half] = {static_cast<float>(other_hits * to_illuminance), support.area};
                estimate += 0.5 * other_hits * to_illuminance;
                variance += 0.25 * other_hits * to_illuminance * to_illuminance;
                least_radius = std::min(least_radius, support.radius);
                radius = std::max(radius, support.radius);
            }
            const Vec3f illuminance = (colours * (hits > 0.0 ? estimate / hits : 0.0)).as<float>();
            const float deviation =
                estimate > 0.0 ? static_cast<float>(std::sqrt(variance) / estimate) : 1.0F;
            const auto assign = [&](std::size_t v) {
                out.halves[v] = halves;
                out.illuminance[v] = illuminance;
                out.relative_deviation[v] = deviation;
                out.support_radius[v] = radius;
                done[rank_[v] - begin] = true;
            };
            assign(order[i]);
            const float sharing_radius = least_radius * static_cast<float>(settings.sharing);
            for (const auto& member : selection.accepted()) {
                if (member.squared_distance > sharing_radius * sharing_radius) {
                    break;
                }
                const std::size_t rank = rank_[member.vertex];
                if (rank >= begin && rank < end && !done[rank - begin]) {
                    assign(static_cast<std::size_t>(member.vertex));
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
