// Hierarchical progressive radiosity.
#include <algorithm>
#include <stdexcept>

#include "binding/arrays.h"
#include "core/progressive_radiosity.h"

namespace nb = nanobind;
using namespace nb::literals;
using namespace isolux;
using namespace isolux::binding;

namespace {

nb::tuple receivers(const ProgressiveRadiosity& self) {
    const auto leaves = self.receivers();
    std::vector<Vec3d> positions(leaves.size());
    std::vector<Vec3f> normals(leaves.size());
    for (std::size_t i = 0; i < leaves.size(); ++i) {
        positions[i] = leaves[i].position;
        normals[i] = leaves[i].normal;
    }
    return nb::make_tuple(hand_over(std::move(positions)), hand_over(std::move(normals)));
}

Out<std::int32_t> receiver_meshes(const ProgressiveRadiosity& self) {
    const auto leaves = self.receivers();
    std::vector<std::int32_t> out(leaves.size());
    std::ranges::transform(leaves, out.begin(), &Receiver::mesh);
    return hand_over(std::move(out));
}

void begin(ProgressiveRadiosity& self, const In3<float>& direct) {
    if (direct.shape(0) != self.receivers().size()) {
        throw std::invalid_argument("direct light wants one row a receiver");
    }
    self.begin(view(direct));
}

nb::dict advance(ProgressiveRadiosity& self, std::uint64_t ray_budget, int threads) {
    ShootingProgress progress;
    {
        nb::gil_scoped_release release;
        progress = self.advance(ray_budget, threads);
    }
    nb::dict out;
    out["unshot"] = progress.unshot;
    out["shot_flux"] = progress.shot_flux;
    out["lost_flux"] = progress.lost_flux;
    out["received_flux"] = progress.received_flux;
    out["rays"] = progress.rays;
    out["finished"] = progress.finished;
    return out;
}

nb::dict indirect(const ProgressiveRadiosity& self, const In3<double>& positions,
                  const In3<float>& normals, int threads) {
    const auto p = view(positions);
    const auto n = view(normals);
    if (p.size() != n.size()) {
        throw std::invalid_argument("positions and normals differ in length");
    }
    std::vector<Receiver> points(p.size());
    for (std::size_t i = 0; i < points.size(); ++i) {
        points[i] = {p[i], n[i]};
    }
    IndirectIllumination found;
    {
        nb::gil_scoped_release release;
        found = self.indirect(points, threads);
    }
    nb::dict out;
    out["illuminance"] = hand_over(std::move(found.illuminance));
    out["standard_error"] = hand_over(std::move(found.standard_error));
    out["rays"] = found.rays;
    return out;
}

} // namespace

void bind_progressive_radiosity(nb::module_& module) {
    nb::class_<ProgressiveRadiosity>(
        module, "ProgressiveRadiosity",
        "Indirect light by hierarchical progressive radiosity [Volevich 2000, 3.1.2].")
        .def(
            "__init__",
            [](ProgressiveRadiosity* self, const Scene& scene, std::uint64_t seed,
               double accuracy) { new (self) ProgressiveRadiosity(scene, {seed, accuracy}); },
            "scene"_a, "seed"_a, "accuracy"_a, nb::keep_alive<1, 2>(),
            "accuracy : error of the indirect illuminance at a point, of its mean, aimed at")
        .def("receivers", &receivers,
             "returns : positions (L, 3) float64, m, and normals (L, 3) float32 of the leaves: "
             "where direct light is wanted")
        .def("receiver_meshes", &receiver_meshes, "returns : (L,) int32, mesh of each receiver")
        .def("begin", &begin, "direct"_a,
             "direct : (L, 3) float32, lx by channel, at the receivers\n"
             "Forgets what was shot before.")
        .def("advance", &advance, "ray_budget"_a, "threads"_a,
             "Shoots, a reflection at a time, until about so many rays are spent, one reflection "
             "at least.\n"
             "returns : dict of unshot, the share of the indirect light still to come; shot_flux, "
             "lost_flux, received_flux, lm so far; rays so far; finished")
        .def_prop_ro(
            "exitance", [](const ProgressiveRadiosity& self) { return hand_over(self.exitance()); },
            nb::rv_policy::automatic,
            "(L, 3) float32, lm/m^2 by channel, of each leaf: what it reflects so far")
        .def("indirect", &indirect, "positions"_a, "normals"_a, "threads"_a,
             "positions : (R, 3) float64, metres, world space\n"
             "normals : (R, 3) float32, unit, on the side that receives; zero: no light\n"
             "returns : dict of illuminance (R, 3) float32, lx by channel; standard_error (R,) "
             "float32, lx, photometric; rays");
}
