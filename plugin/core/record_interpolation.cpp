#include "core/record_interpolation.h"

#include <algorithm>
#include <array>
#include <cmath>

#include <nanoflann.hpp>

#include "core/parallel.h"

namespace isolux {
namespace {

// Square differences that the mean of all records counts for in the variance of a neighbourhood.
constexpr double kPrior = 0.1;
// Of the mean square illuminance: where all neighbours are dark, light may still be near.
constexpr double kPriorOfAll = 0.02;
// Distance, in scales, at which light has nothing in common any more.
constexpr float kSupport = 5.0F;
// Records whose normals lie further apart say little of each other's hemisphere.
constexpr float kLeastCosine = 0.5F;

// Positions and normals, a unit of normals `scale` metres long.
struct Points {
    std::vector<std::array<float, 6>> points;

    std::size_t kdtree_get_point_count() const { return points.size(); }
    float kdtree_get_pt(std::size_t i, std::size_t axis) const { return points[i][axis]; }
    template <typename Box> bool kdtree_get_bbox(Box&) const { return false; }
};

using Index = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, Points>,
                                                  Points, 6, std::uint32_t>;

} // namespace

struct RecordInterpolation::Tree {
    float normal_scale; // m
    Points points;
    Index index;

    Tree(const VertexClusters& clusters, std::span<const std::int32_t> vertices, float scale)
        : normal_scale(scale), points(all(clusters, vertices, scale)),
          index(6, points, nanoflann::KDTreeSingleIndexAdaptorParams(8)) {}

    static std::array<float, 6> point(const VertexClusters& clusters, std::int32_t vertex,
                                      float scale) {
        const Vec3f& p = clusters.position(vertex);
        const Vec3f n = clusters.normal(vertex) * scale;
        return {p.x, p.y, p.z, n.x, n.y, n.z};
    }
    static Points all(const VertexClusters& clusters, std::span<const std::int32_t> vertices,
                      float scale) {
        Points out;
        for (const std::int32_t v : vertices) {
            out.points.push_back(point(clusters, v, scale));
        }
        return out;
    }
    std::size_t nearest(const std::array<float, 6>& query, std::size_t count,
                        std::uint32_t* found) const {
        std::array<float, 32> squared{};
        return index.knnSearch(query.data(), count, found, squared.data());
    }
};

RecordInterpolation::RecordInterpolation(const VertexClusters& clusters, const RayCaster& caster,
                                         std::vector<std::int32_t> vertices,
                                         std::vector<float> scales)
    : clusters_(clusters), caster_(caster), vertices_(std::move(vertices)),
      scales_(std::move(scales)), hoods_(vertices_.size()) {
    std::vector<float> sorted(scales_);
    const auto median = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
    std::nth_element(sorted.begin(), median, sorted.end());
    tree_ = std::make_unique<Tree>(clusters, vertices_, *median);
}

void RecordInterpolation::find_neighbours(std::size_t record) {
    Neighbourhood& hood = hoods_[record];
    std::array<std::uint32_t, kNeighbours + 5> found{};
    const std::size_t n = tree_->nearest(tree_->points.points[record], found.size(), found.data());
    hood.members[0] = static_cast<std::int32_t>(record);
    hood.count = 1;
    for (std::size_t k = 0; k < n && hood.count < kMembers; ++k) {
        if (found[k] != record && alike(vertices_[record], vertices_[found[k]])) {
            hood.members[hood.count++] = static_cast<std::int32_t>(found[k]);
        }
    }
}

RecordInterpolation::~RecordInterpolation() = default;

bool RecordInterpolation::alike(std::int32_t vertex, std::int32_t other) const {
    if (dot(clusters_.normal(vertex), clusters_.normal(other)) < kLeastCosine) {
        return false;
    }
    const Vec3f &p = clusters_.position(vertex), &q = clusters_.position(other);
    const Vec3f &m = clusters_.normal(vertex), &n = clusters_.normal(other);
    const Vec3f across = q - p;
    const float distance = length(across);
    if (distance == 0.0F) {
        return true;
    }
    // Lifted off the surface, over its bulge where it is convex: the chord of an arc lies half as
    // deep below it as this.
    const auto lift = [&](const Vec3f& at, const Vec3f& normal, float depth) {
        return normal * (caster_.offset(at, distance) * 4.0F + 0.02F * distance +
                         0.5F * std::max(0.0F, depth));
    };
    const Vec3f from = p + lift(p, m, -dot(across, m));
    const Vec3f to = q + lift(q, n, dot(across, n));
    return caster_.transmitted(Ray{from, to - from}) == 1.0F;
}

std::int32_t RecordInterpolation::anchor(std::int32_t vertex, std::int32_t own) const {
    if (vertices_[own] == vertex || alike(vertex, vertices_[own])) {
        return own;
    }
    std::array<std::uint32_t, 8> found{};
    const std::size_t n = tree_->nearest(Tree::point(clusters_, vertex, tree_->normal_scale),
                                         found.size(), found.data());
    for (std::size_t k = 0; k < n; ++k) {
        const auto record = static_cast<std::int32_t>(found[k]);
        if (record != own && alike(vertex, vertices_[record])) {
            return record;
        }
    }
    return -1;
}

// Wendland's function of dimension 6 or less, twice differentiable, zero beyond its support:
// position and orientation are six [Wendland 2005, §9.4].
double RecordInterpolation::correlation(std::int32_t vertex, std::int32_t other,
                                        float scale) const {
    const Vec3f p = (clusters_.position(vertex) - clusters_.position(other)) * (1.0F / scale);
    const Vec3f n = clusters_.normal(vertex) - clusters_.normal(other);
    const float t = std::sqrt(dot(p, p) + dot(n, n)) / kSupport;
    if (t >= 1.0F) {
        return 0.0;
    }
    const float a = 1.0F - t, a2 = a * a;
    return static_cast<double>(a2 * a2 * a2 * (6.0F * t + 1.0F));
}

void RecordInterpolation::solve(Neighbourhood& hood, std::span<const Vec3f> illuminance) const {
    const std::size_t n = hood.count;
    const float scale = scales_[hood.members[0]];
    const Vec3f& middle = illuminance[hood.members[0]];
    // Cholesky factorization L Lᵀ of the covariances, row by row.
    double* row = hood.factor.data();
    for (std::size_t a = 0; a < n; ++a) {
        const double* other = hood.factor.data();
        for (std::size_t b = 0; b <= a; ++b) {
            double sum = hood.constant;
            if (a == b) {
                sum += hood.amplitude * (1.0 + 1e-6) + hood.noise;
            } else {
                sum += hood.amplitude *
                       correlation(vertices_[hood.members[a]], vertices_[hood.members[b]], scale);
            }
            for (std::size_t k = 0; k < b; ++k) {
                sum -= row[k] * other[k];
            }
            row[b] = a == b ? std::sqrt(std::max(sum, 1e-12 * hood.amplitude)) : sum / other[b];
            other += b + 1;
        }
        row += a + 1;
    }
    // weights = covariance^-1 (illuminance - middle)
    const double* l = hood.factor.data();
    for (std::size_t a = 0; a < n; ++a) {
        Vec3d sum = (illuminance[hood.members[a]] - middle).as<double>();
        for (std::size_t k = 0; k < a; ++k) {
            sum = sum - hood.weights[k] * l[k];
        }
        hood.weights[a] = sum * (1.0 / l[a]);
        l += a + 1;
    }
    for (std::size_t a = n; a-- > 0;) {
        Vec3d sum = hood.weights[a];
        for (std::size_t k = a + 1; k < n; ++k) {
            sum = sum - hood.weights[k] * hood.factor[k * (k + 1) / 2 + a];
        }
        hood.weights[a] = sum * (1.0 / hood.factor[a * (a + 1) / 2 + a]);
    }
}

void RecordInterpolation::fit(std::span<const Vec3f> illuminance, std::span<const double> noise,
                              std::span<const float> areas, int threads) {
    illuminance_.assign(illuminance.begin(), illuminance.end());
    parallel_for(threads, hoods_.size(), [&](std::size_t i) { find_neighbours(i); });
    // How strongly light varies: from squared differences of neighbours, less their noise, over
    // what they would be for a variance of 1. First of all records, relative to their illuminance.
    struct Moments {
        double difference = 0.0, expected = 0.0, relative = 0.0;
    };
    std::vector<Moments> moments(hoods_.size());
    parallel_for(threads, hoods_.size(), [&](std::size_t i) {
        const Neighbourhood& hood = hoods_[i];
        const double e = luminance(illuminance[i]);
        for (std::size_t k = 1; k < hood.count; ++k) {
            const std::int32_t j = hood.members[k];
            const double f = luminance(illuminance[j]);
            const double free = 2.0 * (1.0 - correlation(vertices_[i], vertices_[j], scales_[i]));
            moments[i].difference += (e - f) * (e - f) - noise[i] - noise[j];
            moments[i].expected += free;
            moments[i].relative += free * 0.5 * (e * e + f * f);
        }
    });
    Moments all;
    double mean_square = 0.0; // lx², of records alike
    for (const Vec3f& e : illuminance) {
        const double l = luminance(e);
        mean_square += l * l / static_cast<double>(hoods_.size());
    }
    for (const Moments& m : moments) {
        all.difference += m.difference;
        all.relative += m.relative;
    }
    const double c2 =
        all.relative > 0.0 ? std::clamp(all.difference / all.relative, 1e-6, 100.0) : 1.0;
    std::vector<std::array<double, 2>> left_out(hoods_.size()); // squared error, expected
    parallel_for(threads, hoods_.size(), [&](std::size_t i) {
        Neighbourhood& hood = hoods_[i];
        double square = 0.0;
        for (std::size_t k = 0; k < hood.count; ++k) {
            const double f = luminance(illuminance[hood.members[k]]);
            square += f * f / static_cast<double>(hood.count);
        }
        const Moments& m = moments[i];
        // What its own neighbours say, with the mean of all for a little.
        hood.amplitude =
            (std::max(0.0, m.difference) + kPrior * c2 * (square + kPriorOfAll * mean_square)) /
            (m.expected + kPrior);
        hood.amplitude = std::max(hood.amplitude, 1e-12 * square + 1e-30);
        hood.constant = 100.0 * std::max(hood.amplitude, square);
        // One noise for all: a record that happens to miss a bright spot is low and seems exact.
        double shared = 0.0;
        for (std::size_t k = 0; k < hood.count; ++k) {
            shared += noise[hood.members[k]] / static_cast<double>(hood.count);
        }
        hood.noise = shared;
        solve(hood, illuminance);
        // The record itself, predicted from the others: by the first row of the inverse.
        const std::size_t n = hood.count;
        if (n > 1) {
            std::array<double, kMembers> x{};
            const double* l = hood.factor.data();
            for (std::size_t a = 0; a < n; ++a) {
                double sum = a == 0 ? 1.0 : 0.0;
                for (std::size_t k = 0; k < a; ++k) {
                    sum -= l[k] * x[k];
                }
                x[a] = sum / l[a];
                l += a + 1;
            }
            double inverse = 0.0;
            for (std::size_t a = 0; a < n; ++a) {
                inverse += x[a] * x[a];
            }
            const double off = luminance(hood.weights[0]) / inverse;
            left_out[i] = {off * off - shared, 1.0 / inverse - shared};
        }
    });
    double square = 0.0, expected = 0.0;
    for (std::size_t i = 0; i < hoods_.size(); ++i) {
        square += static_cast<double>(areas[i]) * left_out[i][0];
        expected += static_cast<double>(areas[i]) * left_out[i][1];
    }
    // Records lie where light changes least from cluster to cluster; vertices at edges are worse
    // off than a record that is left out.
    calibration_ = expected > 0.0 ? std::max(square / expected, 1.0) : 1.0;
}

RecordInterpolation::Prediction RecordInterpolation::predict(std::int32_t vertex,
                                                             std::int32_t record) const {
    const Neighbourhood& hood = hoods_[record];
    Vec3d sum = illuminance_[record].as<double>();
    std::array<double, kMembers> x{};
    const double* l = hood.factor.data();
    double explained = 0.0;
    for (std::size_t a = 0; a < hood.count; ++a) {
        const double covariance =
            hood.constant +
            hood.amplitude * correlation(vertex, vertices_[hood.members[a]], scales_[record]);
        sum += hood.weights[a] * covariance;
        double y = covariance;
        for (std::size_t k = 0; k < a; ++k) {
            y -= l[k] * x[k];
        }
        x[a] = y / l[a];
        explained += x[a] * x[a];
        l += a + 1;
    }
    const Vec3d clamped{std::max(0.0, sum.x), std::max(0.0, sum.y), std::max(0.0, sum.z)};
    return {clamped.as<float>(),
            static_cast<float>(std::max(0.0, hood.amplitude + hood.constant - explained) *
                               calibration_)};
}

} // namespace isolux
