// The adaptive mesh, refined in turns with whatever illuminates its samples.
#include <stdexcept>

#include "binding/arrays.h"
#include "core/mesh_refinement.h"

namespace nb = nanobind;
using namespace nb::literals;
using namespace isolux;
using namespace isolux::binding;

namespace {

void begin(MeshRefinement& self, const In3<float>& direct, const In1<float>& standard_error,
           const In3<float>& indirect, double adaptation_luminance, double threshold,
           const In3<float>& regional, const In1<float>& regional_deviation) {
    const std::size_t n = self.mesh().vertex_count();
    if (direct.shape(0) != n || standard_error.size() != n || indirect.shape(0) != n) {
        throw std::invalid_argument("direct, standard_error and indirect want one entry a vertex");
    }
    if (regional.shape(0) != regional_deviation.size() ||
        (regional.shape(0) != 0 && regional.shape(0) != n)) {
        throw std::invalid_argument("regional and its deviation want one entry a vertex, or none");
    }
    nb::gil_scoped_release release;
    self.begin({view(direct), view(standard_error), view(indirect), view(regional),
                view(regional_deviation)},
               adaptation_luminance, threshold);
}

nb::dict wanted_samples(MeshRefinement& self) {
    std::vector<Vec3d> positions;
    std::vector<Vec3f> normals;
    std::vector<float> indirect;
    {
        nb::gil_scoped_release release;
        for (const std::int32_t sample : self.wanted_samples()) {
            const Receiver& receiver = self.sample(sample).receiver;
            positions.push_back(receiver.position);
            normals.push_back(receiver.normal);
            indirect.push_back(luminance(self.indirect(sample)));
        }
    }
    nb::dict out;
    out["positions"] = hand_over(std::move(positions));
    out["normals"] = hand_over(std::move(normals));
    out["indirect"] = hand_over(std::move(indirect));
    return out;
}

Out<std::int32_t> wanted_meshes(MeshRefinement& self) {
    std::vector<std::int32_t> out;
    for (const std::int32_t sample : self.wanted_samples()) {
        out.push_back(self.sample(sample).receiver.mesh);
    }
    return hand_over(std::move(out));
}

nb::dict mesh(const MeshRefinement& self) {
    const auto& elements = self.mesh().elements();
    const auto& splits = self.mesh().split_vertices();
    std::vector<std::array<std::int32_t, 3>> corners;
    std::vector<std::int32_t> element_parents, twins, points;
    std::vector<std::array<Vec3d, 3>> barycentrics;
    for (const RefinedElement& element : elements) {
        corners.push_back(element.vertices);
        element_parents.push_back(element.parent);
        barycentrics.push_back(element.barycentrics);
    }
    std::vector<std::array<std::int32_t, 2>> parents;
    std::vector<double> fractions;
    for (const SplitVertex& vertex : splits) {
        parents.push_back(vertex.parents);
        fractions.push_back(vertex.fraction);
        twins.push_back(vertex.twin);
        points.push_back(vertex.point);
    }
    std::vector<Vec3f> direct, normals;
    std::vector<float> standard_error;
    std::vector<Vec3d> positions, receiver_positions;
    const std::size_t total = self.mesh().vertex_count() + splits.size();
    for (std::size_t v = 0; v < total; ++v) {
        const LightSample& sample = self.vertex(static_cast<std::int32_t>(v));
        direct.push_back(sample.direct);
        standard_error.push_back(sample.standard_error);
        positions.push_back(sample.position);
        receiver_positions.push_back(sample.receiver.position);
        normals.push_back(sample.receiver.normal);
    }
    nb::dict out;
    const std::size_t split_count = splits.size(), element_count = elements.size();
    out["split_parents"] = hand_over<std::int32_t>(std::move(parents), {split_count, 2});
    out["split_fraction"] = hand_over(std::move(fractions));
    out["split_twin"] = hand_over(std::move(twins));
    out["split_point"] = hand_over(std::move(points));
    out["elements"] = hand_over<std::int32_t>(std::move(corners), {element_count, 3});
    out["element_parents"] = hand_over(std::move(element_parents));
    out["barycentrics"] = hand_over<double>(std::move(barycentrics), {element_count, 3, 3});
    out["direct"] = hand_over(std::move(direct));
    out["standard_error"] = hand_over(std::move(standard_error));
    out["vertex_positions"] = hand_over(std::move(positions));
    out["receiver_positions"] = hand_over(std::move(receiver_positions));
    out["vertex_normals"] = hand_over(std::move(normals));
    out["vertex_areas"] = hand_over(self.vertex_areas());
    return out;
}

} // namespace

void bind_mesh_refinement(nb::module_& module) {
    nb::class_<MeshRefinement>(
        module, "MeshRefinement",
        "The adaptive mesh [Volevich 2000, 3.1.1, 4]. A run is `begin`, then "
        "iterations: `wanted_samples` and `add_samples` in turns until none "
        "is wanted, then `split`.")
        .def(nb::init<const Scene&>(), "scene"_a, nb::keep_alive<1, 2>(),
             nb::call_guard<nb::gil_scoped_release>())
        .def(
            "begin", &begin, "direct"_a, "standard_error"_a, "indirect"_a, "adaptation_luminance"_a,
            "threshold"_a, "regional"_a, "regional_deviation"_a,
            "Back to the scene's own elements; samples of earlier runs are kept.\n\n"
            "direct : (V, 3) float32, lx by channel at the receivers of the scene's vertices\n"
            "standard_error : (V,) float32, lx, photometric\n"
            "indirect : (V, 3) float32, lx by channel\n"
            "adaptation_luminance : of the scene's observer, cd/m^2\n"
            "threshold : difference of displayed brightness that may be lost; 1: black to white\n"
            "regional : (V, 3) float32, lx by channel, direct light around each vertex by photons, "
            "or (0, 3)\n"
            "regional_deviation : (V,) float32, its relative deviation, or (0,)")
        .def("wanted_meshes", &wanted_meshes, "returns : (R,) int32, mesh of each wanted sample")
        .def("wanted_samples", &wanted_samples,
             "Receivers whose direct light is wanted next; none: ready to split.\n\n"
             "returns : dict of positions (n, 3) float64, m; normals (n, 3) float32; indirect (n,) "
             "float32, lx, photometric")
        .def(
            "add_samples",
            [](MeshRefinement& self, const In3<float>& direct, const In1<float>& standard_error) {
                self.add_samples(view(direct), view(standard_error));
            },
            "direct"_a, "standard_error"_a,
            "direct : (n, 3) float32, lx by channel, of the samples wanted last, in their order\n"
            "standard_error : (n,) float32, lx, photometric")
        .def("split", &MeshRefinement::split, nb::call_guard<nb::gil_scoped_release>(),
             "Ends an iteration. returns : whether any element was split")
        .def(
            "mesh", &mesh,
            "The arrays of isolux.solution.RefinedMesh by name, and of its V + S vertices: direct, "
            "standard_error, vertex_positions, vertex_normals, receiver_positions, vertex_areas.")
        .def_prop_ro("element_count",
                     [](const MeshRefinement& self) { return self.mesh().elements().size(); });
}
