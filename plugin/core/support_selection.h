// The filter support of one vertex [Volevich 2000, §A.2]: the buckets around it that describe the
// same light, taken by rising distance until one of the three stopping criteria is met.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "core/poisson_interval.h"
#include "core/vertex_kdtree.h"

namespace isolux {

// Of direct and indirect light, and of the photons of even and of odd batches.
template <typename T> using EachHalf = std::array<std::array<T, 2>, 2>;

struct Support {
    double hit_count = 0.0;  // of the half that chose the support
    double other_hits = 0.0; // of the other half
    double area = 0.0;       // m²
    float radius = 0.0F;     // m
    std::size_t size = 0;    // accepted cells, nearest first
};

// What the stopping criteria need, for one half of the photons.
struct SupportCriteria {
    double accuracy;       // relative deviation at which to stop
    double photon_flux;    // lm
    double dark_luminance; // cd/m²; what displays as black
    IntervalTable intervals;
};

// Some vertices that a support takes as one.
struct SupportCell {
    std::uint32_t begin, end; // ranks
    float squared_distance;   // m², of their centre
};

// Supports for direct and indirect light and for both halves of the photons at once: they look at
// the same vertices and differ in where they stop.
class SupportSelection {
  public:
    // Hits of all vertices of lower rank, so that those of any cell are a difference.
    using HitSums = std::vector<EachHalf<std::uint64_t>>;

    // reflectance: of luminance, by rank
    SupportSelection(const VertexKdTree& tree, std::span<const double> reflectance,
                     const HitSums& hit_sums, const SupportCriteria& criteria)
        : tree_(tree), reflectance_(reflectance), hit_sums_(hit_sums), criteria_(criteria) {
        const float radius = tree.cells().front().radius;
        scale_ = 1.0F / std::max(radius * radius, std::numeric_limits<float>::min());
    }

    // wanted: which supports; the others stay empty.
    EachHalf<Support> select(std::uint32_t rank, const EachHalf<bool>& wanted);
    // Cells of the largest support of the last selection, nearest first; the others are made of the
    // first of them.
    std::span<const SupportCell> accepted() const { return accepted_; }

  private:
    enum class Reach { connected, all };
    // One support on its way: as far as found good.
    struct Growth {
        Support judged;
        Interval plausible{0.0, 0.0}; // lx
        bool stopped = false;
    };
    // What the search has yet to look at, in lists by distance: a cell to open, or some vertices to
    // take as they are.
    struct Candidate {
        std::int32_t open; // index of the cell; -1: take
        std::uint32_t begin, end;
        float squared_distance; // m²
        double area;            // m²
        std::int32_t next;      // in the list; -1: none
    };
    // The squared distance doubles every fourth shell: the float's exponent and two bits.
    static constexpr std::size_t kShells = 520;

    EachHalf<Growth> grow(std::uint32_t rank, const EachHalf<bool>& wanted, Reach reach);
    void open(const VertexCell& cell);
    void consider(const VertexCell& cell);
    void consider_vertex(std::uint32_t rank, bool connected);
    void push(float squared_distance, Candidate candidate);
    bool coplanar(const Vec3f& from_vertex, float squared_distance) const;
    void judge(const Support& taken, double to_luminance, Growth& growth) const;

    const VertexKdTree& tree_;
    std::span<const double> reflectance_;
    const HitSums& hit_sums_;
    const SupportCriteria& criteria_;
    // Of the vertex whose support is searched:
    Vec3f position_, normal_;
    std::uint32_t rank_ = 0;
    std::int32_t component_ = 0;
    float scale_;            // 1/m²: squared distances are relative to the scene's
    std::size_t shell_ = 0;  // being looked at
    std::size_t others_ = 0; // cells of other components seen so far
    std::array<std::int32_t, kShells> shells_;
    std::vector<Candidate> candidates_;
    std::vector<SupportCell> accepted_;
};

} // namespace isolux
