// Photons: tracing them, their buckets, and the filter over these.
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include <nanobind/stl/vector.h>

#include "binding/arrays.h"
#include "core/illumination_filter.h"
#include "core/photon_tracer.h"
#include "core/rms_error.h"
#include "core/scene.h"

namespace nb = nanobind;
using namespace nb::literals;
using namespace isolux;
using namespace isolux::binding;

namespace {

nb::dict ends(const PhotonBuckets& buckets) {
    const auto& e = buckets.ends();
    nb::dict out;
    out["emitted"] = e.emitted;
    out["rays"] = e.rays;
    out["absorbed"] = e.absorbed;
    out["back_absorbed"] = e.back_absorbed;
    out["escaped"] = e.escaped;
    out["back_hits"] = e.back_hits;
    out["split"] = e.split;
    out["unlit"] = e.unlit;
    return out;
}

Out<std::uint64_t> hit_counts(const PhotonBuckets& buckets) {
    std::vector<std::array<std::uint64_t, 2>> counts(buckets.vertex_count());
    for (std::size_t v = 0; v < counts.size(); ++v) {
        const auto vertex = static_cast<std::int32_t>(v);
        counts[v] = {buckets.hit_count(vertex, LightPath::direct),
                     buckets.hit_count(vertex, LightPath::indirect)};
    }
    const std::size_t n = counts.size();
    return hand_over<std::uint64_t>(std::move(counts), {n, 2});
}

// lm
double flux_of_a_photon(const Scene& scene, const PhotonBuckets& buckets) {
    return scene.luminous_flux() /
           static_cast<double>(std::max<std::uint64_t>(1, buckets.ends().emitted));
}

Out<float> bucket_illuminance(const PhotonBuckets& buckets, const Scene& scene) {
    std::vector<std::array<Vec3f, 2>> out(buckets.vertex_count());
    const double photon_flux = flux_of_a_photon(scene, buckets);
    for (std::size_t v = 0; v < out.size(); ++v) {
        const double area = scene.mesh().areas[v];
        for (const LightPath path : {LightPath::direct, LightPath::indirect}) {
            const Vec3d sum = buckets.colour_sum(static_cast<std::int32_t>(v), path);
            out[v][static_cast<std::size_t>(path)] =
                (sum * (area > 0.0 ? photon_flux / area : 0.0)).as<float>();
        }
    }
    const std::size_t n = out.size();
    return hand_over<float>(std::move(out), {n, 2, 3});
}

// Of the photometric illuminance; 1 where there is none.
std::vector<float> relative_deviation(const FilteredIllumination& filtered) {
    std::vector<float> out(filtered.illuminance.size());
    for (std::size_t v = 0; v < out.size(); ++v) {
        const float e = luminance(filtered.illuminance[v]);
        out[v] = e > 0.0F ? filtered.standard_error[v] / e : 1.0F;
    }
    return out;
}

// Of the sum of two independent estimates.
std::vector<float> total_deviation(const FilteredIllumination& a, const FilteredIllumination& b) {
    std::vector<float> out(a.illuminance.size());
    for (std::size_t v = 0; v < out.size(); ++v) {
        const float e = luminance(a.illuminance[v]) + luminance(b.illuminance[v]);
        out[v] = e > 0.0F ? std::hypot(a.standard_error[v], b.standard_error[v]) / e : 1.0F;
    }
    return out;
}

nb::dict filter(const IlluminationFilter& self, const Scene& scene, const PhotonBuckets& buckets,
                double accuracy, double sharing, bool paper_interval, int threads) {
    const FilterSettings settings{accuracy, sharing,
                                  paper_interval ? IntervalRule::paper : IntervalRule::corrected};
    std::array<FilteredIllumination, 2> filtered;
    RmsErrors errors;
    {
        nb::gil_scoped_release release;
        const double photon_flux = flux_of_a_photon(scene, buckets);
        filtered = self.filter(buckets, photon_flux, settings, threads);
        errors = rms_errors(scene.mesh(), buckets, photon_flux, filtered[0], filtered[1]);
    }
    auto& [direct, indirect] = filtered;
    nb::dict out;
    out["relative_deviation"] = hand_over(total_deviation(direct, indirect));
    out["direct_relative_deviation"] = hand_over(relative_deviation(direct));
    out["direct_standard_error"] = hand_over(std::move(direct.standard_error));
    out["indirect_standard_error"] = hand_over(std::move(indirect.standard_error));
    out["direct"] = hand_over(std::move(direct.illuminance));
    out["indirect"] = hand_over(std::move(indirect.illuminance));
    out["support_radius"] = hand_over(std::move(indirect.support_radius));
    out["direct_support_radius"] = hand_over(std::move(direct.support_radius));
    out["bucket_rms_error"] = errors.bucket_total;
    out["bucket_rms_error_indirect"] = errors.bucket_indirect;
    out["batch_rms_error"] = errors.batch_total;
    out["rms_error"] = errors.filtered_total;
    out["rms_error_indirect"] = errors.filtered_indirect;
    return out;
}

} // namespace

void bind_photons(nb::module_& module) {
    nb::class_<PhotonBuckets>(module, "PhotonBuckets",
                              "Hit counts and coloured flux of each illumination vertex.")
        .def(
            "__init__",
            [](PhotonBuckets* self, const Scene& scene) {
                new (self) PhotonBuckets(scene.mesh().positions.size(), scene.mesh().meshes.size(),
                                         scene.coloured());
            },
            "scene"_a)
        .def("merge", &PhotonBuckets::merge, "other"_a,
             "Adds the buckets of another range of photons of the same scene.")
        .def_prop_ro("ends", &ends, "Photons emitted, and how they ended; rays; back hits a mesh.")
        .def_prop_ro("hit_counts", &hit_counts, nb::rv_policy::automatic,
                     "(V, 2) uint64: direct, indirect")
        .def("illuminance", &bucket_illuminance, "scene"_a,
             "(V, 2, 3) float32, lx by channel, unfiltered: direct, indirect; 0 where a vertex has "
             "no area");

    module.def(
        "trace_photons",
        [](const Scene& scene, PhotonBuckets& buckets, std::uint64_t seed, std::uint64_t first,
           std::uint64_t count, int threads) {
            if (scene.luminaires().empty()) {
                throw std::invalid_argument("photons want a luminaire");
            }
            trace_photons(scene, seed, {first, count}, threads, buckets);
        },
        "scene"_a, "buckets"_a, "seed"_a, "first"_a, "count"_a, "threads"_a,
        nb::call_guard<nb::gil_scoped_release>(),
        "Traces photons [first, first + count) and adds their hits to the buckets. A photon "
        "depends on the seed and its index alone.");

    nb::class_<IlluminationFilter>(module, "IlluminationFilter",
                                   "Filters buckets over adaptive supports [Volevich 2000, A].")
        .def(
            "__init__",
            [](IlluminationFilter* self, const Scene& scene) {
                new (self) IlluminationFilter(scene.mesh(), scene.buried());
            },
            "scene"_a, nb::keep_alive<1, 2>())
        .def("filter", &filter, "scene"_a, "buckets"_a, "accuracy"_a, "sharing"_a,
             "paper_interval"_a, "threads"_a,
             "returns : dict of direct, indirect (V, 3) float32, lx by channel; "
             "relative_deviation, support_radius (V,) float32; RMS errors");

    module.def(
        "poisson_interval",
        [](std::uint64_t n, bool paper) {
            const Interval i =
                poisson_interval(n, paper ? IntervalRule::paper : IntervalRule::corrected);
            return nb::make_tuple(i.low, i.high);
        },
        "n"_a, "paper"_a,
        "Plausible mean counts where n photons were counted; low > high where the rule leaves "
        "none.");
}
