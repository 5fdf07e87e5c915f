// NumPy arrays in and out: typed views of what Python hands over, owned arrays to hand back.
#pragma once

#include <array>
#include <cstdint>
#include <initializer_list>
#include <span>
#include <utility>
#include <vector>

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "core/placement.h"
#include "core/vec3.h"

namespace isolux::binding {

namespace nb = nanobind;

template <typename T> using In1 = nb::ndarray<const T, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
template <typename T>
using In3 = nb::ndarray<const T, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using InMatrix = nb::ndarray<const double, nb::shape<4, 4>, nb::c_contig, nb::device::cpu>;
template <typename T> using Out = nb::ndarray<nb::numpy, T>;

template <typename T> std::span<const T> view(const In1<T>& a) { return {a.data(), a.size()}; }

// (n, 3) rows as vectors, without a copy: Vec3 is three values in a row.
template <typename T> std::span<const Vec3<T>> view(const In3<T>& a) {
    static_assert(sizeof(Vec3<T>) == 3 * sizeof(T));
    return {reinterpret_cast<const Vec3<T>*>(a.data()), a.shape(0)};
}

// Of a matrix for row vectors.
template <typename Matrix> Placement placement(const Matrix& m) {
    const auto row = [&](std::size_t i) { return Vec3d{m(i, 0), m(i, 1), m(i, 2)}; };
    return {row(0), row(1), row(2), row(3)};
}

// A NumPy array that owns the vector; Element may be a struct or array of T's.
template <typename T, typename Element>
Out<T> hand_over(std::vector<Element>&& values, std::initializer_list<std::size_t> shape) {
    auto* owned = new std::vector<Element>(std::move(values)); // freed by the capsule
    nb::capsule owner(owned,
                      [](void* p) noexcept { delete static_cast<std::vector<Element>*>(p); });
    return Out<T>(reinterpret_cast<T*>(owned->data()), shape, owner);
}

template <typename T> Out<T> hand_over(std::vector<T>&& values) {
    const std::size_t n = values.size();
    return hand_over<T, T>(std::move(values), {n});
}

template <typename T> Out<T> hand_over(std::vector<Vec3<T>>&& values) {
    const std::size_t n = values.size();
    return hand_over<T, Vec3<T>>(std::move(values), {n, 3});
}

} // namespace isolux::binding
