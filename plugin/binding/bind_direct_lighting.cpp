// Deterministic direct lighting at points.
#include <optional>
#include <stdexcept>

#include <nanobind/stl/optional.h>

#include "binding/arrays.h"
#include "core/direct_lighting.h"

namespace nb = nanobind;
using namespace nb::literals;
using namespace isolux;
using namespace isolux::binding;

namespace {

std::vector<Receiver> receivers_of(const In3<double>& positions, const In3<float>& normals,
                                   const std::optional<In1<std::int32_t>>& meshes) {
    const auto p = view(positions);
    const auto n = view(normals);
    if (p.size() != n.size()) {
        throw std::invalid_argument("positions and normals differ in length");
    }
    if (meshes && meshes->size() != p.size()) {
        throw std::invalid_argument("positions and meshes differ in length");
    }
    std::vector<Receiver> out(p.size());
    for (std::size_t i = 0; i < out.size(); ++i) {
        out[i] = {p[i], n[i], meshes ? (*meshes)(i) : -1};
    }
    return out;
}

nb::dict illuminate(const DirectLighting& self, const In3<double>& positions,
                    const In3<float>& normals, const In1<float>& indirect, int threads,
                    const std::optional<In1<std::int32_t>>& meshes) {
    const auto receivers = receivers_of(positions, normals, meshes);
    if (indirect.size() != 0 && indirect.size() != receivers.size()) {
        throw std::invalid_argument("positions and indirect differ in length");
    }
    DirectIllumination found;
    {
        nb::gil_scoped_release release;
        found = self.illuminate(receivers, view(indirect), threads);
    }
    nb::dict out;
    out["illuminance"] = hand_over(std::move(found.illuminance));
    out["standard_error"] = hand_over(std::move(found.standard_error));
    out["shadow_rays"] = found.shadow_rays;
    return out;
}

} // namespace

void bind_direct_lighting(nb::module_& module) {
    nb::class_<DirectLighting>(module, "DirectLighting",
                               "Direct illuminance at points [Volevich 2000, 3.1.1].")
        .def(
            "__init__",
            [](DirectLighting* self, const Scene& scene, std::uint64_t seed, double accuracy) {
                new (self) DirectLighting(scene, {seed, accuracy});
            },
            "scene"_a, "seed"_a, "accuracy"_a, nb::keep_alive<1, 2>(),
            "accuracy : error relative to the total illuminance at which shadow rays stop")
        .def("aim_at", &DirectLighting::aim_at, "accuracy"_a, "Light as exactly from now on.")
        .def(
            "illuminate", &illuminate, "positions"_a, "normals"_a, "indirect"_a, "threads"_a,
            "meshes"_a.none() = nb::none(),
            "positions : (R, 3) float64, metres, world space\n"
            "normals : (R, 3) float32, unit, on the side that receives\n"
            "indirect : (R,) float32, lx, photometric, or empty\n"
            "meshes : (R,) int32, of the scene, for light links; None: every luminaire lights all\n"
            "returns : dict of illuminance (R, 3) float32, lx by channel; standard_error (R,) "
            "float32, lx; shadow_rays");
}
