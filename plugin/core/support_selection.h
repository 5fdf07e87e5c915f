// The filter support of one vertex [Volevich 2000, §A.2]: the buckets around it that describe the
// same light, taken by rising distance until one of the three stopping criteria is met.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "core/illumination_filter.h"

namespace isolux {

struct Support {
    double hit_count = 0.0;
    double area = 0.0;    // m²
    float radius = 0.0F;  // m
    std::size_t size = 0; // accepted vertices, nearest first
};

// What the stopping criteria need, for one half of the photons.
struct SupportCriteria {
    double accuracy;       // relative deviation at which to stop
    double photon_flux;    // lm
    double dark_luminance; // cd/m²; what displays as black
    IntervalTable intervals;
};

// Supports for direct and indirect light and for both halves of the photons at once: they look at
// the same vertices and differ in where they stop.
class SupportSelection {
  public:
    // Of each light path and half.
    template <typename T> using Each = std::array<std::array<T, 2>, 2>;
    using Counts = Each<std::vector<double>>; // hits, a vertex

    SupportSelection(const IlluminationFilter& filter, const Counts& hit_counts,
                     const SupportCriteria& criteria)
        : filter_(filter), hit_counts_(hit_counts), criteria_(criteria) {}

    // wanted: which light paths; supports of the others stay empty.
    Each<Support> select(std::int32_t vertex, std::array<bool, 2> wanted);
    // Vertices of the largest support of the last selection, nearest first; the others are made of
    // the first of them.
    std::span<const Neighbour> accepted() const { return accepted_; }

  private:
    enum class Reach { connected, all };
    // One support on its way: as far as taken, and as far as found good.
    struct Growth {
        Support taken, judged;
        Interval plausible{0.0, 0.0}; // lx
        double next_area = 0.0;       // m²; to judge at
        bool stopped = false;
        const Support& support() const { return judged.size > 0 ? judged : taken; }
    };
    // Candidates are looked at in shells of rising distance.
    struct Shell {
        float squared_outer = 0.0F; // m², excluded
        std::size_t seen = 0;       // vertices in all shells so far
    };

    Each<Growth> grow(std::int32_t vertex, std::array<bool, 2> wanted, Reach reach);
    // Fills candidates_; false where all vertices have been seen, or as many as a support may.
    bool next_shell(std::int32_t vertex, Reach reach, Shell& shell);
    bool accepts(std::int32_t vertex, const Neighbour& candidate) const;
    void take(const Neighbour& candidate, const std::vector<double>& hit_counts, Growth& growth);
    void judge(double to_luminance, Growth& growth) const;

    const IlluminationFilter& filter_;
    const Counts& hit_counts_;
    const SupportCriteria& criteria_;
    std::vector<Neighbour> candidates_, accepted_;
};

} // namespace isolux
