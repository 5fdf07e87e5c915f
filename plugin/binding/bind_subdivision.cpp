// Subdivision surfaces over arrays: cage in, refined faces, limit points and stencils out.
#include "binding/arrays.h"
#include "core/subdivision.h"

#include <nanobind/stl/string.h>
#include <nanobind/stl/unique_ptr.h>

#include <map>
#include <memory>
#include <stdexcept>
#include <string>

namespace nb = nanobind;
using namespace nb::literals;
using namespace isolux;
using namespace isolux::binding;

namespace {

using Edges = nb::ndarray<const std::int32_t, nb::shape<-1, 2>, nb::c_contig, nb::device::cpu>;

template <typename Rule>
Rule rule_named(const std::map<std::string, Rule>& rules, const std::string& name) {
    const auto found = rules.find(name);
    if (found == rules.end()) {
        throw nb::value_error(("no rule " + name).c_str());
    }
    return found->second;
}

SubdivisionRules rules_named(const std::string& scheme, const std::string& boundary,
                             const std::string& face_varying, bool smooth_triangles) {
    SubdivisionRules rules;
    rules.scheme =
        rule_named<SubdivisionScheme>({{"bilinear", SubdivisionScheme::bilinear},
                                       {"catmullClark", SubdivisionScheme::catmull_clark},
                                       {"loop", SubdivisionScheme::loop}},
                                      scheme);
    rules.boundary = rule_named<BoundaryRule>({{"none", BoundaryRule::none},
                                               {"edgeOnly", BoundaryRule::edge_only},
                                               {"edgeAndCorner", BoundaryRule::edge_and_corner}},
                                              boundary);
    rules.face_varying =
        rule_named<FaceVaryingRule>({{"none", FaceVaryingRule::none},
                                     {"cornersOnly", FaceVaryingRule::corners_only},
                                     {"cornersPlus1", FaceVaryingRule::corners_plus1},
                                     {"cornersPlus2", FaceVaryingRule::corners_plus2},
                                     {"boundaries", FaceVaryingRule::boundaries},
                                     {"all", FaceVaryingRule::all}},
                                    face_varying);
    rules.smooth_triangles = smooth_triangles;
    return rules;
}

void require_within(std::span<const std::int32_t> indices, std::size_t count, const char* of) {
    for (const std::int32_t i : indices) {
        if (i < 0 || static_cast<std::size_t>(i) >= count) {
            throw nb::index_error(of);
        }
    }
}

std::unique_ptr<SubdividedSurface>
make_surface(std::int32_t point_count, const In1<std::int32_t>& counts,
             const In1<std::int32_t>& indices, const In1<std::int32_t>& hole_faces,
             const Edges& sharp_edges, const In1<float>& edge_sharpness,
             const In1<std::int32_t>& sharp_points, const In1<float>& point_sharpness,
             const In1<std::int32_t>& face_varying_indices, const std::string& scheme,
             const std::string& boundary, const std::string& face_varying, bool smooth_triangles,
             std::int32_t level) {
    ControlCage cage;
    cage.point_count = point_count;
    cage.face_vertex_counts = view(counts);
    cage.face_vertex_indices = view(indices);
    cage.hole_faces = view(hole_faces);
    cage.sharp_edges = {reinterpret_cast<const std::array<std::int32_t, 2>*>(sharp_edges.data()),
                        sharp_edges.shape(0)};
    cage.edge_sharpness = view(edge_sharpness);
    cage.sharp_points = view(sharp_points);
    cage.point_sharpness = view(point_sharpness);
    cage.face_varying_indices = view(face_varying_indices);
    std::size_t corners = 0;
    for (const std::int32_t count : cage.face_vertex_counts) {
        if (count < 3) {
            throw nb::value_error("a face of fewer than three corners");
        }
        corners += static_cast<std::size_t>(count);
    }
    if (corners != cage.face_vertex_indices.size() ||
        cage.sharp_edges.size() != cage.edge_sharpness.size() ||
        cage.sharp_points.size() != cage.point_sharpness.size() ||
        (!cage.face_varying_indices.empty() && cage.face_varying_indices.size() != corners) ||
        level < 0) {
        throw nb::value_error("arrays of the cage differ in length");
    }
    const auto points = static_cast<std::size_t>(point_count);
    require_within(cage.face_vertex_indices, points, "a corner at no point");
    require_within({sharp_edges.data(), sharp_edges.size()}, points, "a sharp edge at no point");
    require_within(cage.sharp_points, points, "a sharp point that is none");
    require_within(cage.hole_faces, cage.face_vertex_counts.size(), "a hole that is no face");
    require_within(cage.face_varying_indices, corners, "a face-varying value beyond the corners");
    const SubdivisionRules rules = rules_named(scheme, boundary, face_varying, smooth_triangles);
    nb::gil_scoped_release unlocked;
    return std::make_unique<SubdividedSurface>(cage, rules, level);
}

nb::tuple as_tuple(SparseRows&& rows) {
    return nb::make_tuple(hand_over(std::move(rows.begin)), hand_over(std::move(rows.columns)),
                          hand_over(std::move(rows.weights)));
}

template <auto Rows> nb::tuple stencils(const SubdividedSurface& surface) {
    SparseRows rows;
    {
        nb::gil_scoped_release unlocked;
        rows = (surface.*Rows)();
    }
    return as_tuple(std::move(rows));
}

template <auto Integers> Out<std::int32_t> integers(const SubdividedSurface& surface) {
    return hand_over((surface.*Integers)());
}

} // namespace

void bind_subdivision(nb::module_& module) {
    nb::class_<SubdividedSurface>(module, "SubdividedSurface",
                                  "A control cage refined uniformly by the rules of its scheme.")
        .def(nb::new_(&make_surface), "point_count"_a, "face_vertex_counts"_a,
             "face_vertex_indices"_a, "hole_faces"_a, "sharp_edges"_a, "edge_sharpness"_a,
             "sharp_points"_a, "point_sharpness"_a, "face_varying_indices"_a, "scheme"_a,
             "boundary"_a, "face_varying"_a, "smooth_triangles"_a, "level"_a,
             "sharp_edges : (E, 2) int32, points; edge_sharpness : (E,) float32, 10 is infinite\n"
             "face_varying_indices : (C,) int32; empty: none\n"
             "scheme, boundary, face_varying : the tokens of UsdGeomMesh\n"
             "raises : ValueError where the cage can't be refined")
        .def_prop_ro("point_count", &SubdividedSurface::point_count)
        .def("face_vertex_counts", &integers<&SubdividedSurface::face_vertex_counts>)
        .def("face_vertex_indices", &integers<&SubdividedSurface::face_vertex_indices>)
        .def("cage_faces", &integers<&SubdividedSurface::cage_faces>,
             "(F,) int32, face of the cage of which each refined face is a part")
        .def("hole_faces", &integers<&SubdividedSurface::hole_faces>)
        .def("corners_of_cage", &integers<&SubdividedSurface::corners_of_cage>,
             "(C,) int32, refined corner at each corner of the cage")
        .def("face_varying_indices", &integers<&SubdividedSurface::face_varying_indices>,
             "one a refined corner: row of face_varying_stencils")
        .def(
            "limit_points",
            [](const SubdividedSurface& surface, const In3<double>& points) {
                return hand_over(surface.limit_points(view(points)));
            },
            "points"_a, "(V, 3) float64 from the cage's (P, 3) float64")
        .def(
            "limit_normals",
            [](const SubdividedSurface& surface, const In3<double>& points) {
                return hand_over(surface.limit_normals(view(points)));
            },
            "points"_a, "(C, 3) float32, unit, by the winding, at the refined corners")
        .def(
            "chord_error",
            [](const SubdividedSurface& surface, const In3<double>& points) {
                return surface.chord_error(view(points));
            },
            "points"_a, "greatest distance of the last level's new points from the faces before it")
        .def("limit_stencils", &stencils<&SubdividedSurface::limit_stencils>,
             "Sparse rows (begin, columns, weights): refined from cage points")
        .def("varying_stencils", &stencils<&SubdividedSurface::varying_stencils>,
             "the same, linear over the cage's faces")
        .def("face_varying_stencils", &stencils<&SubdividedSurface::face_varying_stencils>,
             "refined from the cage's face-varying values");
}
