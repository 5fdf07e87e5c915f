#include "core/lookup_error.h"

#include <algorithm>
#include <cstdint>
#include <vector>

#include "core/bucket_variation.h"

namespace isolux {
namespace {

// Records that stand for all.
constexpr std::size_t kRecords = 64;
// Of a bucket that a record sees as the share s of its hemisphere, the form factor varies by about
// the ratio of size and distance to both sides, whose square is 4 s for cosines of a half.
constexpr double kVariation = 4.0;

double square(double x) { return x * x; }

} // namespace

double lookup_error(const IlluminationMesh& mesh, std::span<const GatherRecord> records,
                    std::span<const Exitance> exitances, std::span<const Vec3f> illuminance) {
    const std::vector<double> means = photometric(illuminance);
    const std::vector<double> variance = bucket_variance(mesh, means);
    std::vector<std::uint32_t> counts(mesh.areas.size()); // rays that hit each bucket
    std::vector<std::int32_t> hit;
    double errors = 0.0, squares = 0.0;
    const std::size_t step = (records.size() + kRecords - 1) / kRecords;
    for (std::size_t r = 0; r < records.size(); r += step) {
        const GatherRecord& record = records[r];
        hit.clear();
        for (const std::int32_t v : record.hits) {
            if (v >= 0 && static_cast<std::size_t>(v) < counts.size() && counts[v]++ == 0) {
                hit.push_back(v);
            }
        }
        const double n = record.rays();
        for (const std::int32_t v : hit) {
            const double count = counts[v];
            counts[v] = 0;
            const double light = means[v];
            if (light <= 0.0 || count < 2.0) {
                continue;
            }
            const Exitance& e = exitances[v];
            const double reflected = luminance(Vec3f{e.x, e.y, e.z}.as<double>()) / light;
            const double within = variance[v] * std::min(1.0, kVariation * count / n);
            // Of two rays that hit the same bucket: what single rays tell is part of their noise.
            errors += square(reflected) * count * (count - 1.0) / (n * (n - 1.0)) * within;
        }
        squares += square(luminance(record.illuminance.as<double>()));
    }
    return squares > 0.0 ? errors / squares : 0.0;
}

} // namespace isolux
