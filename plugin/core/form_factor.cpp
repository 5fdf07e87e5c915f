#include "core/form_factor.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace isolux {
namespace {

// Angle between a and b times the cosine between their common normal and n.
double edge_term(const Vec3d& a, const Vec3d& b, const Vec3d& n) {
    const Vec3d c = cross(a, b);
    const double sine = length(c);
    return sine > 0.0 ? std::atan2(sine, dot(a, b)) * dot(c, n) / sine : 0.0;
}

} // namespace

double form_factor(const Vec3d& position, const Vec3d& normal, const Triangle& triangle) {
    std::array<Vec3d, 3> p;
    std::array<double, 3> height;
    for (std::size_t k = 0; k < 3; ++k) {
        p[k] = triangle[k] - position;
        height[k] = dot(p[k], normal);
    }
    if (std::max({height[0], height[1], height[2]}) <= 0.0 ||
        dot(cross(p[1] - p[0], p[2] - p[0]), p[0]) >= 0.0) {
        return 0.0;
    }
    // What is left above the horizon has up to four corners.
    std::array<Vec3d, 4> above;
    std::size_t count = 0;
    for (std::size_t k = 0; k < 3; ++k) {
        const std::size_t next = (k + 1) % 3;
        if (height[k] > 0.0) {
            above[count++] = p[k];
        }
        if ((height[k] > 0.0) != (height[next] > 0.0)) {
            above[count++] = p[k] + (p[next] - p[k]) * (height[k] / (height[k] - height[next]));
        }
    }
    double sum = 0.0;
    for (std::size_t k = 0; k < count; ++k) {
        sum += edge_term(above[(k + 1) % count], above[k], normal);
    }
    return std::max(0.0, sum) / (2.0 * std::numbers::pi);
}

} // namespace isolux
