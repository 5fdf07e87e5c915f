// How far a solution is from the truth: relative RMS errors over all surfaces, area-weighted,
// sqrt(sum A (I - I_true)^2 / sum A) / mean(I), I the photometric illuminance of a bucket.
#pragma once

#include "core/illumination_filter.h"
#include "core/photon_buckets.h"

namespace isolux {

struct RmsErrors {
    // Of the unfiltered buckets, from their counts [Volevich 2000, Eq. 5].
    double bucket_total = 0.0, bucket_indirect = 0.0;
    // The same from independent batches of photons: no model of how hits correlate.
    double batch_total = 0.0;
    // Departure: of the filtered illuminance, noise and bias together, where the paper knows the
    // buckets' noise only. For Poisson counts E[lambda g(n)] = E[n g(n - 1)] [Hudson 1978], so that
    // the counts themselves tell the squared error of any mean over buckets without the truth
    // (tests/physics/test_reported_error.py). Never below half of the noise's variance, so that
    // chance can't report no error where counts are few.
    double filtered_total = 0.0, filtered_indirect = 0.0;
};

RmsErrors rms_errors(const IlluminationMesh& mesh, const PhotonBuckets& buckets, double photon_flux,
                     const FilteredIllumination& direct, const FilteredIllumination& indirect);

} // namespace isolux
