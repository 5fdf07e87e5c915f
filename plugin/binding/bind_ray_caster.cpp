// Rays among triangles, and triangles of polygons.
#include <algorithm>
#include <memory>
#include <stdexcept>

#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include "binding/arrays.h"
#include "core/parallel.h"
#include "core/ray_caster.h"
#include "core/triangulation.h"

namespace nb = nanobind;
using namespace nb::literals;
using namespace isolux;
using namespace isolux::binding;

namespace {

using Triangles = In3<std::int32_t>;

std::span<const std::array<std::int32_t, 3>> rows(const Triangles& a) {
    return {reinterpret_cast<const std::array<std::int32_t, 3>*>(a.data()), a.shape(0)};
}

void require_same_length(std::size_t a, std::size_t b) {
    if (a != b) {
        throw std::invalid_argument("origins, directions and distances differ in length");
    }
}

nb::tuple closest_hits(const RayCaster& caster, const In3<double>& origins,
                       const In3<float>& directions) {
    const auto from = view(origins);
    const auto towards = view(directions);
    require_same_length(from.size(), towards.size());
    std::vector<std::int32_t> triangles(from.size());
    std::vector<std::array<float, 2>> barycentrics(from.size());
    std::vector<float> distances(from.size());
    {
        nb::gil_scoped_release release;
        parallel_for(kAllThreads, from.size(), [&](std::size_t i) {
            const Hit hit =
                caster.closest_hit({(from[i] - caster.origin()).as<float>(), towards[i]});
            triangles[i] = hit.triangle;
            barycentrics[i] = {hit.u, hit.v};
            distances[i] = hit.distance;
        });
    }
    const std::size_t n = from.size();
    return nb::make_tuple(hand_over(std::move(triangles)),
                          hand_over<float>(std::move(barycentrics), {n, 2}),
                          hand_over(std::move(distances)));
}

Out<float> transmitted(const RayCaster& caster, const In3<double>& origins,
                       const In3<double>& targets) {
    const auto from = view(origins);
    const auto to = view(targets);
    require_same_length(from.size(), to.size());
    std::vector<float> out(from.size());
    {
        nb::gil_scoped_release release;
        std::vector<Ray> rays(from.size());
        for (std::size_t i = 0; i < rays.size(); ++i) {
            rays[i] = {(from[i] - caster.origin()).as<float>(), (to[i] - from[i]).as<float>()};
        }
        constexpr std::size_t kRaysAtOnce = 1024;
        parallel_for(kAllThreads, rays.size() / kRaysAtOnce + 1, [&](std::size_t block) {
            const std::size_t first = block * kRaysAtOnce;
            const std::size_t count = std::min(kRaysAtOnce, rays.size() - first);
            caster.transmitted(std::span(rays).subspan(first, count),
                               std::span(out).subspan(first, count));
        });
    }
    return hand_over(std::move(out));
}

nb::tuple triangulate_faces(const In3<double>& points, const In1<std::int32_t>& counts,
                            const In1<std::int32_t>& indices, const In1<std::int32_t>& hole_faces,
                            bool flip_winding) {
    Triangulation out =
        triangulate({view(points), view(counts), view(indices), view(hole_faces), flip_winding});
    const std::size_t n = out.faces.size();
    return nb::make_tuple(hand_over<std::int32_t>(std::move(out.corners), {n, 3}),
                          hand_over(std::move(out.faces)));
}

} // namespace

void bind_ray_caster(nb::module_& module) {
    nb::class_<RayCaster>(module, "RayCaster", "Closest hits among triangles.")
        .def(
            "__init__",
            [](RayCaster* self, const In3<double>& points, const Triangles& triangles, int threads,
               const std::optional<In1<float>>& opacity,
               const std::vector<std::tuple<std::int32_t, std::int32_t, std::int32_t, InMatrix>>&
                   copies) {
                const auto a = opacity ? view(*opacity) : std::span<const float>{};
                if (opacity && a.size() != triangles.shape(0)) {
                    throw std::invalid_argument("opacity wants one entry a triangle");
                }
                std::vector<TriangleCopies> matched;
                for (const auto& [first, count, source, matrix] : copies) {
                    const auto match = match_copies(view(points), rows(triangles), first, count,
                                                    source, placement(matrix));
                    if (!match) {
                        throw std::invalid_argument("triangles that are no copies");
                    }
                    matched.push_back(*match);
                }
                new (self) RayCaster(
                    {view(points), rows(triangles), {a.begin(), a.end()}, {}, std::move(matched)},
                    threads);
            },
            "points"_a, "triangles"_a, "threads"_a = -1, "opacity"_a.none() = nb::none(),
            "copies"_a = nb::list(),
            "points : (V, 3) float64, metres, world space\n"
            "triangles : (T, 3) int32, valid indices into points\n"
            "opacity : (T,) float32 in (0, 1], share of the light that each stops; None: all\n"
            "copies : of (first, count, source, (4, 4) float64 matrix for row vectors): triangles "
            "that are those from source on in another place, to share a tree")
        .def_prop_ro("tree_bytes", &RayCaster::tree_bytes)
        .def("closest_hits", &closest_hits, "origins"_a, "directions"_a,
             "origins : (n, 3) float64, metres, world space\n"
             "directions : (n, 3) float32, of any length\n"
             "returns : triangle (n,) int32, -1 where nothing is hit; barycentrics (n, 2) float32, "
             "weights of the vertices 1 and 2; distance (n,) float32, in lengths of the direction")
        .def("transmitted", &transmitted, "origins"_a, "targets"_a,
             "origins, targets : (n, 3) float64, metres, world space\n"
             "returns : (n,) float32, share of the light that passes: 0 where an opaque triangle "
             "lies between");
    module.attr("MOST_EAR_CORNERS") = kMostEarCorners;
    module.def("triangulate", &triangulate_faces, "points"_a, "face_vertex_counts"_a,
               "face_vertex_indices"_a, "hole_faces"_a, "flip_winding"_a,
               "Triangles of polygon faces; holes and faces without area give none.\n\n"
               "points : (P, 3) float64, metres\n"
               "face_vertex_counts, face_vertex_indices, hole_faces : int32\n"
               "returns : corners (T, 3) int32, counter-clockwise seen from the front, counted "
               "over all faces; face of each triangle (T,) int32");
}
