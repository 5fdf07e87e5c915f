#include "core/luminaire.h"

#include <cmath>
#include <stdexcept>

#include "core/sampling.h"

namespace isolux {
namespace {

// Directions of a dome tried until one is taken: a face that gets light gets some of them.
constexpr int kMostTries = 1 << 16;

// Light enters the scene's box by a face, with a density proportional to the cosine to its normal.
Emission emission(const Luminaire& light, const DistantLuminaire& distant, PhotonRandom& random) {
    const int face = distant.entry->choose_face(random.next_double());
    const Vec3d to_light = distant.cosine_direction(light.z, SceneEntry::normal(face), random);
    return {distant.entry->origin(face, to_light, random), -to_light, light.colour};
}

Emission emission(const Luminaire& light, const DomeLuminaire& dome, PhotonRandom& random) {
    const int face = dome.entry->choose_face(random.next_double());
    const Vec3d normal = SceneEntry::normal(face);
    if (dome.luminance->is_constant()) {
        const Vec3d to_light = cosine_direction(normal, random);
        return {dome.entry->origin(face, to_light, random), -to_light, light.colour};
    }
    Vec3d to_light;
    Vec3f colour;
    for (int i = 0; i < kMostTries; ++i) {
        const double u = random.next_double();
        const auto sample = dome.luminance->sample(u, random.next_double());
        to_light = light.to_world(sample.direction);
        colour = sample.luminance * (1.0F / luminance(sample.luminance));
        if (random.next_double() < dot(to_light, normal)) {
            break;
        }
    }
    return {dome.entry->origin(face, to_light, random), -to_light, colour};
}

} // namespace

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

Vec3d TriangleLuminaire::direction(PhotonRandom& random) const {
    return cosine_direction<double>({0.0, 0.0, -1.0}, random);
}

Vec3d TriangleLuminaire::origin(const Vec3d&, PhotonRandom& random) const {
    const double u = random.next_double();
    return point(u, random.next_double());
}

Vec3d TriangleLuminaire::point(double u, double v) const {
    const double root = std::sqrt(u);
    return a * (1.0 - root) + b * (root * (1.0 - v)) + c * (root * v);
}

bool Luminaire::is_point(double offset) const {
    if (const auto* sphere = std::get_if<SphereLuminaire>(&shape)) {
        return sphere->radius <= offset;
    }
    const auto* disk = std::get_if<DiskLuminaire>(&shape);
    return disk != nullptr && disk->radius <= offset;
}

bool Luminaire::is_infinite() const {
    return std::holds_alternative<DistantLuminaire>(shape) ||
           std::holds_alternative<DomeLuminaire>(shape);
}

void Luminaire::aim(const SceneBounds& bounds) {
    if (auto* distant = std::get_if<DistantLuminaire>(&shape)) {
        distant->entry = std::make_shared<const SceneEntry>(
            bounds, [&](const Vec3d& normal) { return distant->illuminance(z, normal); });
        luminous_flux = distant->entry->luminous_flux();
    } else if (auto* dome = std::get_if<DomeLuminaire>(&shape)) {
        dome->entry = std::make_shared<const SceneEntry>(bounds, [&](const Vec3d& normal) {
            return luminance(dome->luminance->illuminance(to_local(normal)));
        });
        luminous_flux = dome->entry->luminous_flux();
    }
}

Emission Luminaire::sample_emission(PhotonRandom& random) const {
    return std::visit(
        [&](const auto& s) {
            using Shape = std::decay_t<decltype(s)>;
            if constexpr (std::is_same_v<Shape, DistantLuminaire> ||
                          std::is_same_v<Shape, DomeLuminaire>) {
                return emission(*this, s, random);
            } else {
                Vec3d direction;
                if (diagram != nullptr) {
                    const double cell = random.next_double();
                    const double u = random.next_double();
                    direction = diagram->sample(cell, u, random.next_double());
                } else {
                    direction = s.direction(random);
                }
                const Vec3d origin = s.origin(direction, random);
                return Emission{position + to_world(origin), to_world(direction), colour};
            }
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
