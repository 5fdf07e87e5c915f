#include "core/nearest_normals.h"

#include <algorithm>
#include <vector>

#include <nanoflann.hpp>

namespace isolux {
namespace {

// As nanoflann wants them.
struct Points {
    std::vector<Vec3d> positions;

    std::size_t kdtree_get_point_count() const { return positions.size(); }
    double kdtree_get_pt(std::size_t i, std::size_t axis) const {
        const Vec3d& p = positions[i];
        return axis == 0 ? p.x : axis == 1 ? p.y : p.z;
    }
    template <typename Box> bool kdtree_get_bbox(Box&) const { return false; }
};

using Index =
    nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<double, Points>, Points, 3>;

} // namespace

void fill_normals(std::span<const Vec3d> positions, std::span<Vec3f> normals) {
    if (std::ranges::find(normals, Vec3f{}) == normals.end()) {
        return;
    }
    Points known;
    std::vector<Vec3f> known_normals;
    for (std::size_t i = 0; i < normals.size(); ++i) {
        if (normals[i] != Vec3f{}) {
            known.positions.push_back(positions[i]);
            known_normals.push_back(normals[i]);
        }
    }
    if (known_normals.empty()) {
        return;
    }
    const Index index(3, known);
    for (std::size_t i = 0; i < normals.size(); ++i) {
        if (normals[i] == Vec3f{}) {
            const std::array at{positions[i].x, positions[i].y, positions[i].z};
            std::uint32_t nearest = 0;
            double squared_distance = 0.0;
            index.knnSearch(at.data(), 1, &nearest, &squared_distance);
            normals[i] = known_normals[nearest];
        }
    }
}

} // namespace isolux
