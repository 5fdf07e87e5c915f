// Standard error of filtered illuminance at a vertex: the noise of its support's photons, the bias
// that the support brings, and what sets the mean over a bucket apart from its vertex.
//
// Departure: the paper knows the photons' noise alone [Volevich 2000, Eq. 5]. Of 95 % intervals
// drawn from it 38 % hold the truth on a shadowed floor at 3,000 photons (tools/coverage.py).
#pragma once

#include <array>
#include <span>
#include <vector>

#include "core/illumination_filter.h"
#include "core/illumination_mesh.h"
#include "core/photon_buckets.h"
#include "core/support_selection.h"
#include "core/vertex_kdtree.h"

namespace isolux {

// Unbiased estimates of what a mean over vertices is off by; from the counts themselves: for those
// of Poisson's E[lambda g(n)] = E[n g(n - 1)] [Hudson 1978], whatever the truth.
struct FilteredSquares {
    double filtered;   // f, lx
    double with_truth; // of f * I, I the true illuminance, lx²
    double noise;      // of the variance of f, lx²
};

// f is the mean of two halves, each from the photons of one half over a support that the other
// half chose; so each goes with the count of its own photons, less its own share in f.
// half_counts : of one bucket or of several; lux_a_photon : of all photons, spread over it
// shares : of each half, lx by which one of its photons there raises f
FilteredSquares filtered_squares(const std::array<double, 2>& filtered_halves,
                                 const std::array<double, 2>& shares,
                                 const std::array<std::uint64_t, 2>& half_counts,
                                 double lux_a_photon);

// Square error of filtered light, one entry a vertex, lx², photometric.
struct FilterError {
    std::vector<double> square; // all of it
    // Of it, what the mean over the bucket differs from the vertex by; where both have one sign,
    // with twice the product of that and the filter's bias.
    std::vector<double> offset;
};

// hit_sums : of all vertices of lower rank in the tree
// border : border_vertices()
FilterError filter_error(const IlluminationMesh& mesh, const VertexKdTree& tree,
                         std::span<const EachHalf<std::uint64_t>> hit_sums, LightPath path,
                         double photon_flux, const FilteredIllumination& filtered,
                         const std::vector<bool>& border);

} // namespace isolux
