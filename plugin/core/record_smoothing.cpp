#include "core/record_smoothing.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

#include "core/joined_illuminance.h"

namespace isolux {
namespace {

// Rays that a record is thought to have beside its own, of the variance of all records: one whose
// few rays missed the one bright spot that it sees would look exact.
constexpr double kPooledRays = 1.0;
// Share of a record's rays that meet something nearer than the next vertex, above which it lies
// where surfaces meet. Rays that bounce on there do so by chance: of the variance of a thousand
// independent rays a sequence leaves 42 %, elsewhere 5 % (box).
constexpr float kClose = 0.3F;
// Records of all places that those of one are thought to have beside their own.
constexpr double kPooledRecords = 16.0;

// 1 where surfaces meet, else 0.
std::size_t place(const GatherRecord& record) {
    const auto close = static_cast<float>(record.close_rays);
    return close > kClose * static_cast<float>(record.rays()) ? 1 : 0;
}

// Of one ray, to the record's; there are some.
std::size_t doublings(const GatherRecord& record) {
    return static_cast<std::size_t>(std::bit_width(record.rays())) - 1;
}

} // namespace

// The variance of n points of a sequence falls as n^-slope. The squared difference of a record's
// halves over 4 has the mean Var(n/2) - Var(n), that of its quarters Var(n/4) - Var(n/2).
void RecordSmoothing::estimate_noise(std::span<const GatherRecord> records,
                                     std::span<const std::int32_t> lit) {
    struct Squares {
        double halves = 0.0, quarters = 0.0;          // lx² m²
        std::array<double, kDoublings> independent{}; // of one ray, by the rays that there are
    };
    std::array<Squares, kPlaces> squares{};
    double pooled = 0.0;
    for (const std::int32_t v : lit) {
        const GatherRecord& r = records[v];
        if (r.rays() > 0) {
            const double area = mesh_.areas[v];
            Squares& here = squares[place(r)];
            here.halves += area * r.half_square;
            here.quarters += area * r.quarter_square;
            here.independent[doublings(r)] += area * r.ray_variance;
            pooled += r.ray_variance;
        }
    }
    const double count = std::max(1.0, static_cast<double>(lit.size()));
    pooled_variance_ = pooled / count;
    for (std::size_t p = 0; p < kPlaces; ++p) {
        const auto sum = [&](const auto& of) {
            double out = of(squares[p]);
            for (const Squares& of_place : squares) {
                out += kPooledRecords / count * of(of_place);
            }
            return out;
        };
        const double halves = sum([](const Squares& of) { return of.halves; });
        const double quarters = sum([](const Squares& of) { return of.quarters; });
        if (halves <= 0.0) {
            continue; // nothing tells it
        }
        const double slope = std::clamp(std::log2(quarters / halves), 1.0, 2.0);
        const auto fallen = [&](std::size_t k) {
            return std::exp2(-slope * static_cast<double>(k));
        };
        const double independent = sum([&](const Squares& of) {
            double out = 0.0;
            for (std::size_t k = 0; k < kDoublings; ++k) {
                out += of.independent[k] * fallen(k);
            }
            return out;
        });
        if (independent > 0.0) {
            const double one = halves / (std::exp2(slope) - 1.0) / independent;
            for (std::size_t k = 0; k < kDoublings; ++k) {
                left_[p][k] = std::min(1.0, one * fallen(k) * std::exp2(k));
            }
        }
    }
}

double RecordSmoothing::ray_variance(const GatherRecord& record) const {
    const double n = record.rays();
    const double variance =
        (n * record.ray_variance + kPooledRays * pooled_variance_) / (n + kPooledRays);
    const double left = n > 0.0 ? left_[place(record)][doublings(record)] : 1.0;
    return left * variance + n * record.bright_noise;
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
