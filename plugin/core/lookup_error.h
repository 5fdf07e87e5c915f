// The error of gather records by what they look up: light that bends between the vertices, where it
// is taken for linear and for as much at a vertex as in the mean of its bucket. More rays don't
// lessen it.
#pragma once

#include <span>

#include "core/gather_records.h"
#include "core/illumination_mesh.h"

namespace isolux {

// Of all records, by some.
struct LookupError {
    double square = 0.0;   // lx², photometric, mean by area
    double relative = 0.0; // the same over the mean square illuminance

    // Where light is dim the error is less, but not in proportion: what is next to it bends, too.
    double at(double illuminance) const {
        return 0.5 * (square + relative * illuminance * illuminance);
    }
};

// illuminance: lx by channel, one a vertex: what the exitances were made of
LookupError lookup_error(const IlluminationMesh& mesh, std::span<const GatherRecord> records,
                         std::span<const Exitance> exitances, std::span<const Vec3f> illuminance);

} // namespace isolux
