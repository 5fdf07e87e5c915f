// Indirect illuminance at all vertices by final gather: rays over the hemisphere look up the
// exitance of what they hit [Ward, Rubinstein & Clear 1988; Jensen 1996]. The exitance is that of
// the direct light and of what was gathered before, so that with each look-up light is reflected
// once more (Jacobi iteration of the radiosity equation [Cohen & Wallace 1993, §5.3]); photons tell
// what the vertices of a coarse mesh don't.
//
// Departure: the paper lets indirect photons go on to the end (IDEPT) and filters them
// [Volevich 2000, §3.3]. tools/gather_study.py measures the gain.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/gather_records.h"
#include "core/joined_illuminance.h"
#include "core/photon_buckets.h"
#include "core/record_smoothing.h"
#include "core/visible_area.h"

namespace isolux {

struct GatheredIllumination {
    std::vector<Vec3f> indirect;       // lx by channel, one a vertex, at its receiver
    std::vector<float> standard_error; // lx, photometric
    double indirect_rms = 0.0;         // lx, error over all vertices by area
    std::uint64_t rays = 0;            // of this call
};

// What is known of the light before it is gathered; one a vertex, lx by channel.
struct KnownLight {
    std::span<const Vec3f> all;             // all light in the vertices' buckets, unfiltered
    std::span<const Vec3f> indirect;        // the indirect part of it; none: `all` is exact
    std::span<const Vec3f> direct;          // at the receivers, exact; none: not known
    double photon_flux = 0.0;               // lm a photon
    const PhotonBuckets* photons = nullptr; // that left it; null: their noise isn't told
};

class FinalGather {
  public:
    FinalGather(const Scene& scene, std::uint64_t seed);

    // Spends ray_budget more rays where they help most, and looks up the light anew in all.
    GatheredIllumination advance(const KnownLight& light, std::uint64_t ray_budget, int threads);

    std::size_t vertex_count() const { return receivers_.size(); }

  private:
    void look_up_all(const KnownLight& light, int threads);
    void take_from_beside(std::span<const std::uint8_t> chosen, std::span<Vec3f> illuminance) const;
    JoinedIlluminance joined(std::span<const Vec3f> counted, std::vector<Vec3f> known,
                             std::span<const double> variance, double photon_flux) const;
    void find_hidden(const KnownLight& light);
    void find_visible(const KnownLight& light, int threads);
    void find_direct(const KnownLight& light);
    void find_exitances(const KnownLight& light);
    float beyond_chance(const KnownLight& light, std::int32_t v) const;
    void find_change(const KnownLight& light);
    void find_tight();
    void trace(std::span<const std::int32_t> vertices, std::uint32_t rays, int threads);
    void smooth(int threads) { smoothing_.smooth(records_, lit_, smooth_, threads); }
    void spend(std::uint64_t end, int threads);
    void reflect(const KnownLight& light, int threads);

    const Scene& scene_;
    std::uint64_t seed_;
    RecordTracer tracer_;
    std::vector<Receiver> receivers_;
    RecordSmoothing smoothing_;
    std::vector<std::int32_t> lit_;   // vertices that have a normal and an area
    std::vector<Vec3f> reflectances_; // one a vertex, mean of the elements around it
    std::vector<GatherRecord> records_;
    JoinedIlluminance seen_direct_, seen_indirect_; // the parts of the next
    std::vector<Vec3f> illuminance_;                // lx by channel, of what reflects
    std::vector<SmoothIlluminance> smooth_;         // one a vertex, of the records
    Exitances exitances_;
    BrightPatches bright_;
    std::vector<std::uint8_t> hidden_; // vertices inside of others' bodies
    VisibleArea visible_;
    std::span<const Vec3f> direct_;   // of the light in hand
    std::vector<std::uint8_t> rough_; // one a vertex: direct light changes from it to the next
    std::vector<float> change_;       // lm/m², one a vertex, of direct light's exitance around it
    float unseen_ = 0.0F;             // lx, below which such a change doesn't show
    std::vector<std::uint8_t> tight_; // one a vertex: most of what it sees is nearer than the next
    std::uint64_t rays_ = 0;
};

} // namespace isolux
