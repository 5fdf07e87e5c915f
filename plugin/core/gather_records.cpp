#include "core/gather_records.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "core/sampling.h"
#include "core/sobol.h"

namespace isolux {
namespace {

// Sine and cosine within [-pi/4, pi/4], to 1e-8, by arithmetic alone.
double sine(double x) {
    const double s = x * x;
    return x * (1.0 - s / 6.0 * (1.0 - s / 20.0 * (1.0 - s / 42.0 * (1.0 - s / 72.0))));
}
double cosine(double x) {
    const double s = x * x;
    return 1.0 - s / 2.0 * (1.0 - s / 12.0 * (1.0 - s / 30.0 * (1.0 - s / 56.0)));
}

// The unit square to the unit disk, areas kept [Shirley & Chiu 1997].
std::array<float, 2> disk_point(const SobolPoint& p) {
    constexpr double kQuarter = 0.78539816339744831; // pi / 4
    const double a = 2.0 * p.u - 1.0, b = 2.0 * p.v - 1.0;
    if (a == 0.0 && b == 0.0) {
        return {0.0F, 0.0F};
    }
    const bool first = std::abs(a) > std::abs(b);
    const double r = first ? a : b;
    const double angle = kQuarter * (first ? b / a : a / b);
    const auto along = static_cast<float>(r * cosine(angle));
    const auto across = static_cast<float>(r * sine(angle));
    return first ? std::array{along, across} : std::array{across, along};
}

// Each vertex stands for the third of an element that lies nearest to it in barycentric terms.
std::int32_t bucket_of(const IlluminationMesh& mesh, const Hit& hit, const Vec3f& direction) {
    const MeshElement& element = mesh.elements[static_cast<std::size_t>(hit.triangle)];
    const float w = 1.0F - hit.u - hit.v;
    const std::size_t nearest = w >= hit.u && w >= hit.v ? 0U : (hit.u >= hit.v ? 1U : 2U);
    const std::int32_t vertex = element.vertices[nearest];
    if (dot(direction, hit.normal) <= 0.0F) {
        return vertex;
    }
    const Surface& surface = mesh.surfaces[static_cast<std::size_t>(element.surface)];
    return surface.back_offset < 0 ? -1 : vertex + surface.back_offset;
}

} // namespace

void trace_rays(const Scene& scene, const Receiver& receiver, std::uint64_t seed,
                std::uint32_t rays, GatherRecord& record) {
    const RayCaster& caster = scene.ray_caster();
    const Vec3f local = (receiver.position - caster.origin()).as<float>();
    const Vec3f from = local + receiver.normal * caster.offset(local, 0.0F);
    const auto [s, t] = tangents(receiver.normal);
    const std::uint64_t scramble = mix64(mix64(seed) + static_cast<std::uint64_t>(record.vertex));
    std::uint32_t index = record.rays();
    record.hits.reserve(rays);
    for (; index < rays; ++index) {
        const auto [a, b] = disk_point(sobol_point(index, scramble));
        const Vec3f direction =
            s * a + t * b + receiver.normal * std::sqrt(std::max(0.0F, 1.0F - a * a - b * b));
        const Hit hit = caster.closest_hit({from, direction});
        if (hit.triangle == kNoHit) {
            record.hits.push_back(-1);
            continue;
        }
        record.hits.push_back(bucket_of(scene.mesh(), hit, direction));
        record.inverse_distances += 1.0 / static_cast<double>(std::max(hit.distance, 1e-30F));
    }
}

void look_up(std::span<const Exitance> exitances, GatherRecord& record) {
    const std::size_t n = record.hits.size();
    std::array<Vec3d, 4> quarters{};
    double square = 0.0;
    for (std::size_t i = 0; i < n; ++i) {
        const std::int32_t hit = record.hits[i];
        if (hit < 0) {
            continue;
        }
        const Exitance& e = exitances[static_cast<std::size_t>(hit)];
        const Vec3d colour = Vec3f{e.x, e.y, e.z}.as<double>();
        quarters[4 * i / n] += colour;
        const double one = luminance(colour);
        square += one * one;
    }
    const double share = 1.0 / static_cast<double>(n);
    std::array<double, 4> means{};
    Vec3d sum;
    for (std::size_t q = 0; q < 4; ++q) {
        sum += quarters[q];
        means[q] = luminance(quarters[q]) * 4.0 * share;
    }
    const double mean = luminance(sum) * share;
    record.illuminance = (sum * share).as<float>();
    record.ray_variance = std::max(0.0, square * share - mean * mean);
    const double halves = 0.5 * (means[0] + means[1] - means[2] - means[3]);
    const double first = means[0] - means[1], second = means[2] - means[3];
    record.half_square = 0.25 * halves * halves;
    record.quarter_square = 0.125 * (first * first + second * second);
}

} // namespace isolux
