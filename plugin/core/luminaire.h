// Luminaires: how much light, from where and in which directions (photometry in lm and cd).
//
// A luminaire is a shape and either a constant luminance or a goniometric diagram. Local axes: the
// light shines to -Z (nadir, gamma 0), C0 is +X. With a diagram I(omega) the origin of a photon is
// uniform over the shape's projection along omega, which for a luminance that depends on direction
// alone, L(omega), is exact: I(omega) = L(omega) * projected area.
#pragma once

#include <cmath>
#include <cstdint>
#include <memory>
#include <variant>
#include <vector>

#include "core/candela_distribution.h"
#include "core/distant_luminaire.h"
#include "core/dome_luminance.h"
#include "core/random.h"
#include "core/scene_entry.h"
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
struct TriangleLuminaire { // shines to -Z; the corners, around the middle in the plane Z = 0
    Vec3d a, b, c;
    Vec3d direction(PhotonRandom& random) const;
    Vec3d origin(const Vec3d& direction, PhotonRandom& random) const;
    Vec3d point(double u, double v) const;
};
struct DomeLuminaire { // shines from all around; local axes as DomeLuminance has them
    std::shared_ptr<const DomeLuminance> luminance;
    std::shared_ptr<const SceneEntry> entry; // set by the scene that it shines on
};
using LuminaireShape =
    std::variant<SphereLuminaire, DiskLuminaire, RectLuminaire, CylinderLuminaire,
                 TriangleLuminaire, DistantLuminaire, DomeLuminaire>;

struct Emission {
    Vec3d origin, direction; // world space, m; direction of unit length
    Vec3f colour;            // of luminance 1
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
    Vec3d position;       // world space, m
    Vec3d x, y, z;        // local axes in world space, orthonormal
    Vec3f colour;         // linear Rec. 709 of luminance 1
    double luminous_flux; // lm; from infinitely far, what enters the scene's bounds
    std::shared_ptr<const CandelaDistribution> diagram; // null: constant luminance
    std::shared_ptr<const MeshLinks> links = nullptr;   // null: all meshes, lit and in its light
    std::vector<Vec3f> touched = {}; // of a point of light: normals of surfaces that it lies in
    double touching = 0.0;           // m, from those surfaces, at most

    // mesh : -1: none in particular
    bool lights(std::int32_t mesh) const { return !links || mesh < 0 || links->lit[mesh] != 0; }
    // Meshes that its shadow rays meet; null: all.
    const std::uint8_t* shadow_meshes() const { return links ? links->shadow.data() : nullptr; }

    Emission sample_emission(PhotonRandom& random) const;

    // Which way its light clears, by an offset, what it lies in: along its direction, away from its
    // own plane, so that grazing light clears a ceiling that it is flush with, and off the surfaces
    // that it touches.
    Vec3f clearance(const Vec3f& direction) const {
        const auto off = [&](const Vec3f& n) { return n * std::copysign(1.0F, dot(direction, n)); };
        Vec3f out = touched.empty() ? direction + off(z.as<float>()) : direction;
        for (const Vec3f& normal : touched) {
            out += off(normal);
        }
        return out;
    }
    // Whether it lies in a receiver's own surface, which it doesn't light, but for rounding.
    // height : m, of the luminaire over the receiver
    bool lies_in(double height, const Vec3f& normal) const {
        for (const Vec3f& n : touched) {
            if (height <= touching && std::abs(dot(n, normal)) > 0.999F) {
                return true;
            }
        }
        return false;
    }
    // Without extent, as far as offsets tell.
    bool is_point(double offset) const;

    // Shines from infinitely far, on the bounds that aim() gave it.
    bool is_infinite() const;
    // Takes its luminous flux as what enters the bounds, where it is infinitely far.
    void aim(const SceneBounds& bounds);

    Vec3d to_local(const Vec3d& v) const { return {dot(v, x), dot(v, y), dot(v, z)}; }
    Vec3d to_world(const Vec3d& v) const { return x * v.x + y * v.y + z * v.z; }
};

} // namespace isolux
