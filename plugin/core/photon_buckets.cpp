#include "core/photon_buckets.h"

#include <cassert>

namespace isolux {

PhotonBuckets::PhotonBuckets(std::size_t vertex_count, std::size_t mesh_count, bool coloured)
    : vertex_count_(vertex_count), coloured_(coloured), hit_counts_(vertex_count * 2 * kBatches),
      colour_sums_(coloured ? vertex_count * 2 * 4 : 0) {
    ends_.back_hits.resize(mesh_count);
}

void PhotonBuckets::Ends::add(const Ends& other) {
    emitted += other.emitted;
    rays += other.rays;
    absorbed += other.absorbed;
    back_absorbed += other.back_absorbed;
    escaped += other.escaped;
    split += other.split;
    unlit += other.unlit;
    assert(back_hits.size() == other.back_hits.size());
    for (std::size_t i = 0; i < back_hits.size(); ++i) {
        back_hits[i] += other.back_hits[i];
    }
}

void PhotonBuckets::merge(const PhotonBuckets& other) {
    assert(vertex_count_ == other.vertex_count_ && coloured_ == other.coloured_);
    for (std::size_t i = 0; i < hit_counts_.size(); ++i) {
        hit_counts_[i] += other.hit_counts_[i];
    }
    for (std::size_t i = 0; i < colour_sums_.size(); ++i) {
        colour_sums_[i] += other.colour_sums_[i];
    }
    ends_.add(other.ends_);
}

std::array<std::uint32_t, kBatches> PhotonBuckets::batch_hit_counts(std::int32_t vertex,
                                                                    LightPath path) const {
    std::array<std::uint32_t, kBatches> out{};
    for (std::size_t b = 0; b < kBatches; ++b) {
        out[b] = hit_counts_[index(vertex, path) * kBatches + b].load(std::memory_order_relaxed);
    }
    return out;
}

std::array<std::uint64_t, 2> PhotonBuckets::half_hit_counts(std::int32_t vertex,
                                                            LightPath path) const {
    const auto batches = batch_hit_counts(vertex, path);
    std::array<std::uint64_t, 2> out{};
    for (std::size_t b = 0; b < kBatches; ++b) {
        out[b % 2] += batches[b];
    }
    return out;
}

std::uint64_t PhotonBuckets::hit_count(std::int32_t vertex, LightPath path) const {
    const auto [even, odd] = half_hit_counts(vertex, path);
    return even + odd;
}

Vec3d PhotonBuckets::colour_sum(std::int32_t vertex, LightPath path) const {
    if (!coloured_) {
        const auto n = static_cast<double>(hit_count(vertex, path));
        return {n, n, n};
    }
    const auto channel = [&](std::size_t k) {
        return static_cast<double>(
                   colour_sums_[index(vertex, path) * 4 + k].load(std::memory_order_relaxed)) *
               kQuantum;
    };
    return {channel(0), channel(1), channel(2)};
}

} // namespace isolux
