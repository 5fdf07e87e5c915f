#include "core/luminaire_illuminance.h"

#include <cmath>
#include <numbers>

#include "core/sampling.h"

namespace isolux {
namespace {

constexpr double kPi = std::numbers::pi;

struct SurfacePoint {
    Vec3d position, normal; // local; the normal of unit length
    double area;            // m², of all that (u, v) covers
    bool two_sided;         // a goniometric diagram may send light to both sides of a flat shape
};

struct SurfacePointOf {
    double u, v;

    SurfacePoint operator()(const SphereLuminaire& s) const {
        const double z = 1.0 - 2.0 * u, r = std::sqrt(std::max(0.0, 1.0 - z * z));
        const Vec3d n{r * std::cos(2.0 * kPi * v), r * std::sin(2.0 * kPi * v), z};
        return {n * s.radius, n, 4.0 * kPi * s.radius * s.radius, false};
    }
    SurfacePoint operator()(const DiskLuminaire& s) const {
        const double r = s.radius * std::sqrt(u);
        return {{r * std::cos(2.0 * kPi * v), r * std::sin(2.0 * kPi * v), 0.0},
                {0.0, 0.0, -1.0},
                kPi * s.radius * s.radius,
                true};
    }
    SurfacePoint operator()(const RectLuminaire& s) const {
        return {{(u - 0.5) * s.width, (v - 0.5) * s.height, 0.0},
                {0.0, 0.0, -1.0},
                s.width * s.height,
                true};
    }
    SurfacePoint operator()(const CylinderLuminaire& s) const {
        const Vec3d n{0.0, std::cos(2.0 * kPi * v), std::sin(2.0 * kPi * v)};
        return {Vec3d{(u - 0.5) * s.length, 0.0, 0.0} + n * s.radius, n,
                2.0 * kPi * s.radius * s.length, false};
    }
};

struct ProjectedArea {
    Vec3d direction; // local, unit

    double operator()(const SphereLuminaire& s) const { return kPi * s.radius * s.radius; }
    double operator()(const DiskLuminaire& s) const {
        return kPi * s.radius * s.radius * std::abs(direction.z);
    }
    double operator()(const RectLuminaire& s) const {
        return s.width * s.height * std::abs(direction.z);
    }
    double operator()(const CylinderLuminaire& s) const {
        return 2.0 * s.radius * s.length * std::hypot(direction.y, direction.z);
    }
};

} // namespace

ShadowSample shadow_sample(const Luminaire& luminaire, const Receiver& receiver, double u,
                           double v) {
    const SurfacePoint at = std::visit(SurfacePointOf{u, v}, luminaire.shape);
    const auto to_world = [&](const Vec3d& p) {
        return luminaire.x * p.x + luminaire.y * p.y + luminaire.z * p.z;
    };
    const Vec3d point = luminaire.position + to_world(at.position);
    const Vec3d away = receiver.position - point;
    const double squared = dot(away, away);
    const double distance = std::sqrt(squared);
    const double received = -dot(away, receiver.normal.as<double>());
    if (received <= 0.0 || distance == 0.0) {
        return {point, 0.0};
    }
    const Vec3d direction =
        Vec3d{dot(away, luminaire.x), dot(away, luminaire.y), dot(away, luminaire.z)} *
        (1.0 / distance);
    double emitted = dot(direction, at.normal);
    double luminance = luminaire.luminous_flux / (kPi * at.area);
    if (luminaire.diagram != nullptr) {
        emitted = at.two_sided ? std::abs(emitted) : emitted;
        const double projected = std::visit(ProjectedArea{direction}, luminaire.shape);
        luminance = projected > 0.0
                        ? luminaire.diagram->intensity(direction) * luminaire.luminous_flux /
                              luminaire.diagram->luminous_flux() / projected
                        : 0.0;
    }
    if (emitted <= 0.0) {
        return {point, 0.0};
    }
    return {point, luminance * emitted * received / distance / squared * at.area};
}

} // namespace isolux
