// Luminaires: how much light, from where and in which directions (photometry in lm and cd).
//
// A luminaire is a shape and either a constant luminance or a goniometric diagram. Local axes: the
// light shines to -Z (nadir, gamma 0), C0 is +X. With a diagram I(omega) the origin of a photon is
// uniform over the shape's projection along omega, which for a luminance that depends on direction
// alone, L(omega), is exact: I(omega) = L(omega) * projected area.
#pragma once

#include <cstdint>
#include <memory>
#include <variant>
#include <vector>

#include "core/candela_distribution.h"
#include "core/random.h"
#include "core/vec3.h"

namespace isolux {

// Each shape: a direction as a surface of constant luminance gives it, and an origin for it.
// u, v are uniform in the unit disk or square as each says; all local, metres.
struct SphereLuminaire {
    double radius;
    Vec3d direction(PhotonRandom& random) const;
    Vec3d origin(const Vec3d& direction, PhotonRandom& random) const;
};
struct DiskLuminaire { // shines to -Z
    double radius;
    Vec3d direction(PhotonRandom& random) const;
    Vec3d origin(const Vec3d& direction, PhotonRandom& random) const;
};
struct RectLuminaire { // shines to -Z; width along X, height along Y
    double width, height;
    Vec3d direction(PhotonRandom& random) const;
    Vec3d origin(const Vec3d& direction, PhotonRandom& random) const;
};
struct CylinderLuminaire { // along X, without end caps
    double radius, length;
    Vec3d direction(PhotonRandom& random) const;
    Vec3d origin(const Vec3d& direction, PhotonRandom& random) const;
};
using LuminaireShape =
    std::variant<SphereLuminaire, DiskLuminaire, RectLuminaire, CylinderLuminaire>;

struct Emission {
    Vec3d origin, direction; // world space, m; direction of unit length
};

// Light and shadow links, one entry a mesh. They tell of light straight from the luminaire alone:
// what a lit surface reflects goes everywhere.
struct MeshLinks {
    std::vector<std::uint8_t> lit;    // it receives the luminaire's light
    std::vector<std::uint8_t> shadow; // it stands in the luminaire's light
    std::vector<std::uint8_t> met;    // one of both

    MeshLinks(std::vector<std::uint8_t> lit_meshes, std::vector<std::uint8_t> shadow_meshes);
};

struct Luminaire {
    LuminaireShape shape;
    Vec3d position;                                     // world space, m
    Vec3d x, y, z;                                      // local axes in world space, orthonormal
    Vec3f colour;                                       // linear Rec. 709 of luminance 1
    double luminous_flux;                               // lm
    std::shared_ptr<const CandelaDistribution> diagram; // null: constant luminance
    std::shared_ptr<const MeshLinks> links = nullptr;   // null: all meshes, lit and in its light

    // mesh : -1: none in particular
    bool lights(std::int32_t mesh) const { return !links || mesh < 0 || links->lit[mesh] != 0; }
    // Meshes that its shadow rays meet; null: all.
    const std::uint8_t* shadow_meshes() const { return links ? links->shadow.data() : nullptr; }

    Emission sample_emission(PhotonRandom& random) const;
};

} // namespace isolux
