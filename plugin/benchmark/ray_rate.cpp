// What Embree alone can do on a scene's own tree: closest hits of incoherent rays, occlusion of
// shadow rays. Photon tracing and direct lighting are measured against it. Not part of the product:
// built with -DISOLUX_BENCHMARK=ON.
#include <algorithm>
#include <array>
#include <atomic>
#include <span>
#include <vector>

#include <nanobind/nanobind.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include "core/luminaire_illuminance.h"
#include "core/sampling.h"
#include "core/scene.h"

namespace nb = nanobind;
using namespace nb::literals;
using namespace isolux;

namespace {

// Rays as diffuse reflection makes them, from points spread evenly over all surfaces, in memory
// and in no order.
class IncoherentRays {
  public:
    IncoherentRays(const Scene& scene, std::size_t count, std::uint64_t seed)
        : ray_caster_(scene.ray_caster()), rays_(count) {
        const IlluminationMesh& mesh = scene.mesh();
        std::vector<double> cumulative_area;
        double area = 0.0;
        for (const MeshElement& element : mesh.elements) {
            area += 0.5 * length(twice_area(mesh, element));
            cumulative_area.push_back(area);
        }
        for (std::size_t i = 0; i < count; ++i) {
            PhotonRandom random(seed, i);
            const auto at = std::ranges::upper_bound(cumulative_area, random.next_double() * area);
            const auto last = std::prev(cumulative_area.end());
            const std::size_t e = std::min(at, last) - cumulative_area.begin();
            rays_[i] = reflected_ray(mesh, mesh.elements[e], random);
        }
    }

    // The number of rays that hit something.
    std::size_t shoot(int threads) const {
        constexpr std::size_t kGrain = 1024;
        std::atomic<std::size_t> hits = 0;
        tbb::task_arena(threads).execute([&] {
            tbb::parallel_for(tbb::blocked_range<std::size_t>(0, rays_.size(), kGrain),
                              [&](const auto& block) {
                                  std::size_t found = 0;
                                  for (auto i = block.begin(); i < block.end(); ++i) {
                                      found += ray_caster_.closest_hit(rays_[i]).triangle != kNoHit;
                                  }
                                  hits += found;
                              });
        });
        return hits;
    }

  private:
    static Vec3d twice_area(const IlluminationMesh& mesh, const MeshElement& element) {
        const auto& [a, b, c] = element.vertices;
        return cross(mesh.positions[b] - mesh.positions[a], mesh.positions[c] - mesh.positions[a]);
    }

    Ray reflected_ray(const IlluminationMesh& mesh, const MeshElement& element,
                      PhotonRandom& random) const {
        double u = random.next_double(), v = random.next_double();
        if (u + v > 1.0) {
            u = 1.0 - u;
            v = 1.0 - v;
        }
        const auto& [a, b, c] = element.vertices;
        const Vec3d at = mesh.positions[a] + (mesh.positions[b] - mesh.positions[a]) * u +
                         (mesh.positions[c] - mesh.positions[a]) * v;
        const bool two_sided = mesh.surfaces[element.surface].back_offset >= 0;
        const double side = two_sided && random.next_double() < 0.5 ? -1.0 : 1.0;
        const Vec3f normal = normalize((twice_area(mesh, element) * side).as<float>());
        const Vec3f origin = (at - ray_caster_.origin()).as<float>();
        return {origin + normal * ray_caster_.offset(origin, 1.0F),
                cosine_direction(normal, random)};
    }

    const RayCaster& ray_caster_;
    std::vector<Ray> rays_;
};

// Shadow rays from all vertices to points of all luminaires that they may see, in memory, those of
// a vertex together.
class ShadowRays {
  public:
    ShadowRays(const Scene& scene, std::uint64_t seed) : ray_caster_(scene.ray_caster()) {
        const std::vector<LuminaireIlluminance> luminaires(scene.luminaires().begin(),
                                                           scene.luminaires().end());
        PhotonRandom random(seed, 0);
        for (const Receiver& receiver : vertex_receivers(scene.mesh())) {
            const Vec3f local = (receiver.position - ray_caster_.origin()).as<float>();
            const Vec3f from = local + receiver.normal * ray_caster_.offset(local, 0.0F);
            for (const LuminaireIlluminance& luminaire : luminaires) {
                const double u = random.next_double();
                const auto at = luminaire.shadow_sample(receiver, u, random.next_double());
                if (at.weight > 0.0 && luminaire.unoccluded(receiver) > 0.0) {
                    rays_.push_back({from, (at.point - ray_caster_.origin()).as<float>() - from});
                }
            }
        }
    }

    std::size_t count() const { return rays_.size(); }

    // The number of rays that are occluded.
    std::size_t shoot(int threads) const {
        constexpr std::size_t kGrain = 1024;
        std::atomic<std::size_t> hits = 0;
        tbb::task_arena(threads).execute([&] {
            tbb::parallel_for(
                tbb::blocked_range<std::size_t>(0, rays_.size(), kGrain), [&](const auto& block) {
                    std::array<float, kGrain> transmitted;
                    for (auto i = block.begin(); i < block.end();) {
                        const std::size_t count = std::min(kGrain, block.end() - i);
                        const std::span out(transmitted.data(), count);
                        ray_caster_.transmitted(std::span(rays_).subspan(i, count), out);
                        hits += static_cast<std::size_t>(std::ranges::count(out, 0.0F));
                        i += count;
                    }
                });
        });
        return hits;
    }

  private:
    const RayCaster& ray_caster_;
    std::vector<Ray> rays_;
};

} // namespace

NB_MODULE(_ray_rate, module) {
    nb::module_::import_("isolux._core"); // knows Scene
    nb::class_<IncoherentRays>(module, "IncoherentRays",
                               "Diffuse rays from random surface points of a scene, in memory.")
        .def(nb::init<const Scene&, std::size_t, std::uint64_t>(), "scene"_a, "count"_a, "seed"_a,
             nb::keep_alive<1, 2>())
        .def("shoot", &IncoherentRays::shoot, "threads"_a, nb::call_guard<nb::gil_scoped_release>(),
             "Finds every ray's closest hit; returns how many there are.");
    nb::class_<ShadowRays>(module, "ShadowRays",
                           "Rays from the vertices of a scene to its luminaires, in memory.")
        .def(nb::init<const Scene&, std::uint64_t>(), "scene"_a, "seed"_a, nb::keep_alive<1, 2>())
        .def_prop_ro("count", &ShadowRays::count)
        .def("shoot", &ShadowRays::shoot, "threads"_a, nb::call_guard<nb::gil_scoped_release>(),
             "Tells of every ray whether it is occluded; returns how many are.");
}
