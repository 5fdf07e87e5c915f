// Where an angle, given by its sine and cosine, lies among tabulated angles: without an arc tangent
// and without a search.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace isolux {

class AngleTable {
  public:
    struct Place {
        std::size_t index; // of the interval
        double fraction;   // of the way through it, in [0, 1]
    };

    AngleTable() = default;
    // angles : rad, strictly increasing in [0, 2 pi], two or more, no two further apart than 0.1
    explicit AngleTable(std::span<const double> angles);

    // None outside of the table.
    std::optional<Place> locate(double sine, double cosine) const;

  private:
    struct Interval {
        double sine, cosine, width; // of the angle that begins it; rad
    };
    std::vector<Interval> intervals_;
    std::vector<double> turns_;          // of all angles, see turn() in the source
    std::vector<std::uint32_t> buckets_; // the interval where each even part of the turns begins
    double buckets_per_turn_ = 0.0;
};

} // namespace isolux
