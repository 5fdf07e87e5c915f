// Points of the part of a triangle that is on the front of a plane: where rays go that can carry
// light.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>

#include "core/form_factor.h"

namespace isolux {

// What of a triangle is on the front of a plane, as up to two triangles.
class TriangleRegion {
  public:
    explicit TriangleRegion(const Triangle& whole) : parts_{whole, {}} {}

    TriangleRegion(const Triangle& whole, const Vec3d& on_plane, const Vec3d& normal) {
        std::array<double, 3> height;
        for (std::size_t k = 0; k < 3; ++k) {
            height[k] = dot(whole[k] - on_plane, normal);
        }
        std::array<Vec3d, 4> corners;
        std::size_t count = 0;
        for (std::size_t k = 0; k < 3; ++k) {
            const std::size_t next = (k + 1) % 3;
            if (height[k] >= 0.0) {
                corners[count++] = whole[k];
            }
            if ((height[k] > 0.0 && height[next] < 0.0) ||
                (height[k] < 0.0 && height[next] > 0.0)) {
                const double t = height[k] / (height[k] - height[next]);
                corners[count++] = whole[k] + (whole[next] - whole[k]) * t;
            }
        }
        if (count < 3) {
            parts_[0] = whole;
            return;
        }
        parts_[0] = {corners[0], corners[1], corners[2]};
        if (count == 4) {
            parts_[1] = {corners[0], corners[2], corners[3]};
            const double a = area(parts_[0]), b = area(parts_[1]);
            first_ = a + b > 0.0 ? a / (a + b) : 1.0;
        }
    }

    // Uniform over the region for u, v uniform in [0, 1).
    Vec3d point(double u, double v) const {
        const bool second = u >= first_;
        u = second ? (u - first_) / (1.0 - first_) : u / first_;
        const Triangle& t = parts_[second ? 1 : 0];
        const double root = std::sqrt(std::clamp(u, 0.0, 1.0));
        return t[0] * (1.0 - root) + t[1] * (root * (1.0 - v)) + t[2] * (root * v);
    }

  private:
    static double area(const Triangle& t) { return length(cross(t[1] - t[0], t[2] - t[0])); }

    std::array<Triangle, 2> parts_;
    double first_ = 1.0; // share of the first part's area
};

} // namespace isolux
