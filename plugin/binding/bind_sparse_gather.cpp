// Sparse final gather of indirect light.
#include <optional>
#include <stdexcept>

#include <nanobind/stl/optional.h>

#include "binding/arrays.h"
#include "core/sparse_gather.h"

namespace nb = nanobind;
using namespace nb::literals;
using namespace isolux;
using namespace isolux::binding;

namespace {

nb::dict advance(SparseGather& self, const In3<float>& illuminance, std::uint64_t ray_budget,
                 int threads, const std::optional<In3<float>>& bucket_indirect,
                 double photon_flux) {
    BucketIllumination buckets;
    if (bucket_indirect) {
        buckets = {view(*bucket_indirect), photon_flux};
    }
    if (illuminance.shape(0) != self.vertex_count() ||
        (bucket_indirect && bucket_indirect->shape(0) != self.vertex_count())) {
        throw std::invalid_argument("illuminance wants one row a vertex");
    }
    GatheredIllumination found;
    {
        nb::gil_scoped_release release;
        found = self.advance(view(illuminance), buckets, ray_budget, threads);
    }
    nb::dict out;
    out["indirect"] = hand_over(std::move(found.indirect));
    out["standard_error"] = hand_over(std::move(found.standard_error));
    out["indirect_rms"] = found.indirect_rms;
    out["records"] = found.records;
    out["rays"] = found.rays;
    return out;
}

} // namespace

void bind_sparse_gather(nb::module_& module) {
    nb::class_<SparseGather>(module, "SparseGather",
                             "Indirect light by a final gather at few vertices, interpolated.")
        .def(
            "__init__",
            [](SparseGather* self, const Scene& scene, std::uint64_t seed) {
                new (self) SparseGather(scene, seed);
            },
            "scene"_a, "seed"_a, nb::keep_alive<1, 2>())
        .def("advance", &advance, "illuminance"_a, "ray_budget"_a, "threads"_a,
             "bucket_indirect"_a.none() = nb::none(), "photon_flux"_a = 0.0,
             "Adds records worth about ray_budget rays, and looks up the light anew in all.\n\n"
             "illuminance : (V, 3) float32, lx by channel: all light that falls on each vertex\n"
             "bucket_indirect : (V, 3) float32, lx by channel: what photons of photon_flux lm each "
             "left; joined with the gathered light, each weighted by its error\n"
             "returns : dict of indirect (V, 3) float32, lx by channel, at receiver_positions; "
             "standard_error (V,) float32, lx; indirect_rms, lx, of both noise and interpolation, "
             "area-weighted; records; rays, of this call");
}
