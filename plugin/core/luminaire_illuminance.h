// Illuminance that a luminaire gives where nothing is in the way, and the points of it that shadow
// rays aim at [Volevich 2000, §3.1.1]. The light is that of Luminaire::sample_emission.
#pragma once

#include <numbers>

#include "core/luminaire.h"
#include "core/receiver.h"
#include "core/vec3.h"

namespace isolux {

// A point of the luminaire that the receiver faces, and the illuminance that comes from around it,
// up to a factor common to all points of a luminaire.
struct ShadowSample {
    Vec3d point; // m, world space; of an infinite luminaire, outside of the scene
    double weight;
    Vec3f colour; // of luminance 1
};

class LuminaireIlluminance {
  public:
    // cd/lm, a tenth of an even luminaire's: what one chosen by its intensity counts beside it, so
    // that none is left out where that is 0 in the direction looked at alone.
    static constexpr double kEvenIntensity = 0.1 / (4.0 * std::numbers::pi);

    explicit LuminaireIlluminance(const Luminaire& luminaire);

    const Luminaire& luminaire() const { return luminaire_; }
    bool is_infinite() const { return is_infinite_; }
    // m, of the sphere around the luminaire's position that holds all of it.
    double radius() const { return radius_; }

    // The angle from local -Z beyond which there is no light, rad.
    double reach() const { return reach_; }

    // cd, in the direction where there is most light.
    double peak_intensity() const;
    // Its intensity falls with the cosine to its nadir: flat, of constant luminance.
    bool follows_cosine() const;

    double intensity(const Vec3d& to) const; // cd; from the receiver, world space, any length

    // lx. Exact for constant luminance; a goniometric diagram counts as a point from afar, nearer
    // by quadrature over the opening.
    double unoccluded(const Receiver& receiver) const;

    // u, v in [0, 1)
    ShadowSample shadow_sample(const Receiver& receiver, double u, double v) const;

    // To choose a luminaire by, lx: about what it gives where nothing is in the way, and above 0
    // wherever it gives any.
    double about(const Receiver& receiver) const;
    // A point, whose weight is the illuminance, lx, by what it alone tells: its mean over (u, v) is
    // `unoccluded`.
    ShadowSample light_sample(const Receiver& receiver, double u, double v) const;

  private:
    // From the receiver to where light starts, and the illuminance for each candela to the receiver
    // if all light came as from there: its mean over (u, v) with the intensity is the illuminance.
    struct Sight {
        Vec3d to;
        double factor;
    };
    Sight sight(const Receiver& receiver, double u, double v) const;

    bool one_point_tells(const Vec3d& to) const;
    bool is_far(const Vec3d& to, const Vec3d& normal, double openings) const;
    double constant_luminance(const Vec3d& to, const Vec3d& normal) const;
    double as_point(const Receiver& receiver) const;
    double quadrature(const Receiver& receiver) const;
    double by_points(const Receiver& receiver, int parts) const;
    double from_infinity(const Vec3d& normal) const;
    ShadowSample infinite_sample(const Receiver& receiver, double u, double v) const;

    Vec3d to_local(const Vec3d& v) const { return luminaire_.to_local(v); }
    Vec3d to_world(const Vec3d& v) const { return luminaire_.to_world(v); }

    Luminaire luminaire_;
    bool is_infinite_;
    double radius_, reach_;
    double point_openings_; // beyond so many a diagram is a point's
    double area_;           // luminous, m²
    double scale_; // cd for each unit of the diagram, or of the shape's own directional profile
};

} // namespace isolux
