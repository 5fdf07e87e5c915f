// Where vertices sample light that something meets exactly, as the underside of a shelf meets a
// wall along a row of its vertices: on the side that light can reach. On the line itself rounding
// alone would choose between the two, and the shade within the shelf would show a whole element
// beside it.
#pragma once

#include <cstdint>
#include <vector>

#include "core/illumination_mesh.h"
#include "core/ray_caster.h"
#include "core/receiver.h"

namespace isolux {

// In place of vertex_receivers() there.
struct PlacedReceivers {
    std::vector<std::int32_t> vertices; // rising
    std::vector<Receiver> receivers;    // one each
};

// mesh, traced : whose vertices they are; what the caster knows, which may be the same mesh divided
PlacedReceivers contact_receivers(const IlluminationMesh& mesh, const IlluminationMesh& traced,
                                  const RayCaster& caster, int threads);

} // namespace isolux
