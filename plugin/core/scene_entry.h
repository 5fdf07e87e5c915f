// Where light from infinitely far enters a scene: the faces of its bounding box that it shines on.
// They cover the box's silhouette from each direction exactly once, so that no photon passes by.
#pragma once

#include <array>
#include <functional>

#include "core/random.h"
#include "core/vec3.h"

namespace isolux {

struct SceneBounds {
    Vec3d low, high; // m, world space
};

class SceneEntry {
  public:
    static constexpr int kFaces = 6;

    // illuminance : lx, of a plane with the outward normal given, nothing in the way
    SceneEntry(const SceneBounds& bounds, const std::function<double(const Vec3d&)>& illuminance);

    double luminous_flux() const { return cumulative_flux_.back(); } // lm
    // By luminous flux, u uniform in [0, 1); luminous_flux() must not be zero.
    int choose_face(double u) const;
    static Vec3d normal(int face); // outwards

    // Uniform over the face, a little outside of it on the way to the light.
    Vec3d origin(int face, const Vec3d& to_light, PhotonRandom& random) const;

    // From any point, a point in that direction outside of the bounds.
    Vec3d beyond(const Vec3d& from, const Vec3d& to_light) const;

  private:
    SceneBounds bounds_;
    std::array<double, kFaces> cumulative_flux_; // lm
};

} // namespace isolux
