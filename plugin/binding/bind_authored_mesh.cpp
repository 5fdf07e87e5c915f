// Meshes as their prims author them: what reading a stage does to every point and corner.
#include <stdexcept>

#include <nanobind/stl/optional.h>

#include "binding/arrays.h"
#include "core/authored_mesh.h"
#include "core/triangulation.h"

namespace nb = nanobind;
using namespace nb::literals;
using namespace isolux;
using namespace isolux::binding;

namespace {

template <typename T>
using InOut3 = nb::ndarray<T, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Matrix = nb::ndarray<const double, nb::shape<4, 3>, nb::c_contig, nb::device::cpu>;

template <typename T> std::span<Vec3<T>> view_to_fill(InOut3<T>& a, std::size_t wanted) {
    if (a.shape(0) != wanted) {
        throw std::invalid_argument("one row of output for each of input");
    }
    return {reinterpret_cast<Vec3<T>*>(a.data()), wanted};
}

Out<double> area_vectors(const In3<double>& points, const In1<std::int32_t>& indices,
                         const In1<std::int64_t>& first_corners, const In1<std::int32_t>& counts) {
    if (first_corners.size() != counts.size()) {
        throw std::invalid_argument("a first corner and a count a face");
    }
    const PolygonMesh mesh{view(points), {}, view(indices), {}};
    std::vector<Vec3d> out(counts.size());
    for (std::size_t f = 0; f < out.size(); ++f) {
        out[f] =
            area_vector(mesh, static_cast<std::int32_t>(first_corners.data()[f]), counts.data()[f]);
    }
    return hand_over(std::move(out));
}

} // namespace

void bind_authored_mesh(nb::module_& module) {
    nb::class_<TopologySurvey>(module, "TopologySurvey")
        .def_ro("corners", &TopologySurvey::corners)
        .def_ro("least_count", &TopologySurvey::least_count)
        .def_ro("greatest_count", &TopologySurvey::greatest_count)
        .def_ro("least_index", &TopologySurvey::least_index)
        .def_ro("greatest_index", &TopologySurvey::greatest_index)
        .def_ro("degenerate_faces", &TopologySurvey::degenerate_faces);

    module.def(
        "survey_topology",
        [](const In1<std::int32_t>& counts, const In1<std::int32_t>& indices, int threads) {
            nb::gil_scoped_release release;
            return survey_topology(view(counts), view(indices), threads);
        },
        "counts"_a, "indices"_a, "threads"_a,
        "Extremes of counts and indices; how many faces have under three corners or a point twice. "
        "The counts alone where they don't add up to the indices.");

    module.def(
        "place_points",
        [](const In3<float>& points, const Matrix& matrix, InOut3<double> out, int threads) {
            const auto filled = view_to_fill(out, points.shape(0));
            nb::gil_scoped_release release;
            return place_points(view(points), placement(matrix), filled, threads);
        },
        "points"_a, "matrix"_a, "out"_a.noconvert(), "threads"_a,
        "matrix : (4, 3) float64 for row vectors; out : (P, 3) float64, filled\n"
        "returns : whether all are numbers and none is over FARTHEST_POINT away");
    module.attr("FARTHEST_POINT") = kFarthestPoint;

    module.def(
        "place_normals",
        [](const In3<float>& normals, const std::optional<In1<std::int32_t>>& of,
           const Matrix& matrix, InOut3<float> out, int threads) {
            const auto corners = of ? view(*of) : std::span<const std::int32_t>{};
            const auto filled = view_to_fill(out, of ? corners.size() : normals.shape(0));
            nb::gil_scoped_release release;
            return place_normals(view(normals), corners, placement(matrix), filled, threads);
        },
        "normals"_a, "of"_a.none(), "matrix"_a, "out"_a.noconvert(), "threads"_a,
        "of : (C,) int32, the normal of each corner, each a valid index; None: one a corner\n"
        "matrix : (4, 3) float64 for row vectors; out : (C, 3) float32, filled with unit vectors\n"
        "returns : whether all normals were finite and other than zero");

    module.def("area_vectors", &area_vectors, "points"_a, "indices"_a, "first_corners"_a,
               "counts"_a,
               "(n, 3) float64, of n faces: twice the area long, by the corner order.\n\n"
               "indices : (C,) int32, valid, of all faces\n"
               "first_corners, counts : (n,) int64, int32; where each of the n begins in them, and "
               "how many are its own");
}
