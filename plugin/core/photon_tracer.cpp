#include "core/photon_tracer.h"

#include <array>
#include <cmath>
#include <vector>

#include <tbb/enumerable_thread_specific.h>

#include "core/coincident_surfaces.h"
#include "core/parallel.h"
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

// Photons that are followed side by side: each waits for memory while the others go on.
constexpr std::size_t kFront = 16;

// Of the distance, how far behind a hit a ray goes on: the rounding of the distance.
constexpr float kPassed = 0x1p-20F;

class PhotonWalk {
  public:
    PhotonWalk(const Scene& scene, PhotonBuckets& buckets, PhotonBuckets::Ends& ends)
        : scene_(scene), buckets_(buckets), ends_(ends) {}

    void trace(std::uint64_t seed, std::uint64_t first, std::uint64_t last) {
        std::array<Photon, kFront> front;
        std::size_t alive = 0;
        while (first < last || alive > 0 || !passing_.empty()) {
            while (alive < kFront && !passing_.empty()) {
                front[alive++] = passing_.back();
                passing_.pop_back();
            }
            while (alive < kFront && first < last) {
                front[alive++] = emit(seed, first++);
            }
            for (std::size_t i = 0; i < alive; ++i) {
                cast(front[i]);
            }
            for (std::size_t i = 0; i < alive; ++i) {
                find_bucket(front[i]);
            }
            std::size_t kept = 0;
            for (std::size_t i = 0; i < alive; ++i) {
                if (bounce(front[i])) {
                    front[kept++] = front[i];
                }
            }
            alive = kept;
        }
    }

  private:
    struct Photon {
        PhotonRandom random{0, 0};
        std::uint8_t batch = 0;
        LightPath path = LightPath::direct;
        Vec3f colour; // of luminance 1
        Ray ray;
        const MeshLinks* links = nullptr; // of its luminaire, while it comes straight from there
        Hit hit;
        Vec3f normal;                 // on the side that was hit
        std::int32_t vertex = kNoHit; // whose bucket takes it; kNoHit: a one-sided mesh's back
    };

    Photon emit(std::uint64_t seed, std::uint64_t index) {
        Photon photon;
        photon.random = PhotonRandom(seed, index);
        photon.batch = static_cast<std::uint8_t>(index % kBatches);
        const Luminaire& luminaire = scene_.choose_luminaire(photon.random.next_double());
        const Emission emission = luminaire.sample_emission(photon.random);
        const RayCaster& caster = scene_.ray_caster();
        const Vec3f direction = emission.direction.as<float>();
        const Vec3f origin = (emission.origin - caster.origin()).as<float>();
        photon.ray = {origin + luminaire.clearance(direction) * caster.offset(origin, 0.0F),
                      direction};
        photon.colour = emission.colour;
        if (luminaire.links) {
            photon.links = luminaire.links.get();
            photon.ray.meshes = photon.links->met.data();
        }
        ++ends_.emitted;
        return photon;
    }

    void cast(Photon& photon) {
        photon.hit = scene_.ray_caster().closest_hit(photon.ray);
        ++ends_.rays;
        if (photon.hit.triangle != kNoHit) {
            __builtin_prefetch(&element_of(photon.hit));
        }
    }

    void find_bucket(Photon& photon) {
        if (photon.hit.triangle == kNoHit) {
            return;
        }
        const MeshElement& element = element_of(photon.hit);
        photon.normal = normalize(photon.hit.normal);
        photon.vertex = nearest_vertex(element, photon.hit);
        if (dot(photon.ray.direction, photon.normal) > 0.0F) {
            const std::int32_t back_offset = surface_of(element).back_offset;
            photon.normal = -photon.normal;
            photon.vertex = back_offset < 0 ? kNoHit : photon.vertex + back_offset;
            if (back_offset < 0) {
                find_front(photon);
            }
        }
        if (photon.vertex != kNoHit) {
            buckets_.prefetch(photon.vertex, photon.path, photon.batch);
        }
    }

    // Of a photon at a one-sided back: another sheet may lie in the same place.
    void find_front(Photon& photon) {
        const Hit hit = facing_hit(scene_.mesh(), scene_.ray_caster(), photon.ray, photon.hit);
        if (hit.triangle != photon.hit.triangle) {
            photon.hit = hit;
            find_bucket(photon);
        }
    }

    // Leaves the photon in its bucket; false where it ends.
    bool bounce(Photon& photon) {
        if (photon.hit.triangle == kNoHit) {
            ++ends_.escaped;
            return false;
        }
        const Surface& surface = surface_of(element_of(photon.hit));
        if (photon.links != nullptr && !arrives(photon, static_cast<std::size_t>(surface.mesh))) {
            return photon.links != nullptr;
        }
        if (photon.vertex == kNoHit) {
            ++ends_.back_hits[static_cast<std::size_t>(surface.mesh)];
            ++ends_.back_absorbed;
            return false;
        }
        buckets_.deposit(photon.vertex, photon.path, photon.batch, photon.colour);

        // Survival keeps the photon's luminous flux; its colour changes beside.
        const Vec3f reflected = photon.colour * surface.reflectance;
        const float survival = luminance(reflected);
        if (photon.random.next_double() >= static_cast<double>(survival)) {
            ++ends_.absorbed;
            return false;
        }
        if (scene_.coloured()) {
            photon.colour = reflected * (1.0F / survival);
        }
        photon.path = LightPath::indirect;
        const Vec3f p = photon.ray.origin + photon.ray.direction * photon.hit.distance;
        photon.ray.direction = cosine_direction(photon.normal, photon.random);
        photon.ray.origin = p + photon.normal * scene_.ray_caster().offset(p, photon.hit.distance);
        return true;
    }

    // Whether a photon straight from a luminaire with links leaves light where it hit. Its links
    // are taken from it unless it only passes.
    bool arrives(Photon& photon, std::size_t mesh) {
        const MeshLinks& links = *photon.links;
        const bool received = links.lit[mesh] != 0 && photon.vertex != kNoHit;
        Photon on = photon;
        on.ray.near = photon.hit.distance * (1.0F + kPassed);
        if (links.shadow[mesh] == 0 && !received) { // lit on the other side alone
            photon = on;
            return false;
        }
        photon.links = nullptr;
        photon.ray.meshes = nullptr;
        photon.ray.near = 0.0F;
        if (links.shadow[mesh] == 0) {
            on.random = PhotonRandom(photon.random.next(), 1);
            passing_.push_back(on);
            ++ends_.split;
        } else if (links.lit[mesh] == 0) {
            ++ends_.unlit;
            return false;
        }
        return true;
    }

    const MeshElement& element_of(const Hit& hit) const {
        return scene_.mesh().elements[static_cast<std::size_t>(hit.triangle)];
    }
    const Surface& surface_of(const MeshElement& element) const {
        return scene_.mesh().surfaces[static_cast<std::size_t>(element.surface)];
    }

    const Scene& scene_;
    PhotonBuckets& buckets_;
    PhotonBuckets::Ends& ends_;
    std::vector<Photon> passing_; // the light behind what a luminaire lights without a shadow
};

} // namespace

void trace_photons(const Scene& scene, std::uint64_t seed, PhotonRange range, int threads,
                   PhotonBuckets& buckets) {
    constexpr std::uint64_t kGrain = 1024;
    PhotonBuckets::Ends none;
    none.back_hits.resize(scene.mesh().meshes.size());
    tbb::enumerable_thread_specific<PhotonBuckets::Ends> ends(none);
    parallel_blocks(threads, range.first, range.first + range.count, kGrain,
                    [&](std::uint64_t begin, std::uint64_t end) {
                        PhotonWalk walk(scene, buckets, ends.local());
                        walk.trace(seed, begin, end);
                    });
    for (const auto& e : ends) {
        buckets.add_ends(e);
    }
}

} // namespace isolux
