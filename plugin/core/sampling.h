// Directions from uniform numbers, by arithmetic and square roots alone: the same bits everywhere,
// where sine and cosine differ between C libraries.
#pragma once

#include <cmath>

#include "core/random.h"
#include "core/vec3.h"

namespace isolux {

template <typename T> struct DiskPoint {
    T a, b, squared_radius;
};

// Uniform in the unit disk, by rejection from the square (1.27 tries on average).
template <typename T> DiskPoint<T> uniform_disk(PhotonRandom& random) {
    for (;;) {
        const std::uint64_t bits = random.next();
        const T a = T(2) * static_cast<T>(high_float(bits)) - T(1);
        const T b = T(2) * static_cast<T>(low_float(bits)) - T(1);
        const T squared_radius = a * a + b * b;
        if (squared_radius < T(1)) {
            return {a, b, squared_radius};
        }
    }
}

// Cosine and sine of so many turns in [0, 1), off by less than 1e-11.
struct CirclePoint {
    double cosine, sine;
};
constexpr CirclePoint on_circle(double turns) {
    const int quarter = static_cast<int>(turns * 4.0 + 0.5);
    const double x = 2.0 * 3.141592653589793 * (turns - 0.25 * quarter), x2 = x * x;
    const auto series = [x2](auto... divisors) { // 1 - x²/d (1 - x²/d' (…))
        double sum = 1.0;
        ((sum = 1.0 - x2 * (1.0 / divisors) * sum), ...);
        return sum;
    };
    const double sine = x * series(110.0, 72.0, 42.0, 20.0, 6.0);
    const double cosine = series(132.0, 90.0, 56.0, 30.0, 12.0, 2.0);
    switch (quarter & 3) {
    case 0:
        return {cosine, sine};
    case 1:
        return {-sine, cosine};
    case 2:
        return {-cosine, -sine};
    default:
        return {sine, -cosine};
    }
}

// Two unit vectors that make a right-handed frame with the unit vector n [Duff et al. 2017].
template <typename T> struct Tangents {
    Vec3<T> s, t;
};
template <typename T> Tangents<T> tangents(const Vec3<T>& n) {
    const T sign = std::copysign(T(1), n.z);
    const T a = T(-1) / (sign + n.z);
    const T b = n.x * n.y * a;
    return {{T(1) + sign * n.x * n.x * a, sign * b, -sign * n.x}, {b, sign + n.y * n.y * a, -n.y}};
}

// Density cos(theta)/pi around the unit vector n: a point of the unit disk, lifted [Malley].
template <typename T> Vec3<T> cosine_direction(const Vec3<T>& n, PhotonRandom& random) {
    const auto [a, b, r2] = uniform_disk<T>(random);
    const auto [s, t] = tangents(n);
    return s * a + t * b + n * std::sqrt(T(1) - r2);
}

// Uniform over the sphere [Marsaglia 1972].
template <typename T> Vec3<T> uniform_direction(PhotonRandom& random) {
    const auto [a, b, r2] = uniform_disk<T>(random);
    const T k = T(2) * std::sqrt(T(1) - r2);
    return {k * a, k * b, T(1) - T(2) * r2};
}

} // namespace isolux
