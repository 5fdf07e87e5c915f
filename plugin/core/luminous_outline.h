// Illuminance from a surface of constant luminance through its outline as the receiver sees it, by
// Lambert's contour integral E = L/2 ∮ n·(r × dr)/r², cut at the receiver's horizon. Closed form
// on segments and on arcs of circles, whatever lies between them: polygons, disks, spheres, tubes.
#pragma once

#include <optional>

#include "core/vec3.h"

namespace isolux {

// Circle in space: centre + cosine * cos(phi) + sine * sin(phi), the two axes orthogonal and of
// one length, the sine axis across the centre's own vector.
struct CircleOfView {
    Vec3d centre, cosine, sine; // m, from the receiver

    Vec3d at(double phi) const;
};

// Pieces that close, in any order, all in one sense of rotation. Positions are relative to the
// receiver, in metres.
class LuminousOutline {
  public:
    explicit LuminousOutline(const Vec3d& normal) : normal_(normal) {}

    void add_segment(const Vec3d& from, const Vec3d& to);
    void add_arc(const CircleOfView& circle, double first, double last);
    void add_circle(const CircleOfView& circle);

    // Illuminance over luminance, sr.
    double projected_solid_angle() const;

  private:
    void rise(const Vec3d& at) { horizon_ += azimuth(at); }
    void fall(const Vec3d& at) { horizon_ -= azimuth(at); }
    double azimuth(const Vec3d& at);

    Vec3d normal_;
    double sum_ = 0.0, horizon_ = 0.0;
    std::optional<Vec3d> reference_; // azimuth 0: the first point that meets the horizon
};

} // namespace isolux
