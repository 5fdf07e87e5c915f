// Final gather of indirect light.
#include <optional>
#include <stdexcept>

#include <nanobind/stl/optional.h>

#include "binding/arrays.h"
#include "core/final_gather.h"

namespace nb = nanobind;
using namespace nb::literals;
using namespace isolux;
using namespace isolux::binding;

namespace {

using PerVertex = std::optional<In3<float>>;

nb::dict advance(FinalGather& self, const In3<float>& illuminance, std::uint64_t ray_budget,
                 int threads, const PerVertex& bucket_indirect, double photon_flux,
                 const PerVertex& direct, const PhotonBuckets* photons) {
    KnownLight light{.all = view(illuminance), .photon_flux = photon_flux, .photons = photons};
    if (bucket_indirect) {
        light.indirect = view(*bucket_indirect);
    }
    if (direct) {
        light.direct = view(*direct);
    }
    for (const auto& part : {light.all, light.indirect, light.direct}) {
        if (part.size() != self.vertex_count() &&
            (part.data() == light.all.data() || !part.empty())) {
            throw std::invalid_argument("illuminance wants one row a vertex");
        }
    }
    GatheredIllumination found;
    {
        nb::gil_scoped_release release;
        found = self.advance(light, ray_budget, threads);
    }
    nb::dict out;
    out["indirect"] = hand_over(std::move(found.indirect));
    out["standard_error"] = hand_over(std::move(found.standard_error));
    out["indirect_rms"] = found.indirect_rms;
    out["rays"] = found.rays;
    return out;
}

} // namespace

void bind_final_gather(nb::module_& module) {
    nb::class_<FinalGather>(module, "FinalGather",
                            "Indirect light by a final gather at all vertices.")
        .def(
            "__init__",
            [](FinalGather* self, const Scene& scene, std::uint64_t seed) {
                new (self) FinalGather(scene, seed);
            },
            "scene"_a, "seed"_a, nb::keep_alive<1, 2>())
        .def(
            "advance", &advance, "illuminance"_a, "ray_budget"_a, "threads"_a,
            "bucket_indirect"_a.none() = nb::none(), "photon_flux"_a = 0.0,
            "direct"_a.none() = nb::none(), "photons"_a.none() = nb::none(),
            "Traces about ray_budget rays, and looks up the light anew in all.\n\n"
            "illuminance : (V, 3) float32, lx by channel: all light in each vertex's bucket\n"
            "bucket_indirect : (V, 3) float32, lx by channel: the indirect part of it, left by "
            "photons of photon_flux lm each; None: illuminance is exact\n"
            "direct : (V, 3) float32, lx by channel, at receiver_positions; None: not known\n"
            "photons : PhotonBuckets that bucket_indirect is of; None: their noise isn't told\n"
            "returns : dict of indirect (V, 3) float32, lx by channel, at receiver_positions; "
            "standard_error (V,) float32, lx; indirect_rms, lx, area-weighted; rays, of this call");
}
