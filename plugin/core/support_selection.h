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

// What the stopping criteria need, for one component of light and one half of the photons.
struct SupportCriteria {
    double accuracy;       // relative deviation at which to stop
    double photon_flux;    // lm
    double dark_luminance; // cd/m²; what displays as black
    IntervalTable intervals;
};

// Supports of both halves of the photons at once: they differ in where they stop.
class SupportSelection {
  public:
    using Counts = std::array<std::vector<double>, 2>; // of each half, a vertex

    SupportSelection(const IlluminationFilter& filter, const Counts& hit_counts,
                     const SupportCriteria& criteria)
        : filter_(filter), hit_counts_(hit_counts), criteria_(criteria) {}

    std::array<Support, 2> select(std::int32_t vertex);
    // Vertices of the larger support of the last selection, nearest first; the smaller one is made
    // of the first of them.
    std::span<const Neighbour> accepted() const { return accepted_; }

  private:
    enum class Reach { connected, all };
    // The support of one half on its way: as far as taken, and as far as found good.
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

    std::array<Growth, 2> grow(std::int32_t vertex, Reach reach);
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
