// The immutable scene: elements with their ray tracing tree, luminaires and their total flux.
#pragma once

#include <vector>

#include "core/illumination_mesh.h"
#include "core/luminaire.h"
#include "core/ray_caster.h"

namespace isolux {

class Scene {
  public:
    // At least one element and one luminaire of positive flux; those infinitely far are aimed here.
    Scene(IlluminationMesh mesh, std::vector<Luminaire> luminaires, int threads);

    const IlluminationMesh& mesh() const { return mesh_; }
    // Those infinitely far last.
    const std::vector<Luminaire>& luminaires() const { return luminaires_; }
    const RayCaster& ray_caster() const { return ray_caster_; }
    double luminous_flux() const { return luminous_flux_; } // lm
    // Some light or surface is coloured: else one channel says all.
    bool coloured() const { return coloured_; }
    // Some luminaire has light or shadow links.
    bool linked() const;

    // The luminaire of a photon, by flux; u uniform in [0, 1).
    const Luminaire& choose_luminaire(double u) const;

  private:
    IlluminationMesh mesh_;
    std::vector<Luminaire> luminaires_;
    std::vector<double> cumulative_flux_; // lm
    double luminous_flux_;
    bool coloured_;
    RayCaster ray_caster_;
};

} // namespace isolux
