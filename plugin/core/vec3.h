// Vectors of three components: positions in metres, directions of unit length, linear colours.
#pragma once

#include <cmath>

namespace isolux {

template <typename T> struct Vec3 {
    T x{}, y{}, z{};

    constexpr Vec3 operator+(const Vec3& b) const { return {x + b.x, y + b.y, z + b.z}; }
    constexpr Vec3 operator-(const Vec3& b) const { return {x - b.x, y - b.y, z - b.z}; }
    constexpr Vec3 operator-() const { return {-x, -y, -z}; }
    constexpr Vec3 operator*(const Vec3& b) const { return {x * b.x, y * b.y, z * b.z}; }
    constexpr Vec3 operator*(T s) const { return {x * s, y * s, z * s}; }
    constexpr Vec3& operator+=(const Vec3& b) { return *this = *this + b; }
    constexpr bool operator==(const Vec3&) const = default;

    template <typename U> constexpr Vec3<U> as() const {
        return {static_cast<U>(x), static_cast<U>(y), static_cast<U>(z)};
    }
};

using Vec3f = Vec3<float>;
using Vec3d = Vec3<double>;

template <typename T> constexpr T dot(const Vec3<T>& a, const Vec3<T>& b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

template <typename T> constexpr Vec3<T> cross(const Vec3<T>& a, const Vec3<T>& b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

template <typename T> T length(const Vec3<T>& a) { return std::sqrt(dot(a, a)); }

// The zero vector stays zero.
template <typename T> Vec3<T> normalize(const Vec3<T>& a) {
    const T l = length(a);
    return l > T(0) ? a * (T(1) / l) : a;
}

// Rec. 709 luminance weights: a colour of luminance 1 carries one lumen a lumen.
template <typename T> constexpr T luminance(const Vec3<T>& rgb) {
    return T(0.2126) * rgb.x + T(0.7152) * rgb.y + T(0.0722) * rgb.z;
}

} // namespace isolux
