#include "core/photon_noise.h"

#include <algorithm>
#include <cmath>

namespace isolux {
namespace {

// Records that stand for all.
constexpr std::size_t kRecords = 64;
constexpr std::array kPaths{LightPath::direct, LightPath::indirect};

// Relative deviations of the light on a side of a mesh, one of each batch of photons: the sum of
// their squares is the variance, of their products the covariance. Photons that bounce light
// several sides, so that no count by itself tells it.
using Deviations = std::array<double, kBatches>;

double square(double x) { return x * x; }

struct SideLight {
    std::array<std::vector<Deviations>, 2> deviations; // of each path, one a side
    std::array<std::vector<double>, 2> kept;           // share of the light that is photons'
};

SideLight side_light(const IlluminationMesh& mesh, std::span<const Receiver> receivers,
                     const EachPathJoined& joined, const PhotonBuckets& buckets,
                     double photon_flux) {
    SideLight out;
    for (const LightPath path : kPaths) {
        const auto p = static_cast<std::size_t>(path);
        auto& sides = out.deviations[p];
        sides.resize(mesh_side_count(mesh));
        out.kept[p].resize(sides.size());
        for (std::size_t v = 0; v < receivers.size(); ++v) {
            const auto counts = buckets.batch_hit_counts(static_cast<std::int32_t>(v), path);
            Deviations& side = sides[mesh_side(receivers[v])];
            for (std::size_t b = 0; b < kBatches; ++b) {
                side[b] += static_cast<double>(counts[b]);
            }
        }
        constexpr double k = static_cast<double>(kBatches);
        for (std::size_t s = 0; s < sides.size(); ++s) {
            const double flux = joined[p]->side_flux[s];
            const double photon = flux > 0.0 ? photon_flux / flux : 0.0;
            double all = 0.0;
            for (const double count : sides[s]) {
                all += count;
            }
            out.kept[p][s] = std::min(1.0, all * photon);
            for (double& count : sides[s]) {
                count = (count - all / k) * photon * std::sqrt(k / (k - 1.0));
            }
        }
    }
    return out;
}

} // namespace

double photon_noise(const IlluminationMesh& mesh, std::span<const Receiver> receivers,
                    std::span<const GatherRecord> records, std::span<const Exitance> exitances,
                    std::span<const Vec3f> illuminance, const EachPathJoined& joined,
                    const PhotonBuckets& buckets, double photon_flux) {
    const SideLight sides = side_light(mesh, receivers, joined, buckets, photon_flux);
    const std::size_t vertices = receivers.size();
    std::vector<std::uint32_t> counts(vertices); // rays that hit each bucket
    std::vector<std::int32_t> hit;
    double common = 0.0, single = 0.0, squares = 0.0; // lx²
    double seen = 0.0, reflected_again = 0.0, kept = 0.0;
    const std::size_t step = (records.size() + kRecords - 1) / kRecords;
    for (std::size_t r = 0; r < records.size(); r += step) {
        const GatherRecord& record = records[r];
        hit.clear();
        for (const std::int32_t v : record.hits) { // those beyond the vertices are bright patches
            if (v >= 0 && static_cast<std::size_t>(v) < vertices && counts[v]++ == 0) {
                hit.push_back(v);
            }
        }
        const double n = record.rays();
        Deviations off{};
        for (const std::int32_t v : hit) {
            const double c = counts[v];
            counts[v] = 0;
            const double light = luminance(illuminance[v].as<double>());
            if (light <= 0.0) {
                continue;
            }
            const Exitance& e = exitances[v];
            const double share = c / n * luminance(Vec3f{e.x, e.y, e.z}.as<double>()) / light;
            const std::size_t side = mesh_side(receivers[v]);
            double variance = 0.0;
            for (const std::size_t p : {0U, 1U}) {
                const double part = share * luminance(joined[p]->illuminance[v].as<double>());
                for (std::size_t b = 0; b < kBatches; ++b) {
                    off[b] += part * sides.deviations[p][side][b];
                }
                variance += joined[p]->variance[v];
                seen += part;
                reflected_again += p == 1 ? part : 0.0;
                kept += p == 1 ? part * sides.kept[p][side] : 0.0;
            }
            // Of two rays that hit the same bucket: what single rays tell is part of their noise.
            single += share * share * (c > 1.0 ? (c - 1.0) / c * n / (n - 1.0) : 0.0) * variance;
        }
        for (const double of_batch : off) {
            common += of_batch * of_batch;
        }
        squares += square(luminance(record.illuminance.as<double>()));
    }
    if (squares <= 0.0) {
        return 0.0;
    }
    // What isn't the photons' own of the light that is reflected again was gathered with the same
    // error.
    const double again = seen > 0.0 ? (reflected_again - kept) / seen : 0.0;
    return (common / square(1.0 - again) + single) / squares;
}

} // namespace isolux
