#include "core/rms_error.h"

#include <algorithm>
#include <cmath>

#include "core/filter_error.h"

namespace isolux {
namespace {

struct Sums {
    double area = 0.0, flux = 0.0;    // m², lm
    double square = 0.0, noise = 0.0; // m²·lx²: squared error, and the part of it that is noise

    double relative() const {
        return flux > 0.0 ? std::sqrt(std::max(0.5 * noise, square) / area) / (flux / area) : 0.0;
    }
};

double square(float x) { return static_cast<double>(x) * static_cast<double>(x); }

// n times the variance of the mean count of a batch, thus the variance of the sum of all.
double batch_variance(const std::array<std::uint32_t, kBatches>& a,
                      const std::array<std::uint32_t, kBatches>& b) {
    double sum = 0.0, square = 0.0;
    for (std::size_t i = 0; i < kBatches; ++i) {
        const double n = static_cast<double>(a[i]) + static_cast<double>(b[i]);
        sum += n;
        square += n * n;
    }
    constexpr double k = static_cast<double>(kBatches);
    return k / (k - 1.0) * (square - sum * sum / k);
}

// The same of one bucket. f takes from it by the share that it is of the support.
FilteredSquares bucket_squares(const FilteredIllumination::Halves& halves,
                               const std::array<std::uint64_t, 2>& half_counts, double e,
                               double photon_flux) {
    std::array<double, 2> filtered{}, shares{};
    for (const std::size_t half : {0U, 1U}) {
        const auto& [illuminance, support_area] = halves[half];
        filtered[half] = static_cast<double>(illuminance);
        shares[half] = support_area > 0.0 ? 2.0 * photon_flux / support_area : 0.0;
    }
    return filtered_squares(filtered, shares, half_counts, e);
}

} // namespace

RmsErrors rms_errors(const IlluminationMesh& mesh, const PhotonBuckets& buckets, double photon_flux,
                     const FilteredIllumination& direct, const FilteredIllumination& indirect) {
    Sums bucket_total, bucket_indirect, batch, filtered_total, filtered_indirect;
    for (std::size_t v = 0; v < mesh.areas.size(); ++v) {
        const double area = mesh.areas[v];
        if (area == 0.0) {
            continue;
        }
        const auto vertex = static_cast<std::int32_t>(v);
        const auto direct_halves = buckets.half_hit_counts(vertex, LightPath::direct);
        const auto indirect_halves = buckets.half_hit_counts(vertex, LightPath::indirect);
        const double e = photon_flux / area; // lx a photon
        const double hits_direct = static_cast<double>(direct_halves[0] + direct_halves[1]) * e;
        const double hits_indirect =
            static_cast<double>(indirect_halves[0] + indirect_halves[1]) * e;
        const double hits = hits_direct + hits_indirect;
        const auto add = [&](Sums& sums, double illuminance, double squared_error, double noise) {
            sums.area += area;
            sums.flux += area * illuminance;
            sums.square += area * squared_error;
            sums.noise += area * noise;
        };
        add(bucket_total, hits, hits * e, 0.0);
        add(bucket_indirect, hits_indirect, hits_indirect * e, 0.0);
        add(batch, hits,
            batch_variance(buckets.batch_hit_counts(vertex, LightPath::direct),
                           buckets.batch_hit_counts(vertex, LightPath::indirect)) *
                e * e,
            0.0);

        // (f - I)² = f² - 2 f I + I². Direct and indirect counts are independent.
        const auto d = bucket_squares(direct.halves[v], direct_halves, e, photon_flux);
        const auto i = bucket_squares(indirect.halves[v], indirect_halves, e, photon_flux);
        const double f = d.filtered + i.filtered;
        const double with_truth =
            d.with_truth + i.with_truth + d.filtered * hits_indirect + i.filtered * hits_direct;
        const double offset_direct = square(direct.offset[v]);
        const double offset_indirect = square(indirect.offset[v]);
        add(filtered_total, hits,
            f * f - 2.0 * with_truth + hits * (hits - e) + offset_direct + offset_indirect,
            d.noise + i.noise);
        add(filtered_indirect, hits_indirect,
            i.filtered * i.filtered - 2.0 * i.with_truth + hits_indirect * (hits_indirect - e) +
                offset_indirect,
            i.noise);
    }
    return {bucket_total.relative(), bucket_indirect.relative(), batch.relative(),
            filtered_total.relative(), filtered_indirect.relative()};
}

} // namespace isolux
