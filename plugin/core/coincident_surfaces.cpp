#include "core/coincident_surfaces.h"

#include <algorithm>
#include <cmath>
#include <optional>

namespace isolux {
namespace {

// Barycentric weights may be so much below 0 at a triangle's edge.
constexpr double kAtEdge = 0x1p-16;
// Cosine from which on two planes are one.
constexpr double kSamePlane = 1.0 - 1e-6;

// Where a point lies in an element whose plane it is in, and which side looks to `normal`.
struct Place {
    std::array<double, 3> weights;
    Vec3d area_vector; // of the front, twice its area long
};

std::optional<Place> place_in(const IlluminationMesh& mesh, std::int32_t element,
                              const Vec3d& point, double tolerance) {
    const auto& vertices = mesh.elements[static_cast<std::size_t>(element)].vertices;
    const Vec3d &a = mesh.positions[vertices[0]], &b = mesh.positions[vertices[1]],
                &c = mesh.positions[vertices[2]];
    Place out{{}, cross(b - a, c - a)};
    const double squared = dot(out.area_vector, out.area_vector);
    if (squared <= 0.0 ||
        std::abs(dot(point - a, out.area_vector)) > tolerance * std::sqrt(squared)) {
        return std::nullopt;
    }
    out.weights = {dot(cross(b - point, c - point), out.area_vector) / squared,
                   dot(cross(c - point, a - point), out.area_vector) / squared,
                   dot(cross(a - point, b - point), out.area_vector) / squared};
    if (std::ranges::min(out.weights) < -kAtEdge) {
        return std::nullopt;
    }
    return out;
}

bool has_side(const IlluminationMesh& mesh, std::int32_t element, double towards_front) {
    const MeshElement& e = mesh.elements[static_cast<std::size_t>(element)];
    return towards_front > 0.0 || mesh.surface(e).back_offset >= 0;
}

} // namespace

Hit facing_hit(const IlluminationMesh& mesh, const RayCaster& caster, const Ray& ray,
               const Hit& hit) {
    const MeshElement& met = mesh.elements[static_cast<std::size_t>(hit.triangle)];
    if (dot(ray.direction, hit.normal) <= 0.0F || mesh.surface(met).back_offset >= 0) {
        return hit;
    }
    const Vec3f local = ray.origin + ray.direction * hit.distance;
    const float tolerance = caster.offset(local, hit.distance);
    const Vec3d point = local.as<double>() + caster.origin();
    const Vec3d normal = normalize(hit.normal.as<double>());
    Hit out = hit;
    for (const std::int32_t element : caster.triangles_near(local, tolerance)) {
        const MeshElement& other = mesh.elements[static_cast<std::size_t>(element)];
        const bool passed = ray.meshes != nullptr && ray.meshes[mesh.surface(other).mesh] == 0;
        if (passed || mesh.surface(other).opacity < 1.0F ||
            (out.triangle != hit.triangle && element > out.triangle)) {
            continue;
        }
        const auto place = place_in(mesh, element, point, static_cast<double>(tolerance));
        if (place && std::abs(dot(normalize(place->area_vector), normal)) > kSamePlane &&
            has_side(mesh, element, -dot(place->area_vector, normal))) {
            out = {element, static_cast<float>(place->weights[1]),
                   static_cast<float>(place->weights[2]), hit.distance,
                   place->area_vector.as<float>()};
        }
    }
    return out;
}

std::int32_t first_element_at(const IlluminationMesh& mesh, const RayCaster& caster,
                              const Vec3d& point, const Vec3d& normal) {
    const Vec3f local = (point - caster.origin()).as<float>();
    const float tolerance = caster.offset(local, 0.0F);
    std::int32_t out = -1;
    for (const std::int32_t element : caster.triangles_near(local, tolerance)) {
        if (out >= 0 && element > out) {
            continue;
        }
        const auto place = place_in(mesh, element, point, static_cast<double>(tolerance));
        if (place && std::abs(dot(normalize(place->area_vector), normal)) > kSamePlane &&
            has_side(mesh, element, dot(place->area_vector, normal))) {
            out = element;
        }
    }
    return out;
}

} // namespace isolux
