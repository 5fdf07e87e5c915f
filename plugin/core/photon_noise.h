// The error of gather records by the photons that lit what they look up, which more rays don't
// lessen. What the photons of a whole side of a mesh are off by is the same for all records; what
// those of one bucket are off by shows where many rays of a record end there, as in a corner.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "core/gather_records.h"
#include "core/illumination_mesh.h"
#include "core/joined_illuminance.h"
#include "core/photon_buckets.h"

namespace isolux {

// Of the direct and of the indirect light that is looked up.
using EachPathJoined = std::array<const JoinedIlluminance*, 2>;

// Light that records look up. Spans: one a vertex; lx by channel, what the exitances were made of.
struct SeenLight {
    std::span<const Exitance> exitances;
    std::span<const Vec3f> illuminance;
    EachPathJoined joined;
};

struct PhotonNoise {
    double of_sides = 0.0; // mean square error over mean square illuminance of some records
    std::vector<double> of_buckets; // lx², one a record
};

PhotonNoise photon_noise(const IlluminationMesh& mesh, std::span<const Receiver> receivers,
                         std::span<const GatherRecord> records, const SeenLight& seen,
                         const PhotonBuckets& buckets, double photon_flux, int threads);

} // namespace isolux
