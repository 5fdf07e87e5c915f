// Where vertices sample light that lie inside another body, as the foot of a column a little below
// the floor: where the nearest of their edges comes out of it. Their elements show light there; the
// dark within would show as a shade over all that can be seen of them.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/contact_receivers.h"
#include "core/illumination_mesh.h"
#include "core/ray_caster.h"
#include "core/receiver.h"

namespace isolux {

struct BuriedReceivers {
    PlacedReceivers placed;
    std::vector<std::int32_t> lit; // one each: the vertex at the other end of that edge
};

// Bodies are those of one-sided surfaces: no light can be within. Vertices of which no edge comes
// out stay where they are.
// mesh, traced : whose vertices they are; what the caster knows, which may be the same mesh divided
// receivers : vertex_receivers() of the mesh
// lit_from_afar : there is a sky, or a distant luminaire
BuriedReceivers buried_receivers(const IlluminationMesh& mesh, const IlluminationMesh& traced,
                                 const RayCaster& caster, std::span<const Receiver> receivers,
                                 bool lit_from_afar, int threads);

} // namespace isolux
