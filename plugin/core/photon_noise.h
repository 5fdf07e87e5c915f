// The error of gather records by the photons that lit what they look up: it is one for all that see
// the same side of a mesh, so that neither more rays nor neighbours lessen it.
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

// Mean square error over mean square illuminance, of some of the records.
// illuminance: lx by channel, one a vertex: what the exitances were made of
double photon_noise(const IlluminationMesh& mesh, std::span<const Receiver> receivers,
                    std::span<const GatherRecord> records, std::span<const Exitance> exitances,
                    std::span<const Vec3f> illuminance, const EachPathJoined& joined,
                    const PhotonBuckets& buckets, double photon_flux);

} // namespace isolux
