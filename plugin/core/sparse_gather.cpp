#include "core/sparse_gather.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/bucket_variation.h"
#include "core/lookup_error.h"
#include "core/parallel.h"

namespace isolux {
namespace {

// Rays of a record to begin with. Few, because places are many: on the office 16 to 64 reach the
// same error with as many rays in all, 16 with more work between them.
constexpr std::uint32_t kRaysOfRecord = 32;
// Of the budget, that refinement leaves to vertices which no record sees.
constexpr double kHiddenShare = 0.2;
// Square of the relative change of light over one scale, before anything is known.
constexpr float kFirstRoughness = 0.1F;
// Square distance of records, in scales, nearer than which their difference says little of it.
constexpr float kLeastApart = 0.01F;

} // namespace

SparseGather::SparseGather(const Scene& scene, std::uint64_t seed)
    : scene_(scene), tracer_(scene, seed), receivers_(vertex_receivers(scene.mesh())),
      clusters_(receivers_, scene.mesh().areas, scene.ray_caster().origin()), extent_(0.0F),
      record_of_(receivers_.size(), -1) {
    for (const Receiver& r : receivers_) {
        const Vec3f local = (r.position - scene.ray_caster().origin()).as<float>();
        extent_ = std::max(extent_, 2.0F * length(local));
    }
}

// A vertex may border faces of several reflectances: their mean by area.
std::vector<Exitance> SparseGather::exitances(std::span<const Vec3f> illuminance) const {
    const IlluminationMesh& mesh = scene_.mesh();
    std::vector<Vec3f> reflecting_area(illuminance.size());
    for (const MeshElement& element : mesh.elements) {
        const Surface& surface = mesh.surface(element);
        const auto third = static_cast<float>(mesh.area(element) / 3.0);
        for (const std::int32_t v : element.vertices) {
            reflecting_area[v] += surface.reflectance * third;
            if (surface.back_offset >= 0) {
                reflecting_area[v + surface.back_offset] += surface.reflectance * third;
            }
        }
    }
    std::vector<Exitance> out(illuminance.size());
    for (std::size_t v = 0; v < out.size(); ++v) {
        if (mesh.areas[v] > 0.0) {
            const Vec3f m =
                reflecting_area[v] * illuminance[v] * static_cast<float>(1.0 / mesh.areas[v]);
            out[v] = {m.x, m.y, m.z, 0.0F};
        }
    }
    return out;
}

std::int32_t SparseGather::record_at(std::int32_t vertex, std::vector<std::int32_t>& fresh) {
    std::int32_t& record = record_of_[vertex];
    if (record < 0) {
        record = static_cast<std::int32_t>(records_.size());
        records_.emplace_back();
        records_.back().vertex = vertex;
        fresh.push_back(record);
    }
    return record;
}

// New records get their rays, old ones `factor` times as many as they have.
void SparseGather::trace(std::span<const std::int32_t> records, std::uint32_t factor,
                         std::span<const Exitance> exitances, int threads) {
    const auto rays = [&](const GatherRecord& record) {
        return std::max(kRaysOfRecord, factor * record.rays());
    };
    for (const std::int32_t r : records) {
        rays_ -= records_[r].all_rays();
    }
    parallel_for(threads, records.size(), [&](std::size_t i) {
        GatherRecord& record = records_[records[i]];
        tracer_.trace(receivers_[record.vertex], rays(record), record);
        look_up(exitances, record);
    });
    for (const std::int32_t r : records) {
        rays_ += records_[r].all_rays();
    }
}

// The variance of n points of a sequence falls as n^-slope. The squared difference of its halves
// over 4 has the mean Var(n/2) - Var(n), that of its quarters Var(n/4) - Var(n/2).
// Rays that a record is thought to have beside its own, of the variance of all records: one whose
// few rays missed the one bright spot that it sees would look exact.
constexpr double kPooledRays = 4.0;

void SparseGather::estimate_noise() {
    double halves = 0.0, quarters = 0.0, independent = 0.0, pooled = 0.0;
    for (const GatherRecord& r : records_) {
        halves += r.half_square;
        quarters += r.quarter_square;
        independent += r.ray_variance / r.rays();
        pooled += r.ray_variance;
    }
    pooled_variance_ = records_.empty() ? 0.0 : pooled / static_cast<double>(records_.size());
    if (halves > 0.0 && independent > 0.0) {
        const double slope = std::clamp(std::log2(quarters / halves), 1.0, 2.0);
        noise_share_ = std::min(1.0, halves / (std::exp2(slope) - 1.0) / independent);
    }
}

double SparseGather::noise(const GatherRecord& record) const {
    return noise_share_ * record.ray_variance / record.rays();
}

double SparseGather::possible_noise(const GatherRecord& record) const {
    const double n = record.rays();
    const double variance =
        (n * record.ray_variance + kPooledRays * pooled_variance_) / (n + kPooledRays);
    return noise_share_ * variance / n;
}

// The harmonic mean distance [Ward & Heckbert 1992].
float SparseGather::scale(const GatherRecord& record) const {
    const double mean = record.inverse_distances / record.rays();
    return mean * static_cast<double>(extent_) > 1.0 ? static_cast<float>(1.0 / mean) : extent_;
}

// Of the mean exitance: what the first record sees may be black.
float SparseGather::first_roughness(std::span<const Exitance> exitances) const {
    const std::vector<double>& areas = scene_.mesh().areas;
    double flux = 0.0, area = 0.0;
    for (std::size_t v = 0; v < areas.size(); ++v) {
        const Exitance& m = exitances[v];
        flux += areas[v] * static_cast<double>(luminance(Vec3f{m.x, m.y, m.z}));
        area += areas[v];
    }
    const double mean = area > 0.0 ? flux / area : 0.0;
    return kFirstRoughness * static_cast<float>(mean * mean);
}

// Of two clusters that were one: half what was thought before, half what this pair says.
float SparseGather::roughness(const GatherRecord& a, const GatherRecord& b, float before) const {
    const float s = 1.0F / std::min(scale(a), scale(b));
    const Vec3f p = (clusters_.position(a.vertex) - clusters_.position(b.vertex)) * s;
    const Vec3f n = clusters_.normal(a.vertex) - clusters_.normal(b.vertex);
    const float difference = luminance(a.illuminance) - luminance(b.illuminance);
    const float square = difference * difference - static_cast<float>(noise(a) + noise(b));
    return 0.5F * before +
           0.5F * std::max(0.0F, square) / std::max(dot(p, p) + dot(n, n), kLeastApart);
}

void SparseGather::rate(Cell& cell) const {
    const VertexCluster& cluster = clusters_.clusters()[cell.cluster];
    const GatherRecord& record = records_[cell.record];
    const auto noise_of_record = static_cast<float>(possible_noise(record));
    if (cluster.children < 0) {
        cell.priority = cluster.area * noise_of_record * static_cast<float>(kRaysOfRecord) /
                        static_cast<float>(record.rays());
        return;
    }
    const float s = 1.0F / scale(record);
    const Vec3f p = clusters_.position(record.vertex) - cluster.centre;
    const Vec3f n = clusters_.normal(record.vertex) - cluster.normal;
    const float spread =
        (cluster.square_radius + dot(p, p)) * s * s + cluster.normal_spread + dot(n, n);
    cell.priority = cluster.area * (cell.roughness * std::min(spread, 1.0F) + noise_of_record);
}

void SparseGather::refine(std::uint64_t end, std::span<const Exitance> exitances, int threads) {
    std::vector<std::int32_t> order, split, fresh, more;
    if (cells_.empty()) {
        const std::int32_t record =
            record_at(clusters_.middle(clusters_.clusters()[0], extent_), fresh);
        trace(fresh, 1, exitances, threads);
        cells_.push_back({0, record, first_roughness(exitances), 0.0F});
    }
    while (rays_ < end) {
        estimate_noise();
        for (Cell& cell : cells_) {
            rate(cell);
        }
        // The cells that promise most, as many as half of all: so that what is learnt of the first
        // decides where the next go.
        const std::size_t count =
            std::min(cells_.size(), std::max<std::size_t>(64, cells_.size() / 2));
        order.resize(cells_.size());
        std::iota(order.begin(), order.end(), 0);
        std::partial_sort(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(count),
                          order.end(), [&](std::int32_t a, std::int32_t b) {
                              return cells_[a].priority > cells_[b].priority ||
                                     (cells_[a].priority == cells_[b].priority && a < b);
                          });
        split.clear();
        fresh.clear();
        more.clear();
        std::uint64_t rays = 0;
        for (std::size_t k = 0; k < count && rays_ + rays < end; ++k) {
            const Cell& cell = cells_[order[k]];
            if (clusters_.clusters()[cell.cluster].children < 0) {
                more.push_back(cell.record);
                rays += records_[cell.record].rays();
            } else {
                split.push_back(order[k]);
                rays += kRaysOfRecord;
            }
        }
        const std::size_t old_cells = cells_.size();
        for (const std::int32_t i : split) {
            const std::int32_t child = clusters_.clusters()[cells_[i].cluster].children;
            const GatherRecord& record = records_[cells_[i].record];
            const bool in_first = clusters_.rank(record.vertex) < clusters_.clusters()[child].end;
            const std::int32_t other = in_first ? child + 1 : child;
            const std::int32_t vertex =
                clusters_.middle(clusters_.clusters()[other], scale(record));
            cells_[i].cluster = in_first ? child : child + 1;
            cells_.push_back({other, record_at(vertex, fresh), cells_[i].roughness, 0.0F});
        }
        trace(fresh, 1, exitances, threads);
        trace(more, 2, exitances, threads);
        for (std::size_t k = 0; k < split.size(); ++k) {
            Cell &old = cells_[split[k]], &added = cells_[old_cells + k];
            old.roughness = added.roughness =
                roughness(records_[old.record], records_[added.record], old.roughness);
        }
    }
}

std::vector<SparseGather::Anchor> SparseGather::anchors(const RecordInterpolation& interpolation,
                                                        int threads) const {
    std::vector<Anchor> out(receivers_.size());
    for (const Cell& cell : cells_) {
        const VertexCluster& cluster = clusters_.clusters()[cell.cluster];
        for (std::int32_t i = cluster.begin; i < cluster.end; ++i) {
            const std::int32_t v = clusters_.order()[i];
            out[v].owner = record_of_[v] >= 0 ? record_of_[v] : cell.record;
        }
    }
    parallel_for(threads, out.size(), [&](std::size_t v) {
        if (out[v].owner >= 0) {
            out[v].record = interpolation.anchor(static_cast<std::int32_t>(v), out[v].owner);
        }
    });
    return out;
}

// Some of the vertices that no record sees become records: of each cell as few as see the rest.
void SparseGather::add_hidden(std::span<const Anchor> anchors,
                              const RecordInterpolation& interpolation, std::uint64_t end,
                              std::span<const Exitance> exitances, int threads) {
    struct Hidden {
        float priority;
        std::int32_t vertex;
    };
    std::vector<std::vector<Hidden>> of_cell(cells_.size());
    parallel_for(threads, cells_.size(), [&](std::size_t c) {
        const VertexCluster& cluster = clusters_.clusters()[cells_[c].cluster];
        const float e = luminance(records_[cells_[c].record].illuminance);
        for (std::int32_t i = cluster.begin; i < cluster.end; ++i) {
            const std::int32_t v = clusters_.order()[i];
            if (anchors[v].record >= 0) {
                continue;
            }
            const auto area = static_cast<float>(scene_.mesh().areas[v]);
            const auto seen = std::ranges::find_if(
                of_cell[c], [&](const Hidden& h) { return interpolation.alike(v, h.vertex); });
            if (seen == of_cell[c].end()) {
                of_cell[c].push_back({area * e * e, v});
            } else {
                seen->priority += area * e * e;
            }
        }
    });
    std::vector<Hidden> hidden;
    for (const auto& some : of_cell) {
        hidden.insert(hidden.end(), some.begin(), some.end());
    }
    std::ranges::sort(hidden, [](const Hidden& a, const Hidden& b) {
        return a.priority > b.priority || (a.priority == b.priority && a.vertex < b.vertex);
    });
    std::vector<std::int32_t> fresh;
    for (const Hidden& h : hidden) {
        if (rays_ + fresh.size() * kRaysOfRecord >= end) {
            break;
        }
        record_at(h.vertex, fresh);
    }
    trace(fresh, 1, exitances, threads);
}

RecordInterpolation SparseGather::interpolation() const {
    std::vector<std::int32_t> vertices;
    std::vector<float> scales;
    for (const GatherRecord& r : records_) {
        vertices.push_back(r.vertex);
        scales.push_back(scale(r));
    }
    return {clusters_, scene_.ray_caster(), std::move(vertices), std::move(scales)};
}

void SparseGather::fit(RecordInterpolation& interpolation, int threads) const {
    std::vector<Vec3f> illuminance;
    std::vector<double> noises;
    for (const GatherRecord& r : records_) {
        illuminance.push_back(r.illuminance);
        noises.push_back(noise(r));
    }
    std::vector<float> areas(records_.size());
    for (const Cell& cell : cells_) {
        areas[cell.record] += clusters_.clusters()[cell.cluster].area;
    }
    interpolation.fit(illuminance, noises, areas, threads);
}

// Joins the predictions with the photons' own estimates, each weighted by the inverse of its
// expected square error. Photons are independent of what the records' rays chose, so that they tell
// the true error of the predictions; returns its mean square, lx².
double SparseGather::join(const BucketIllumination& buckets, GatheredIllumination& gathered) const {
    const std::vector<double>& areas = scene_.mesh().areas;
    // A bucket's mean isn't the light at its vertex.
    const std::vector<double> offset =
        offset_square(scene_.mesh(), bucket_offset(scene_.mesh(), photometric(gathered.indirect)));
    double area = 0.0, expected = 0.0, square = 0.0, spread = 0.0;
    for (std::size_t v = 0; v < areas.size(); ++v) {
        if (receivers_[v].normal == Vec3f{} || areas[v] == 0.0) {
            continue;
        }
        const double error = static_cast<double>(gathered.standard_error[v]);
        area += areas[v];
        expected += areas[v] * error * error;
        if (!buckets.indirect.empty()) {
            const double in_bucket = luminance(buckets.indirect[v].as<double>());
            const double off = luminance(gathered.indirect[v].as<double>()) - in_bucket;
            const double term = areas[v] * off * off - in_bucket * buckets.photon_flux;
            square += term;
            spread += term * term;
        }
    }
    if (area == 0.0 || buckets.indirect.empty()) {
        return area > 0.0 ? expected / area : 0.0;
    }
    // The records' own word counts as much as photons that tell the error to as much as it is.
    const double trust =
        expected > 0.0 ? expected * expected / (expected * expected + spread) : 0.0;
    const double calibration =
        expected > 0.0 ? std::max(0.25, 1.0 + trust * (square / expected - 1.0)) : 1.0;
    double joined = 0.0;
    for (const Cell& cell : cells_) {
        const VertexCluster& cluster = clusters_.clusters()[cell.cluster];
        for (std::int32_t i = cluster.begin; i < cluster.end; ++i) {
            const std::int32_t v = clusters_.order()[i];
            if (areas[v] == 0.0) {
                continue;
            }
            const double p = calibration * static_cast<double>(gathered.standard_error[v]) *
                             static_cast<double>(gathered.standard_error[v]);
            const double e = luminance(gathered.indirect[v].as<double>()) + std::sqrt(p);
            const double q = e * buckets.photon_flux / areas[v] + offset[v];
            const double share = p > 0.0 ? p / (p + q) : 0.0;
            gathered.indirect[v] +=
                (buckets.indirect[v] - gathered.indirect[v]) * static_cast<float>(share);
            gathered.standard_error[v] = static_cast<float>(std::sqrt(p * (1.0 - share)));
            joined += areas[v] * p * (1.0 - share);
        }
    }
    return joined / area;
}

GatheredIllumination SparseGather::advance(std::span<const Vec3f> illuminance,
                                           const BucketIllumination& buckets,
                                           std::uint64_t ray_budget, int threads) {
    GatheredIllumination out;
    out.indirect.resize(receivers_.size());
    out.standard_error.resize(receivers_.size());
    if (clusters_.clusters().empty()) {
        return out;
    }
    const std::uint64_t rays_before = rays_;
    const std::vector<Exitance> seen = exitances(illuminance);
    parallel_for(threads, records_.size(), [&](std::size_t i) { look_up(seen, records_[i]); });
    const std::uint64_t end = rays_ + ray_budget;
    refine(end - static_cast<std::uint64_t>(kHiddenShare * static_cast<double>(ray_budget)), seen,
           threads);
    {
        const RecordInterpolation coarse = interpolation();
        add_hidden(anchors(coarse, threads), coarse, end, seen, threads);
        refine(end, seen, threads);
    }
    estimate_noise();

    RecordInterpolation fine = interpolation();
    const std::vector<Anchor> anchored = anchors(fine, threads);
    fit(fine, threads);
    const auto looked_up = static_cast<float>(
        lookup_error(scene_.mesh(), records_, seen, illuminance, buckets.photon_flux));
    parallel_for(threads, receivers_.size(), [&](std::size_t v) {
        const auto [owner, record] = anchored[v];
        if (owner < 0) {
            return;
        }
        const auto vertex = static_cast<std::int32_t>(v);
        auto [light, variance] = fine.predict(vertex, record >= 0 ? record : owner);
        if (record < 0) { // what an unseen record says may be all wrong
            variance += luminance(light) * luminance(light);
        }
        variance += looked_up * luminance(light) * luminance(light);
        out.indirect[v] = light;
        out.standard_error[v] = std::sqrt(variance);
    });
    out.indirect_rms = std::sqrt(join(buckets, out));
    out.records = records_.size();
    out.rays = rays_ - rays_before;
    return out;
}

} // namespace isolux
