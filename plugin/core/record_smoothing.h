// Illuminance at the vertices from their records of a gather: each is taken together with those
// around it, by as much as its noise asks for.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "core/gather_records.h"
#include "core/local_regression.h"

namespace isolux {

class RecordSmoothing {
  public:
    RecordSmoothing(const IlluminationMesh& mesh, std::span<const Receiver> receivers)
        : mesh_(mesh), receivers_(receivers), regression_(mesh, receivers) {
        for (auto& left : left_) {
            left.fill(1.0);
        }
    }

    // records : one a vertex
    // lit : vertices that light can reach
    void smooth(std::span<const GatherRecord> records, std::span<const std::int32_t> lit,
                std::span<SmoothIlluminance> out, int threads);

    // Vertices that an edge joins to one, on the same smooth surface.
    std::span<const std::int32_t> neighbours(std::int32_t vertex) const {
        return regression_.neighbours(vertex);
    }

  private:
    void estimate_noise(std::span<const GatherRecord> records, std::span<const std::int32_t> lit);
    double ray_variance(const GatherRecord& record) const; // lx², of its rays' share in the noise

    const IlluminationMesh& mesh_;
    std::span<const Receiver> receivers_;
    LocalRegression regression_;
    // Share of the variance of independent rays that 2^k rays of a Sobol sequence leave, by k.
    static constexpr std::size_t kDoublings = 32, kPlaces = 2; // in the open; where surfaces meet
    std::array<std::array<double, kDoublings>, kPlaces> left_{};
    double pooled_variance_ = 0.0; // lx², photometric, of one ray
};

} // namespace isolux
