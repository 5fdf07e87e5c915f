// The immutable scene: elements with their ray tracing tree, luminaires and their total flux.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/buried_receivers.h"
#include "core/contact_receivers.h"
#include "core/illumination_mesh.h"
#include "core/luminaire.h"
#include "core/mesh_division.h"
#include "core/ray_caster.h"

namespace isolux {

// A mesh that is an earlier one in another place.
struct MeshCopy {
    std::size_t mesh, source;
    Placement placement;
};

// What copies must save by sharing trees, bytes: shadow rays take up to 1.3 times as long. Of a
// million triangles the rest of the scene takes some hundreds of megabytes.
inline constexpr std::int64_t kWorthSharing = std::int64_t{64} << 20;

class Scene {
  public:
    // Luminaires infinitely far are aimed here; those of which no light arrives are left out.
    // copies : sources are no copies
    // divide : large elements; those of meshes that share a tree stay as they are
    Scene(IlluminationMesh mesh, std::vector<Luminaire> luminaires,
          std::span<const MeshCopy> copies, std::int64_t worth_sharing, int threads,
          bool divide = false);

    const IlluminationMesh& mesh() const { return mesh_; }
    const MeshDivision& division() const { return division_; }
    const BuriedReceivers& buried() const { return buried_; }
    // Where each vertex samples light: as if nothing were divided, so that results tell the light
    // of the same places.
    std::vector<Receiver> receivers() const;
    // m², one a vertex, of which its light is told: none of vertices that division added.
    const std::vector<double>& told_areas() const {
        return division_.areas.empty() ? mesh_.areas : division_.areas;
    }
    // Those infinitely far last.
    const std::vector<Luminaire>& luminaires() const { return luminaires_; }
    const RayCaster& ray_caster() const { return ray_caster_; }
    double luminous_flux() const { return luminous_flux_; } // lm
    // Some light or surface is coloured: else one channel says all.
    bool coloured() const { return coloured_; }
    // Some luminaire has light or shadow links.
    bool linked() const;

    // The luminaire of a photon, by flux, where there is any; u uniform in [0, 1).
    const Luminaire& choose_luminaire(double u) const;

  private:
    void place_receivers(int threads);

    IlluminationMesh mesh_;
    MeshDivision division_;
    std::vector<Luminaire> luminaires_;
    std::vector<double> cumulative_flux_; // lm
    double luminous_flux_;
    bool coloured_;
    RayCaster ray_caster_;
    BuriedReceivers buried_;
    PlacedReceivers contacts_; // these count where both place a vertex
};

} // namespace isolux
