// What the shape of a luminaire tells alone: its extent, and how it would shine with a constant
// luminance.
#pragma once

#include "core/luminaire.h"
#include "core/vec3.h"

namespace isolux {

// For std::visit: a function a shape.
template <typename... F> struct Overloaded : F... {
    using F::operator()...;
};
template <typename... F> Overloaded(F...) -> Overloaded<F...>;

// m, of the sphere around the luminaire's position that holds all of it.
double bounding_radius(const LuminaireShape& shape);

// m²; 0 of a point, and of what is infinitely far.
double luminous_area(const LuminaireShape& shape);

bool is_flat(const LuminaireShape& shape);

// Intensity of a surface of constant luminance in a local direction, for a flux of 1 lm.
double profile(const LuminaireShape& shape, const Vec3d& direction);

} // namespace isolux
