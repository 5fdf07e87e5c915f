// Direct light at a receiver by shadow rays, as many as its accuracy asks for [Ward 1991]: to each
// luminaire, or to one for all of a cluster, which is split in halves, or the luminaire looked at
// by more rays, where most of the variance is [Walter et al. 2005].
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "core/light_tree.h"
#include "core/luminaire_illuminance.h"
#include "core/scene.h"
#include "core/sky_lighting.h"

namespace isolux {

// What lights a scene directly, and how exactly that is asked for.
struct DirectSources {
    const Scene& scene;
    std::uint64_t seed;
    double accuracy;                                   // as in DirectLightingSettings
    double mean_illuminance;                           // lx, if all light arrived
    std::vector<LuminaireIlluminance> luminaires = {}; // with links or infinitely far: last
    std::vector<const Luminaire*> skies = {};          // beside them, that SkyLighting takes
    std::optional<LightTree> tree = {}; // of many luminaires, finite and without links
    std::size_t in_tree = 0;            // the first of the luminaires

    // Standard error, lx, at which shadow rays stop where the total illuminance is so much.
    double allowed(double total) const;
};

// How often shadows have edges, from as many that were met in all the angle, rad, that was tried.
double edges_per_radian(double met, double angle_tried);

// Luminaires of some receivers at which all shadow rays agreed, and what as many again say of them.
struct Verified {
    double missed = 0.0;      // lx², squared light that was missed
    double edges = 0.0;       // lx², its variance as thought, for each edge a radian
    std::uint64_t shares = 0; // luminaires looked at
};

// At one receiver after another; keeps its memory.
class ShadowTesting {
  public:
    explicit ShadowTesting(const DirectSources& sources);

    struct Found {
        Vec3f illuminance;
        double known, edges;     // lx², variance; the second for each edge a radian
        double met, angle_tried; // edges; 1, rad
        Verified verified;
        std::uint64_t shadow_rays;
    };
    // indirect : lx, photometric: light beside which small errors of direct light don't show
    Found illuminate(const Receiver& receiver, float indirect);

  private:
    struct Probe {
        std::int32_t share;
        double weight;
    };
    // One luminaire's light, or that of a cluster by one of its luminaires.
    struct Share {
        std::int32_t luminaire;
        int bin;                     // of directions, that it was chosen for
        const LightCluster* cluster; // null: the luminaire alone
        double unoccluded;           // lx
        double expected;       // lx, the same whichever of a cluster's luminaires is looked at
        double geometry = 0.0; // lx², variance of unoccluded light in a cluster
        double angle = 0.0;    // rad, radius as seen from the receiver
        std::uint32_t samples = 0, wanted = 1; // points of the luminaire tried, to be tried
        double seen = 0.0, all = 0.0;          // sums of their weights
        float least = 1.0F, most = 0.0F;       // of what reaches the receiver from one of them
        std::int32_t sibling = -1;             // the other half of a cluster just split
        std::uint32_t agreed = 0;              // samples that did, before more were tried
        double agreed_on = 0.0;                // visible share by these
        double direct = 0.0;                   // lx
        double known = 0.0, edges = 0.0;       // lx², variance; the second for each edge a radian
        bool mixed = false;                    // its sibling's shadow rays met something else

        // Not as an aggregate, which would be cleared and copied.
        Share(std::int32_t index, double light, const LightCluster* of, int towards)
            : luminaire(index), bin(towards), cluster(of), unoccluded(light), expected(light) {}
        double visible() const { return all > 0.0 ? seen / all : 0.0; }
        bool decided() const { return all > 0.0 && least >= most; }
        // Of a further shadow ray, lx².
        double gain(double edges_per_radian) const;
    };
    struct Candidate {
        double gain;
        std::int32_t share;
    };

    void add_clusters();
    bool add(std::int32_t luminaire, double unoccluded, const LightCluster* cluster,
             const ClusterIlluminance& bound, int bin = 0);
    bool add_sampled(const LightCluster& cluster, const ClusterIlluminance& bound);
    void split(std::int32_t share);
    void refine();
    void double_samples(std::int32_t share);
    void cast();
    void settle();
    Verified verify();
    double edges_per_radian() const { return isolux::edges_per_radian(edges_met_, angle_tried_); }
    double variance() const { return known_ + edges_per_radian() * edges_; }
    double allowed() const;

    const DirectSources& sources_;
    std::vector<SkyLighting> skies_;
    Receiver receiver_;
    std::uint64_t key_ = 0;
    double indirect_ = 0.0;                           // lx
    double direct_ = 0.0, known_ = 0.0, edges_ = 0.0; // sums over the shares
    double edges_met_ = 0.0, angle_tried_ = 0.0;      // 1, rad
    double found_ = 0.0, sought_ = 0.0; // the same, by more shadow rays to one luminaire
    std::uint64_t shadow_rays_ = 0;
    std::vector<Share> shares_;
    std::vector<std::int32_t> pending_; // shares that want shadow rays
    ClusterChoice clusters_;
    std::vector<Candidate> candidates_; // a heap
    std::vector<Ray> rays_;
    std::vector<Probe> probes_; // one a ray
    std::vector<float> transmitted_;
};

} // namespace isolux
