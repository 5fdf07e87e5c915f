#include "core/photon_tracer.h"

#include <tbb/blocked_range.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include "core/sampling.h"

namespace isolux {
namespace {

// Each vertex stands for the third of an element that lies nearest to it in barycentric terms.
std::int32_t nearest_vertex(const MeshElement& element, const Hit& hit) {
    const float w = 1.0F - hit.u - hit.v;
    if (w >= hit.u && w >= hit.v) {
        return element.vertices[0];
    }
    return hit.u >= hit.v ? element.vertices[1] : element.vertices[2];
}

class PhotonWalk {
  public:
    PhotonWalk(const Scene& scene, PhotonBuckets& buckets, PhotonBuckets::Ends& ends)
        : scene_(scene), buckets_(buckets), ends_(ends) {}

    void trace(std::uint64_t seed, std::uint64_t photon) {
        PhotonRandom random(seed, photon);
        const std::size_t batch = photon % kBatches;
        const Luminaire& luminaire = scene_.choose_luminaire(random.next_double());
        const Emission emission = luminaire.sample_emission(random);
        const Vec3f direction = emission.direction.as<float>();
        const Vec3f origin = (emission.origin - scene_.ray_caster().origin()).as<float>();
        Ray ray{origin + direction * scene_.ray_caster().offset(origin, 0.0F), direction};
        Vec3f colour = luminaire.colour;
        LightPath path = LightPath::direct;
        ++ends_.emitted;
        while (bounce(ray, colour, path, batch, random)) {
            path = LightPath::indirect;
        }
    }

  private:
    // One ray and what it meets; false where the photon ends.
    bool bounce(Ray& ray, Vec3f& colour, LightPath path, std::size_t batch, PhotonRandom& random) {
        const IlluminationMesh& mesh = scene_.mesh();
        const Hit hit = scene_.ray_caster().closest_hit(ray);
        ++ends_.rays;
        if (hit.triangle == kNoHit) {
            ++ends_.escaped;
            return false;
        }
        const MeshElement& element = mesh.elements[static_cast<std::size_t>(hit.triangle)];
        const Surface& surface = mesh.surfaces[static_cast<std::size_t>(element.surface)];
        Vec3f normal = normalize(hit.normal);
        std::int32_t vertex = nearest_vertex(element, hit);
        if (dot(ray.direction, normal) > 0.0F) {
            if (surface.back_offset < 0) {
                ++ends_.back_hits[static_cast<std::size_t>(surface.mesh)];
                ++ends_.back_absorbed;
                return false;
            }
            normal = -normal;
            vertex += surface.back_offset;
        }
        buckets_.deposit(vertex, path, batch, colour);

        // Survival keeps the photon's luminous flux; its colour changes beside.
        const Vec3f reflected = colour * surface.reflectance;
        const float survival = luminance(reflected);
        if (random.next_double() >= static_cast<double>(survival)) {
            ++ends_.absorbed;
            return false;
        }
        if (scene_.coloured()) {
            colour = reflected * (1.0F / survival);
        }
        const Vec3f p = ray.origin + ray.direction * hit.distance;
        ray.direction = cosine_direction(normal, random);
        ray.origin = p + normal * scene_.ray_caster().offset(p, hit.distance);
        return true;
    }

    const Scene& scene_;
    PhotonBuckets& buckets_;
    PhotonBuckets::Ends& ends_;
};

} // namespace

void trace_photons(const Scene& scene, std::uint64_t seed, PhotonRange range, int threads,
                   PhotonBuckets& buckets) {
    constexpr std::uint64_t kGrain = 256;
    PhotonBuckets::Ends none;
    none.back_hits.resize(scene.mesh().meshes.size());
    tbb::enumerable_thread_specific<PhotonBuckets::Ends> ends(none);
    tbb::task_arena(threads).execute([&] {
        tbb::parallel_for(
            tbb::blocked_range<std::uint64_t>(range.first, range.first + range.count, kGrain),
            [&](const auto& block) {
                PhotonWalk walk(scene, buckets, ends.local());
                for (auto photon = block.begin(); photon < block.end(); ++photon) {
                    walk.trace(seed, photon);
                }
            });
    });
    for (const auto& e : ends) {
        buckets.add_ends(e);
    }
}

} // namespace isolux
