#include "core/filter_error.h"

#include <algorithm>
#include <cmath>

#include "core/bucket_variation.h"

namespace isolux {
namespace {

// Vertices are taken together, where their supports are so much wider: their bias is one, and
// shows in fewer photons.
constexpr double kPart = 0.25;

// Fewer photons than these, of those expected of a part, don't tell its own bias from all's.
constexpr double kFewPhotons = 4.0;

// Bias is told as a multiple of a support's own noise, of which it is the kin: a support grows
// until either tells it to stop. So it is before anything is known, with as much doubt.
constexpr double kBias = 1.0;

// The noise of buckets that share no photons shows in the square of an offset as this part of their
// variance, on a mesh of six triangles a vertex: half in its own, half in those around.
constexpr double kOffsetNoise = 0.8;

// Of some vertices, both relative to their illuminance's square, times their area.
struct Evidence {
    double bias = 0.0;     // estimate of the square of their bias
    double noise = 0.0;    // of their wide supports
    double variance = 0.0; // of the estimate; times the area once more

    void add(const Evidence& other) {
        bias += other.bias;
        noise += other.noise;
        variance += other.variance;
    }
};

// Where surfaces meet, what each sends the other falls towards their edge as x ln(L / x), x the
// distance from it: the mean over a bucket there differs from its vertex by 2.8, 2.0, 1.7 times
// what lines through means tell where L is 4, 8, 16 buckets. That is 4.9 in the square, of which
// the offset of the vertex and of those around hold 1.5.
constexpr double kEdgeOfIndirect = 3.0;

// Offsets that the filter has flattened more than this are no longer told by what it left.
constexpr double kFlattened = 4.0;

using HitSums = std::span<const EachHalf<std::uint64_t>>;

std::array<std::uint64_t, 2> half_counts(HitSums hit_sums, std::uint32_t rank, LightPath path) {
    const auto& before = hit_sums[rank][static_cast<std::size_t>(path)];
    const auto& after = hit_sums[rank + 1][static_cast<std::size_t>(path)];
    return {after[0] - before[0], after[1] - before[1]};
}

// Where a surface ends, supports lie on one side of their vertex: their bias goes with the slope of
// the light, elsewhere with its bend. So neither tells the other's.
class BiasEstimate {
  public:
    BiasEstimate(const IlluminationMesh& mesh, const VertexKdTree& tree, HitSums hit_sums,
                 LightPath path, double photon_flux, const FilteredIllumination& filtered,
                 const std::vector<bool>& border)
        : mesh_(mesh), tree_(tree), hit_sums_(hit_sums), path_(path), photon_flux_(photon_flux),
          filtered_(filtered), border_(border), bias_(tree.vertices().size()) {
        if (tree.cells().empty()) {
            return;
        }
        for (Sums& sums : sums_) {
            sums.of_vertices.resize(tree.cells().size());
            sums.of_parts.resize(tree.cells().size());
            sums.of_small_parts.resize(tree.cells().size());
            sums.told.resize(tree.cells().size());
        }
        collect(0);
        // Of few photons, what all tell together is the first that is known.
        const auto both = [&](std::vector<Evidence> Sums::* of) {
            Evidence sum = (sums_[0].*of)[0];
            sum.add((sums_[1].*of)[0]);
            return sum;
        };
        const double of_all = corrected(kBias, both(&Sums::of_vertices), both(&Sums::of_parts),
                                        both(&Sums::of_small_parts));
        for (const bool at_border : {false, true}) {
            spread(0, of_all, at_border);
        }
    }

    // Of each vertex's bias, a multiple of the variance of its support.
    const std::vector<double>& bias() const { return bias_; }

  private:
    // Sums over the vertices of a cell, by area.
    struct Part {
        std::uint32_t vertices = 0;
        double area = 0.0;            // m²
        double own = 0.0;             // part of their supports that they are, all together
        double noise = 0.0;           // m² lx², of wide supports
        std::array<double, 2> flux{}; // lm, of the halves
        std::array<double, 2> shares{};
        std::array<std::uint64_t, 2> counts{};

        void add(const Part& other) {
            vertices += other.vertices;
            area += other.area;
            own += other.own;
            noise += other.noise;
            for (const std::size_t half : {0U, 1U}) {
                flux[half] += other.flux[half];
                shares[half] += other.shares[half];
                counts[half] += other.counts[half];
            }
        }
    };

    Part part(std::uint32_t rank) const {
        const std::int32_t v = tree_.vertices()[rank];
        Part out;
        out.vertices = 1;
        out.area = mesh_.areas[v];
        out.counts = half_counts(hit_sums_, rank, path_);
        for (const std::size_t half : {0U, 1U}) {
            const auto& [illuminance, support_area] = filtered_.halves[v][half];
            const auto f = static_cast<double>(illuminance);
            if (support_area > 0.0) {
                const double share = 2.0 * photon_flux_ / support_area;
                out.flux[half] = out.area * f;
                out.shares[half] = out.area * share;
                out.own += 0.5 * out.area / support_area;
                out.noise += 0.25 * out.area * f * share * (1.0 - out.area / support_area);
            }
        }
        return out;
    }

    Evidence evidence(const Part& part) const {
        if (part.area == 0.0) {
            return {};
        }
        const double mean = 1.0 / part.area, e = photon_flux_ * mean;
        const auto [f, with_truth, noise] =
            filtered_squares({part.flux[0] * mean, part.flux[1] * mean},
                             {part.shares[0] * mean, part.shares[1] * mean}, part.counts, e);
        const double hits = static_cast<double>(part.counts[0] + part.counts[1]) * e;
        const double square = f * f - 2.0 * with_truth + hits * (hits - e);
        const double weight = part.area / ((f + e) * (f + e));
        return {weight * (square - noise), weight * mean * part.noise,
                weight * weight * e * f * (2.0 * e * f + e * e)};
    }

    // returns : all of the cell, by kind of vertex
    std::array<Part, 2> collect(std::int32_t at) {
        const VertexCell& cell = tree_.cells()[at];
        std::array<Part, 2> all;
        std::array divides{cell.first_child >= 0, cell.first_child >= 0};
        if (cell.first_child < 0) {
            for (std::uint32_t rank = cell.begin; rank < cell.end; ++rank) {
                const Part one = part(rank);
                const std::size_t kind = border_[tree_.vertices()[rank]] ? 1 : 0;
                all[kind].add(one);
                sums_[kind].of_vertices[at].add(evidence(one));
            }
            for (Sums& sums : sums_) {
                sums.of_parts[at] = sums.of_vertices[at];
            }
        } else {
            for (const std::int32_t child : {cell.first_child, cell.first_child + 1}) {
                const std::array<Part, 2> of_child = collect(child);
                for (const std::size_t kind : {0U, 1U}) {
                    Sums& sums = sums_[kind];
                    all[kind].add(of_child[kind]);
                    sums.of_vertices[at].add(sums.of_vertices[child]);
                    sums.of_parts[at].add(sums.of_parts[child]);
                    sums.of_small_parts[at].add(sums.of_small_parts[child]);
                    divides[kind] =
                        divides[kind] && photons_expected(of_child[kind]) >= kFewPhotons;
                }
            }
        }
        for (const std::size_t kind : {0U, 1U}) {
            const Part& part = all[kind];
            auto& [of_vertices, of_parts, of_small_parts, told] = sums_[kind];
            if (part.vertices == 0) {
                continue;
            }
            if (part.own <= kPart) {
                of_parts[at] = evidence(part);
            }
            if (!divides[kind]) {
                of_small_parts[at] = part.own <= kPart ? of_parts[at] : of_vertices[at];
            }
            told[at] = part.own > kPart || photons_expected(part) >= kFewPhotons ? Told::something
                                                                                 : Told::nothing;
        }
        return all;
    }

    // What is known of all, corrected by what a part says of itself: as far as this is certain
    // beside how much it may differ from all. More bias that is seen is believed; less of it only
    // from one standard deviation on.
    static double corrected(double of_all, const Evidence& evidence) {
        if (evidence.noise <= 0.0) {
            return of_all;
        }
        const double more = evidence.bias / evidence.noise - of_all;
        const double variance = evidence.variance / (evidence.noise * evidence.noise);
        const double expected = (of_all + kBias) * (of_all + kBias);
        if (more < 0.0) {
            const double less = std::min(0.0, more + std::sqrt(variance));
            return std::max(0.0, of_all + expected / (expected + variance) * less);
        }
        const double doubt = std::max(expected, more * more - variance);
        return of_all + doubt / (doubt + variance) * more;
    }

    // All bias shows at single vertices, but in few photons; what is the same all over a part shows
    // sooner. What cancels out in wide parts shows in those that have just the photons to tell it.
    static double corrected(double of_all, const Evidence& of_vertices, const Evidence& of_parts,
                            const Evidence& of_small_parts) {
        const double here = corrected(of_all, of_vertices);
        return std::max({here, corrected(here, of_parts), corrected(here, of_small_parts)});
    }

    double photons_expected(const Part& part) const {
        return 0.5 * (part.flux[0] + part.flux[1]) / photon_flux_;
    }

    void spread(std::int32_t at, double of_all, bool at_border) {
        const auto& [of_vertices, of_parts, of_small_parts, told] = sums_[at_border ? 1 : 0];
        if (told[at] == Told::empty) {
            return;
        }
        const VertexCell& cell = tree_.cells()[at];
        const bool known = told[at] == Told::something;
        const double here =
            known ? corrected(of_all, of_vertices[at], of_parts[at], of_small_parts[at]) : of_all;
        if (cell.first_child >= 0 && known) {
            spread(cell.first_child, here, at_border);
            spread(cell.first_child + 1, here, at_border);
            return;
        }
        for (std::uint32_t rank = cell.begin; rank < cell.end; ++rank) {
            const std::int32_t v = tree_.vertices()[rank];
            if (border_[v] == at_border) {
                const Part one = part(rank);
                bias_[v] = known && photons_expected(one) >= kFewPhotons
                               ? corrected(here, evidence(one))
                               : here;
            }
        }
    }

    const IlluminationMesh& mesh_;
    const VertexKdTree& tree_;
    HitSums hit_sums_;
    LightPath path_;
    double photon_flux_; // lm
    const FilteredIllumination& filtered_;
    const std::vector<bool>& border_;
    // Whether a cell has vertices of a kind, and these tell something of themselves.
    enum class Told : std::uint8_t { empty, nothing, something };
    // One entry a cell.
    struct Sums {
        std::vector<Evidence> of_vertices, of_parts, of_small_parts;
        std::vector<Told> told;
    };
    std::array<Sums, 2> sums_; // of vertices inside, where surfaces end
    std::vector<double> bias_; // a vertex
};

// What the mean over a bucket differs from the illuminance at its vertex by, squared; lx².
std::vector<double> filtered_offset_square(const IlluminationMesh& mesh, const VertexKdTree& tree,
                                           HitSums hit_sums, LightPath path, double photon_flux,
                                           const FilteredIllumination& filtered,
                                           const std::vector<bool>& border) {
    const std::size_t n = mesh.areas.size();
    std::vector<double> means(n), noise(n); // lx, lx² of what a bucket doesn't share
    std::array<std::vector<double>, 2> halves{std::vector<double>(n), std::vector<double>(n)};
    for (std::size_t v = 0; v < n; ++v) {
        if (mesh.areas[v] == 0.0) {
            continue;
        }
        const auto counts = half_counts(hit_sums, tree.rank(static_cast<std::int32_t>(v)), path);
        means[v] = luminance(filtered.illuminance[v].as<double>());
        for (const std::size_t half : {0U, 1U}) {
            halves[half][v] = 2.0 * photon_flux * static_cast<double>(counts[half]) / mesh.areas[v];
            // Two discs of radius r whose centres are h apart have all but 2 h / (pi r) in common,
            // for supports of so many buckets all but the root of their number.
            const auto& [of_half, support_area] = filtered.halves[v][half];
            if (support_area > 0.0) {
                noise[v] += 0.5 * photon_flux * static_cast<double>(of_half) / support_area *
                            std::sqrt(std::min(1.0, mesh.areas[v] / support_area));
            }
        }
    }
    const std::vector<double> offsets = bucket_offset(mesh, means);
    std::vector<double> out = offset_square(mesh, offsets);
    // The filter flattens offsets, too. What they are without it, two halves of the photons know
    // that are independent, if not of single vertices.
    const std::vector<double> first = bucket_offset(mesh, halves[0]);
    const std::vector<double> second = bucket_offset(mesh, halves[1]);
    double unfiltered = 0.0, spread = 0.0, left = 0.0; // m² lx², m⁴ lx⁴, m² lx²
    for (std::size_t v = 0; v < n; ++v) {
        const double square = mesh.areas[v] * first[v] * second[v];
        unfiltered += square;
        spread += square * square;
        left += mesh.areas[v] * (offsets[v] * offsets[v] - 0.5 * kOffsetNoise * noise[v]);
    }
    const double certain = unfiltered - std::sqrt(spread);
    const double flattened = left > 0.0 ? std::clamp(certain / left, 1.0, kFlattened) : 1.0;
    for (std::size_t v = 0; v < n; ++v) {
        out[v] = flattened * std::max(0.0, out[v] - kOffsetNoise * noise[v]);
        if (border[v] && path == LightPath::indirect) {
            out[v] *= kEdgeOfIndirect;
        }
    }
    return out;
}

} // namespace

FilteredSquares filtered_squares(const std::array<double, 2>& filtered_halves,
                                 const std::array<double, 2>& shares,
                                 const std::array<std::uint64_t, 2>& half_counts,
                                 double lux_a_photon) {
    FilteredSquares out{0.0, 0.0, 0.0};
    for (const std::size_t half : {0U, 1U}) {
        const double f = filtered_halves[half], share = shares[half];
        const double own_hits = static_cast<double>(half_counts[1 - half]) * 2.0 * lux_a_photon;
        out.filtered += 0.5 * f;
        out.with_truth += 0.5 * own_hits * (f - share);
        out.noise += 0.25 * f * share;
    }
    return out;
}

FilterError filter_error(const IlluminationMesh& mesh, const VertexKdTree& tree, HitSums hit_sums,
                         LightPath path, double photon_flux, const FilteredIllumination& filtered,
                         const std::vector<bool>& border) {
    FilterError out;
    // First, so that what it takes on its way is free again.
    out.offset = filtered_offset_square(mesh, tree, hit_sums, path, photon_flux, filtered, border);
    const BiasEstimate estimate(mesh, tree, hit_sums, path, photon_flux, filtered, border);
    out.square.resize(out.offset.size());
    for (std::size_t v = 0; v < out.square.size(); ++v) {
        double bias = 0.0; // lx²
        for (const auto& [illuminance, support_area] : filtered.halves[v]) {
            if (support_area > 0.0) {
                // Where n photons are counted, the mean count has the variance n + 1 if all means
                // were alike before: half a photon more in each half.
                const double share = 2.0 * photon_flux / support_area;
                const double variance =
                    0.25 * share * (static_cast<double>(illuminance) + 0.5 * share);
                const double others = 1.0 - std::min(1.0, mesh.areas[v] / support_area);
                out.square[v] += variance;
                bias += variance * estimate.bias()[v] * others;
            }
        }
        if (border[v]) {
            // Bucket and support lie on the same side of the vertex: both have the slope's sign,
            // but for the half of the offset's square that is told of any bend.
            const double of_slope = path == LightPath::indirect ? 1.0 : 0.5;
            out.offset[v] += 2.0 * std::sqrt(bias * of_slope * out.offset[v]);
        }
        out.square[v] += bias + out.offset[v];
    }
    return out;
}

} // namespace isolux
