#include "core/local_regression.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "core/parallel.h"
#include "core/sampling.h"

namespace isolux {
namespace {

// Vertices whose normals lie further apart are not neighbours.
constexpr float kLeastCosine = 0.7F;

// Rays that a value is thought to have beside its own, of the variance of those around.
constexpr double kPooledRays = 4.0;
// Standard deviations of the residuals' sum, of curvature that chance may have hidden. Cornell box
// at 300,000 photons: intervals hold the truth a point more often than of 1; 3 tells 1.28 of its
// error.
constexpr double kHidden = 2.0;
// Square height of a bowl, in its variances, that is put down to chance. Hall of 600 luminaires: 2
// errs by 3 % more, 4 as without bowls; office: 4 errs by 2 to 6 % less than without.
constexpr double kBowl = 4.0;
// Of what a vertex's own rays say otherwise, what those of each beside it count.
constexpr float kBeside = 0.5F;
// Of its noise, the variance of what too few values around a vertex tell of it.
constexpr float kUnknown = 1e6F;

// A symmetric matrix of three rows.
struct Normal {
    double a00 = 0, a01 = 0, a02 = 0, a11 = 0, a12 = 0, a22 = 0;

    void add(double w, double x, double y) {
        a00 += w;
        a01 += w * x;
        a02 += w * y;
        a11 += w * x * x;
        a12 += w * x * y;
        a22 += w * y * y;
    }
    Normal inverse() const {
        const double c00 = a11 * a22 - a12 * a12, c01 = a02 * a12 - a01 * a22,
                     c02 = a01 * a12 - a02 * a11;
        const double d = 1.0 / (a00 * c00 + a01 * c01 + a02 * c02);
        return {c00 * d,
                c01 * d,
                c02 * d,
                (a00 * a22 - a02 * a02) * d,
                (a01 * a02 - a00 * a12) * d,
                (a00 * a11 - a01 * a01) * d};
    }
    std::array<double, 3> operator*(const std::array<double, 3>& b) const {
        return {a00 * b[0] + a01 * b[1] + a02 * b[2], a01 * b[0] + a11 * b[1] + a12 * b[2],
                a02 * b[0] + a12 * b[1] + a22 * b[2]};
    }
};

struct Sample {
    double x, y, value, noise, structure; // m, m, lx, lx², (d/h)²
    std::int32_t vertex;
    double weight = 0.0; // 1/lx², by its noise and how far light there is from a plane
};

// Light that lies above its plane all around, or below: the averages of such are wrong, all the
// same way, however many.
struct Bowl {
    double height = 0.0, variance = 0.0; // lx, lx², at the distance h; none is 0 and sure
};

// inverse : of the plane's normal equations
Bowl fit_bowl(std::span<const Sample> samples, const Normal& inverse) {
    std::array<double, 3> values{}, bowls{};
    for (const Sample& p : samples) {
        const std::array<double, 3> row{p.weight, p.weight * p.x, p.weight * p.y};
        for (std::size_t k = 0; k < 3; ++k) {
            values[k] += row[k] * p.value;
            bowls[k] += row[k] * p.structure;
        }
    }
    const std::array<double, 3> light = inverse * values, plane = inverse * bowls;
    double both = 0.0, square = 0.0;
    for (const Sample& p : samples) {
        const double r = p.structure - plane[0] - plane[1] * p.x - plane[2] * p.y;
        const double off = p.value - light[0] - light[1] * p.x - light[2] * p.y;
        both += r * off * p.weight;
        square += r * r * p.weight;
    }
    if (square <= 0.0) {
        return {};
    }
    const double height = both / square, chance = 1.0 / square;
    const double real = height * height - kBowl * chance;
    if (real <= 0.0) {
        return {};
    }
    const double share = real / (real + chance);
    return {share * height, share * chance};
}

} // namespace

LocalRegression::LocalRegression(const IlluminationMesh& mesh, std::span<const Receiver> receivers)
    : receivers_(receivers), begin_(receivers.size() + 1) {
    const auto each_edge = [&](const auto& turn) { // in both directions, once a side of an element
        for_each_side(mesh, [&](const MeshElement&, const auto& vertices) {
            for (std::size_t k = 0; k < 3; ++k) {
                const std::int32_t a = vertices[k], b = vertices[(k + 1) % 3];
                if (a != b && dot(receivers[a].normal, receivers[b].normal) >= kLeastCosine) {
                    turn(a, b);
                    turn(b, a);
                }
            }
        });
    };
    each_edge([&](std::int32_t a, std::int32_t) { ++begin_[a + 1]; });
    std::partial_sum(begin_.begin(), begin_.end(), begin_.begin());
    neighbours_.resize(static_cast<std::size_t>(begin_.back()));
    std::vector<std::int32_t> end(begin_.begin(), begin_.end() - 1);
    each_edge([&](std::int32_t a, std::int32_t b) { neighbours_[end[a]++] = b; });
    // An edge inside of a surface came twice.
    std::int32_t kept = 0;
    for (std::size_t v = 0; v < receivers.size(); ++v) {
        const auto first = neighbours_.begin() + begin_[v], last = neighbours_.begin() + end[v];
        std::sort(first, last);
        const auto once = std::unique(first, last);
        begin_[v] = kept;
        kept = static_cast<std::int32_t>(std::copy(first, once, neighbours_.begin() + kept) -
                                         neighbours_.begin());
    }
    begin_.back() = kept;
    neighbours_.resize(static_cast<std::size_t>(kept));
    neighbours_.shrink_to_fit();
}

std::size_t LocalRegression::around(std::int32_t vertex,
                                    std::span<std::int32_t, kMost> found) const {
    std::size_t count = 0;
    const auto add_ring = [&](std::int32_t of) {
        for (const std::int32_t v : neighbours(of)) {
            if (count == kMost) {
                return;
            }
            const auto end = found.begin() + static_cast<std::ptrdiff_t>(count);
            const bool known = std::find(found.begin(), end, v) != end;
            if (!known && v != vertex &&
                dot(receivers_[v].normal, receivers_[vertex].normal) >= kLeastCosine) {
                found[count++] = v;
            }
        }
    };
    add_ring(vertex);
    const std::size_t ring = count;
    for (std::size_t k = 0; k < ring; ++k) {
        add_ring(found[k]);
    }
    return count;
}

LocalRegression::Prediction
LocalRegression::predict(std::int32_t vertex, std::span<const NoisyIlluminance> values) const {
    const NoisyIlluminance& own = values[vertex];
    std::array<std::int32_t, kMost> found{};
    const std::size_t all = around(vertex, found);
    std::array<Sample, kMost + 1> samples{};
    const auto [s, t] = tangents(receivers_[vertex].normal);
    std::size_t n = 0;
    double variance = 0.0, rays = 0.0, mean = 0.0, square_distance = 0.0;
    const auto take = [&](std::int32_t v) {
        const NoisyIlluminance& value = values[v];
        if (value.rays == 0.0F) {
            return;
        }
        const Vec3f to = (receivers_[v].position - receivers_[vertex].position).as<float>();
        const double d2 = dot(to, to);
        samples[n++] = {dot(to, s), dot(to, t), luminance(value.illuminance), value.rays, d2, v};
        variance += static_cast<double>(value.rays) * static_cast<double>(value.ray_variance);
        rays += value.rays;
        mean += luminance(value.illuminance);
        square_distance += d2;
    };
    take(vertex);
    for (std::size_t k = 0; k < all; ++k) {
        take(found[k]);
    }
    if (n == 0) {
        return {};
    }
    // One variance of a ray for all: a value that happens to miss a bright spot is low and seems
    // exact.
    variance = std::max(variance / rays, 1e-12 * mean * mean + 1e-30);
    mean /= static_cast<double>(n);
    const double h2 = square_distance / static_cast<double>(n);
    if (n < 4 || own.rays == 0.0F || h2 == 0.0) {
        const float noise = own.rays > 0.0F ? static_cast<float>(variance) / own.rays : 0.0F;
        return {own.illuminance, kUnknown * noise, noise, 0.0F};
    }
    for (Sample& sample : std::span(samples).first(n)) {
        sample.noise = variance / sample.noise;
        sample.structure /= h2;
        sample.weight = 1.0 / sample.noise;
    }
    // Slopes up to the mean over the distance of a neighbour.
    const double flat = h2 / std::max(mean * mean, 1e-30);
    const auto normal_equations = [&](std::size_t first) {
        Normal sum{.a11 = flat, .a22 = flat};
        for (const Sample& p : std::span(samples).first(n).subspan(first)) {
            sum.add(p.weight, p.x, p.y);
        }
        return sum;
    };
    // First as if light were a plane: what the residuals are above their noise is its curvature.
    double curvature = 0.0;
    bool bends = false;
    {
        const Normal i = normal_equations(0).inverse();
        double b0 = 0.0, b1 = 0.0, b2 = 0.0;
        for (const Sample& p : std::span(samples).first(n)) {
            const double w = p.value * p.weight;
            b0 += w;
            b1 += w * p.x;
            b2 += w * p.y;
        }
        const double a = i.a00 * b0 + i.a01 * b1 + i.a02 * b2,
                     bx = i.a01 * b0 + i.a11 * b1 + i.a12 * b2,
                     by = i.a02 * b0 + i.a12 * b1 + i.a22 * b2;
        double square = 0.0, structure = 0.0;
        for (const Sample& p : std::span(samples).first(n)) {
            const double off = p.value - a - bx * p.x - by * p.y;
            square += off * off * p.weight;
            structure += p.structure * p.weight;
        }
        const double freedom = static_cast<double>(n) - 3.0;
        bends = square > freedom;
        curvature = structure > 0.0 ? std::max(0.0, square - freedom) / structure : 0.0;
        // As much as chance may have hidden.
        curvature += kHidden * std::sqrt(2.0 * freedom) / std::max(structure, 1e-30);
    }
    for (Sample& sample : std::span(samples).first(n)) {
        sample.weight = 1.0 / (sample.noise + curvature * sample.structure);
    }
    const Normal i = normal_equations(1).inverse();
    Vec3d sum;
    double raised = 0.0; // of the prediction, by a bowl of height 1
    for (const Sample& p : std::span(samples).first(n).subspan(1)) {
        const double w = (i.a00 + i.a01 * p.x + i.a02 * p.y) * p.weight;
        sum += values[p.vertex].illuminance.as<double>() * w;
        raised += w * p.structure;
    }
    const Bowl bowl = bends ? fit_bowl(std::span(samples).first(n).subspan(1), i) : Bowl{};
    const double least = std::max(1e-3 * mean, 1e-30);
    const double above = raised * bowl.height / std::max(luminance(sum), least);
    sum = sum * std::clamp(1.0 - above, 0.0, 2.0);
    const double doubt = i.a00 + raised * raised * bowl.variance;
    const Vec3d predicted{std::max(0.0, sum.x), std::max(0.0, sum.y), std::max(0.0, sum.z)};
    const double noise = (static_cast<double>(own.rays) * static_cast<double>(own.ray_variance) +
                          kPooledRays * variance) /
                         (static_cast<double>(own.rays) + kPooledRays) /
                         static_cast<double>(own.rays);
    const double off = luminance(predicted) - luminance(own.illuminance.as<double>());
    return {predicted.as<float>(), static_cast<float>(doubt), static_cast<float>(noise),
            static_cast<float>(off * off - noise)};
}

// Where a vertex's own rays and those beside it say otherwise than what is around, as along a
// contact that lies between them and the next, these count as much as they are sure. One vertex
// alone would take its noise for it: a third of the variance stayed so.
SmoothIlluminance LocalRegression::blend(std::int32_t vertex,
                                         std::span<const NoisyIlluminance> values,
                                         std::span<const Prediction> predictions) const {
    const Prediction& of = predictions[vertex];
    float excess = of.excess, all = 1.0F;
    for (const std::int32_t beside : neighbours(vertex)) {
        excess += kBeside * predictions[beside].excess;
        all += kBeside;
    }
    const float doubt = std::max(of.variance, excess / all);
    const float sum = of.noise + doubt;
    const float share = sum > 0.0F ? of.noise / sum : 0.0F;
    const Vec3f& own = values[vertex].illuminance;
    return {own + (of.illuminance - own) * share, doubt * share, share};
}

void LocalRegression::fit(std::span<const NoisyIlluminance> values,
                          std::span<SmoothIlluminance> out, int threads) const {
    std::vector<Prediction> predictions(values.size());
    const auto each = [&](const auto& turn) {
        parallel_blocks(threads, std::size_t{0}, values.size(), std::size_t{64},
                        [&](std::size_t begin, std::size_t end) {
                            for (std::size_t v = begin; v < end; ++v) {
                                turn(v);
                            }
                        });
    };
    each([&](std::size_t v) { predictions[v] = predict(static_cast<std::int32_t>(v), values); });
    each([&](std::size_t v) { out[v] = blend(static_cast<std::int32_t>(v), values, predictions); });
}

} // namespace isolux
