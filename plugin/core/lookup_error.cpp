#include "core/lookup_error.h"

#include <algorithm>
#include <vector>

#include "core/bucket_variation.h"

namespace isolux {
namespace {

// Records that stand for all.
constexpr std::size_t kRecords = 1024;

// What each vertex reflects of the light that the mean over its bucket exceeds it by; lm/m².
std::vector<double> reflected_offset(const IlluminationMesh& mesh,
                                     std::span<const Exitance> exitances,
                                     std::span<const Vec3f> illuminance) {
    const std::vector<double> means = photometric(illuminance);
    std::vector<double> out = bucket_offset(mesh, means);
    for (std::size_t v = 0; v < out.size(); ++v) {
        out[v] *= means[v] > 0.0 ? photometric(exitances[v]) / means[v] : 0.0;
    }
    return out;
}

double square(double x) { return x * x; }

} // namespace

LookupError lookup_error(const IlluminationMesh& mesh, std::span<const GatherRecord> records,
                         std::span<const Exitance> exitances, std::span<const Vec3f> illuminance) {
    const std::vector<double> offset = reflected_offset(mesh, exitances, illuminance);
    double errors = 0.0, squares = 0.0, areas = 0.0;
    const std::size_t step = (records.size() + kRecords - 1) / kRecords;
    for (std::size_t r = 0; r < records.size(); r += step) {
        const GatherRecord& record = records[r];
        const double n = record.rays(), area = mesh.areas[record.vertex];
        if (n < 2.0) {
            continue;
        }
        double sum = 0.0, own = 0.0;
        for_each_lookup(record, offset.size(), [&](std::size_t v, double weight) {
            sum += weight * offset[v];
            own += square(weight * offset[v]);
        });
        // Of each two rays: the squares of single ones are part of their noise.
        errors += area * (sum * sum - own) / (n * (n - 1.0));
        squares += area * square(luminance(record.illuminance.as<double>()));
        areas += area;
    }
    if (squares <= 0.0) {
        return {};
    }
    errors = std::max(0.0, errors);
    return {errors / areas, errors / squares};
}

} // namespace isolux
