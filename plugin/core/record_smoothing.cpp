#include "core/record_smoothing.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "core/joined_illuminance.h"

namespace isolux {
namespace {

// Rays that a record is thought to have beside its own, of the variance of all records: one whose
// few rays missed the one bright spot that it sees would look exact.
constexpr double kPooledRays = 1.0;

} // namespace

// The variance of n points of a sequence falls as n^-slope. The squared difference of its halves
// over 4 has the mean Var(n/2) - Var(n), that of its quarters Var(n/4) - Var(n/2).
void RecordSmoothing::estimate_noise(std::span<const GatherRecord> records,
                                     std::span<const std::int32_t> lit) {
    double halves = 0.0, quarters = 0.0, independent = 0.0, pooled = 0.0;
    for (const std::int32_t v : lit) {
        const GatherRecord& r = records[v];
        if (r.rays() > 0) {
            const double area = mesh_.areas[v];
            halves += area * r.half_square;
            quarters += area * r.quarter_square;
            independent += area * r.ray_variance / r.rays();
            pooled += r.ray_variance;
        }
    }
    pooled_variance_ = lit.empty() ? 0.0 : pooled / static_cast<double>(lit.size());
    if (halves > 0.0 && independent > 0.0) {
        const double slope = std::clamp(std::log2(quarters / halves), 1.0, 2.0);
        noise_share_ = std::min(1.0, halves / (std::exp2(slope) - 1.0) / independent);
    }
}

double RecordSmoothing::ray_variance(const GatherRecord& record) const {
    const double n = record.rays();
    const double variance =
        (n * record.ray_variance + kPooledRays * pooled_variance_) / (n + kPooledRays);
    return noise_share_ * variance + n * record.bright_noise;
}

void RecordSmoothing::smooth(std::span<const GatherRecord> records,
                             std::span<const std::int32_t> lit, std::span<SmoothIlluminance> out,
                             int threads) {
    estimate_noise(records, lit);
    std::vector<NoisyIlluminance> values(records.size());
    for (const std::int32_t v : lit) {
        const GatherRecord& record = records[v];
        values[v] = {record.illuminance, static_cast<float>(ray_variance(record)),
                     static_cast<float>(record.rays())};
    }
    regression_.fit(values, out, threads);
    // Planes fall short of light that drops towards an edge: each side keeps the mean of its rays.
    // A vertex whose own rays are sure has lost nothing, and takes no part.
    const auto taken = [&](std::int32_t v) { return std::sqrt(out[v].taken); };
    std::vector<std::array<double, 2>> flux(mesh_side_count(mesh_)); // lm: lost, taken
    for (const std::int32_t v : lit) {
        const double area = mesh_.areas[v];
        const double fitted = luminance(out[v].illuminance.as<double>());
        auto& [lost, part] = flux[mesh_side(receivers_[v])];
        lost += area * (luminance(records[v].illuminance.as<double>()) - fitted);
        part += area * static_cast<double>(taken(v)) * fitted;
    }
    for (const std::int32_t v : lit) {
        const auto [lost, part] = flux[mesh_side(receivers_[v])];
        if (part > 0.0) {
            const auto more = static_cast<float>(std::max(-1.0, lost / part));
            out[v].illuminance = out[v].illuminance * (1.0F + taken(v) * more);
        }
    }
}

} // namespace isolux
