// The error of gather records by what they look up: light that varies within the buckets. More rays
// don't lessen it.
#pragma once

#include <span>

#include "core/gather_records.h"
#include "core/illumination_mesh.h"

namespace isolux {

// Mean square error over mean square illuminance, of some of the records.
// illuminance: lx by channel, one a vertex: what the exitances were made of
double lookup_error(const IlluminationMesh& mesh, std::span<const GatherRecord> records,
                    std::span<const Exitance> exitances, std::span<const Vec3f> illuminance);

} // namespace isolux
