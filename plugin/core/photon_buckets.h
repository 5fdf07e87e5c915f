// Photon buckets: hit counts and coloured flux of each illumination vertex, direct and indirect
// light apart [Volevich 2000, §3.1.3].
//
// All photons carry the same luminous flux, so that counts are the photometric estimate; colour
// travels beside it. Sums are integers: any number of threads, in any order, or photon ranges
// traced apart and merged, give the same bits.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "core/vec3.h"

namespace isolux {

// Independent batches of photons, from which the error can be estimated without a model. Those of
// even and of odd number make two independent halves.
inline constexpr std::size_t kBatches = 16;

enum class LightPath : std::uint8_t { direct = 0, indirect = 1 };

class PhotonBuckets {
  public:
    PhotonBuckets(std::size_t vertex_count, std::size_t mesh_count, bool coloured);
    PhotonBuckets(const PhotonBuckets&) = delete;
    PhotonBuckets& operator=(const PhotonBuckets&) = delete;

    // Safe from several threads. colour: linear Rec. 709 of luminance 1.
    void deposit(std::int32_t vertex, LightPath path, std::size_t batch, const Vec3f& colour) {
        hit_counts_[index(vertex, path) * kBatches + batch].fetch_add(1, std::memory_order_relaxed);
        if (coloured_) {
            auto* sums = &colour_sums_[index(vertex, path) * 4];
            sums[0].fetch_add(fixed_point(colour.x), std::memory_order_relaxed);
            sums[1].fetch_add(fixed_point(colour.y), std::memory_order_relaxed);
            sums[2].fetch_add(fixed_point(colour.z), std::memory_order_relaxed);
        }
    }
    // Hints that a deposit follows soon.
    void prefetch(std::int32_t vertex, LightPath path, std::size_t batch) const {
        __builtin_prefetch(&hit_counts_[index(vertex, path) * kBatches + batch], 1);
        if (coloured_) {
            __builtin_prefetch(&colour_sums_[index(vertex, path) * 4], 1);
        }
    }

    // Photons that one range of histories ended with. Not safe from several threads.
    struct Ends {
        std::uint64_t emitted = 0, rays = 0, absorbed = 0, back_absorbed = 0, escaped = 0;
        // By links: at a mesh that its luminaire lights and whose shadow it doesn't cast, a photon
        // becomes two, one that was there and one that goes on; at one that stands in the light and
        // isn't lit it ends. emitted + split = absorbed + back_absorbed + escaped + unlit
        std::uint64_t split = 0, unlit = 0;
        std::vector<std::uint64_t> back_hits; // a mesh
        void add(const Ends& other);
    };
    void add_ends(const Ends& ends) { ends_.add(ends); }
    // Adds the buckets of another range of photons of the same scene.
    void merge(const PhotonBuckets& other);

    std::size_t vertex_count() const { return vertex_count_; }
    bool coloured() const { return coloured_; }
    const Ends& ends() const { return ends_; }
    std::uint64_t hit_count(std::int32_t vertex, LightPath path) const;
    std::array<std::uint32_t, kBatches> batch_hit_counts(std::int32_t vertex, LightPath path) const;
    std::array<std::uint64_t, 2> half_hit_counts(std::int32_t vertex, LightPath path) const;
    // Sum of the photons' colours, in photons; its luminance is the hit count.
    Vec3d colour_sum(std::int32_t vertex, LightPath path) const;

  private:
    // 2^-24 of a photon: a channel is at most 1/0.0722 = 14 photons, so 63 bits hold 4e10 hits.
    static constexpr double kQuantum = 0x1p-24;
    static std::int64_t fixed_point(float channel) {
        return static_cast<std::int64_t>(channel * static_cast<float>(1.0 / kQuantum) + 0.5F);
    }
    static std::size_t index(std::int32_t vertex, LightPath path) {
        return static_cast<std::size_t>(vertex) * 2 + static_cast<std::size_t>(path);
    }

    std::size_t vertex_count_;
    bool coloured_;
    std::vector<std::atomic<std::uint32_t>> hit_counts_; // [vertex][path][batch]
    std::vector<std::atomic<std::int64_t>> colour_sums_; // [vertex][path][channel], padded to 4
    Ends ends_;
};

} // namespace isolux
