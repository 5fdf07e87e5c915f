#include "core/scene_entry.h"

#include <algorithm>

namespace isolux {
namespace {

// Of the box's diagonal, outside of a face: clears surfaces that lie in it.
constexpr double kGap = 0x1p-10;

} // namespace

SceneEntry::SceneEntry(const SceneBounds& bounds,
                       const std::function<double(const Vec3d&)>& illuminance)
    : bounds_(bounds) {
    const Vec3d e = bounds.high - bounds.low;
    const std::array areas{e.y * e.z, e.z * e.x, e.x * e.y};
    double sum = 0.0;
    for (int face = 0; face < kFaces; ++face) {
        const double area = areas[static_cast<std::size_t>(face / 2)];
        sum += area > 0.0 ? area * illuminance(normal(face)) : 0.0;
        cumulative_flux_[static_cast<std::size_t>(face)] = sum;
    }
}

int SceneEntry::choose_face(double u) const {
    const auto at = std::ranges::upper_bound(cumulative_flux_, u * luminous_flux());
    const auto last = std::ranges::lower_bound(cumulative_flux_, luminous_flux());
    return static_cast<int>(std::min(at, last) - cumulative_flux_.begin());
}

Vec3d SceneEntry::normal(int face) {
    const double sign = face % 2 == 0 ? -1.0 : 1.0;
    return {face / 2 == 0 ? sign : 0.0, face / 2 == 1 ? sign : 0.0, face / 2 == 2 ? sign : 0.0};
}

Vec3d SceneEntry::origin(int face, const Vec3d& to_light, PhotonRandom& random) const {
    const Vec3d extent = bounds_.high - bounds_.low;
    const double u = random.next_double(), v = random.next_double();
    const double side = face % 2 == 0 ? 0.0 : 1.0;
    const Vec3d share = face / 2 == 0   ? Vec3d{side, u, v}
                        : face / 2 == 1 ? Vec3d{v, side, u}
                                        : Vec3d{u, v, side};
    return bounds_.low + extent * share + to_light * (kGap * length(extent));
}

Vec3d SceneEntry::beyond(const Vec3d& from, const Vec3d& to_light) const {
    const Vec3d middle = (bounds_.low + bounds_.high) * 0.5;
    const double reach = length(bounds_.high - bounds_.low) + length(middle - from);
    return from + to_light * reach;
}

} // namespace isolux
