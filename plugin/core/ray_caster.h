// Closest hits and occlusion among triangles. The only unit that sees Embree.
//
// A triangle of opacity a stops the share a of the light that meets it: a closest hit meets it with
// probability a, decided by a hash of ray and triangle, and of a shadow ray it stops that share.
//
// Positions are recentred in double before they become float rays, so that a stage far from its
// origin keeps its precision.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "core/triangle_copies.h"
#include "core/vec3.h"

namespace isolux {

inline constexpr std::int32_t kNoHit = -1;

struct Hit {
    std::int32_t triangle = kNoHit;
    float u = 0.0F, v = 0.0F; // barycentric weights of vertices 1 and 2
    float distance = 0.0F;    // in lengths of the direction
    Vec3f normal;             // geometric, on the front side, of any length
};

struct Ray {
    Vec3f origin; // relative to RayCaster::origin()
    Vec3f direction;
    float near = 0.0F;                    // where it begins, in lengths of the direction
    const std::uint8_t* meshes = nullptr; // of each mesh whether the ray meets it; null: all
};

// What a ray may meet.
struct RayTargets {
    std::span<const Vec3d> points;
    // Those that touch no finite area may be given: they are never hit.
    std::span<const std::array<std::int32_t, 3>> triangles;
    // One a triangle or, where nothing asks for them, none: share of the light that it stops,
    // in (0, 1]; its mesh.
    std::vector<float> opacity = {};
    std::vector<std::int32_t> meshes = {};
    // One tree for the triangles of a source and all its copies; no two of them overlap, and no
    // source is a copy.
    std::vector<TriangleCopies> copies = {};
};

class RayCaster {
  public:
    // `threads` build the tree; the tree does not depend on their number.
    RayCaster(RayTargets targets, int threads);
    ~RayCaster();
    RayCaster(const RayCaster&) = delete;
    RayCaster& operator=(const RayCaster&) = delete;

    // World position of the local origin.
    const Vec3d& origin() const { return origin_; }
    // How far off a surface a ray must start: the rounding of a local position p that a ray
    // reached over some distance.
    float offset(const Vec3f& p, float distance) const;

    // Bytes that the tree takes, with the triangles in it.
    std::int64_t tree_bytes() const;

    Hit closest_hit(const Ray& ray) const;
    // Share of the light that passes along the length of the ray's direction.
    float transmitted(const Ray& ray) const;
    // The same for each ray; those that start or end near each other are fastest.
    void transmitted(std::span<const Ray> rays, std::span<float> out) const;

    // Triangles whose bounds come within `radius`, m, of a local position, in no order.
    std::vector<std::int32_t> triangles_near(const Vec3f& p, float radius) const;

  private:
    struct Embree;
    std::unique_ptr<Embree> embree_;
    Vec3d origin_;
    float least_offset_;
};

} // namespace isolux
