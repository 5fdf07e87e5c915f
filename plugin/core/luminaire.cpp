#include "core/luminaire.h"

#include <cmath>
#include <stdexcept>

#include "core/sampling.h"

namespace isolux {

Vec3d SphereLuminaire::direction(PhotonRandom& random) const {
    return uniform_direction<double>(random);
}

// The projection is a disk across the direction; lifted to the sphere's near side.
Vec3d SphereLuminaire::origin(const Vec3d& direction, PhotonRandom& random) const {
    const auto [a, b, r2] = uniform_disk<double>(random);
    const auto [s, t] = tangents(direction);
    return (s * a + t * b + direction * std::sqrt(1.0 - r2)) * radius;
}

Vec3d DiskLuminaire::direction(PhotonRandom& random) const {
    return cosine_direction<double>({0.0, 0.0, -1.0}, random);
}

Vec3d DiskLuminaire::origin(const Vec3d&, PhotonRandom& random) const {
    const auto disk = uniform_disk<double>(random);
    return {disk.a * radius, disk.b * radius, 0.0};
}

Vec3d RectLuminaire::direction(PhotonRandom& random) const {
    return cosine_direction<double>({0.0, 0.0, -1.0}, random);
}

Vec3d RectLuminaire::origin(const Vec3d&, PhotonRandom& random) const {
    const double u = random.next_double(), v = random.next_double();
    return {(u - 0.5) * width, (v - 0.5) * height, 0.0};
}

// Density proportional to the projected area, thus to the sine of the angle to X: the cosine of
// that angle is spread like one coordinate of a uniform point of the disk.
Vec3d CylinderLuminaire::direction(PhotonRandom& random) const {
    const double along = uniform_disk<double>(random).a;
    const auto [a, b, r2] = uniform_disk<double>(random);
    if (r2 == 0.0) {
        return {0.0, 0.0, -1.0};
    }
    const double across = std::sqrt((1.0 - along * along) / r2);
    return {along, a * across, b * across};
}

// The projection is a rectangle across the direction; lifted to the cylinder's near side.
Vec3d CylinderLuminaire::origin(const Vec3d& direction, PhotonRandom& random) const {
    const double along = (random.next_double() - 0.5) * length;
    const double side = 2.0 * random.next_double() - 1.0;
    const double across = std::sqrt(direction.y * direction.y + direction.z * direction.z);
    const double y = across > 0.0 ? direction.y / across : 0.0;
    const double z = across > 0.0 ? direction.z / across : -1.0;
    const double near = std::sqrt(1.0 - side * side);
    return {along, (y * near - z * side) * radius, (z * near + y * side) * radius};
}

Emission Luminaire::sample_emission(PhotonRandom& random) const {
    const auto to_world = [this](const Vec3d& v) { return x * v.x + y * v.y + z * v.z; };
    return std::visit(
        [&](const auto& s) {
            Vec3d direction;
            if (diagram != nullptr) {
                const double cell = random.next_double();
                const double u = random.next_double();
                direction = diagram->sample(cell, u, random.next_double());
            } else {
                direction = s.direction(random);
            }
            const Vec3d origin = s.origin(direction, random);
            return Emission{position + to_world(origin), to_world(direction)};
        },
        shape);
}

MeshLinks::MeshLinks(std::vector<std::uint8_t> lit_meshes, std::vector<std::uint8_t> shadow_meshes)
    : lit(std::move(lit_meshes)), shadow(std::move(shadow_meshes)), met(lit) {
    if (lit.size() != shadow.size()) {
        throw std::invalid_argument("lit and shadow want one entry a mesh");
    }
    for (std::size_t i = 0; i < met.size(); ++i) {
        met[i] |= shadow[i];
    }
}

} // namespace isolux
