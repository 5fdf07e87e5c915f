// A tree over many luminaires, so that distant ones are sampled together: clusters with bounds on
// where their light starts and goes [Conty Estevez & Kulla 2018].
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "core/cluster_intensity.h"
#include "core/luminaire_illuminance.h"

namespace isolux {

struct LightCluster {
    std::int32_t first = 0, last = 0;    // luminaires, in the tree's order
    std::int32_t children[2] = {-1, -1}; // none where first + 1 == last
    double luminous_flux = 0.0;          // lm
    double peak_intensity = 0.0;         // cd, at most, of the whole by one of its luminaires
    bool follows_cosine = true;          // of the angle to one nadir, all of them alike
    std::shared_ptr<ClusterIntensity> intensity; // none if it follows the cosine
    Vec3d centre{}, half{};  // m; the middle of the luminaires' box, half its edges
    double radius = 0.0;     // m, of the sphere that holds all luminaires
    double own_radius = 0.0; // m, of the largest luminaire
    Vec3d axis{};            // unit; mean of the luminaires' nadirs
    double spread = 0.0;     // rad, widest angle from the axis to a nadir
    double reach = 0.0;      // rad, widest angle from its nadir that a luminaire lights

    bool alone() const { return children[0] < 0; } // one luminaire
};

// Illuminance that a cluster may give a receiver if nothing is in the way: no more than `most`,
// zero where it can give none, and about `middle` if all its light came from its centre.
struct ClusterIlluminance {
    double most = 0.0, middle = 0.0; // lx
    double angle = 0.0;              // rad, the cluster's radius as seen from the receiver
    double spread = 0.0;             // relative variance by their places, to first order
    double between = 0.0;            // relative variance by what they shine towards the receiver

    // Of the whole by one of its luminaires, chosen by flux, lx².
    double variance() const;
};

class LightTree {
  public:
    explicit LightTree(std::span<const LuminaireIlluminance> luminaires);

    // The root first.
    std::span<const LightCluster> clusters() const { return clusters_; }
    // The only luminaire of a cluster.
    std::int32_t luminaire(const LightCluster& alone) const { return order_[alone.first]; }
    // A luminaire of the cluster and its probability, by luminous flux, or where they differ in it
    // by intensity in the direction of a bin; u uniform in [0, 1).
    struct Choice {
        std::int32_t luminaire;
        double probability;
    };
    Choice choose(const LightCluster& cluster, int bin, double u) const;
    // Probability that what is chosen of the cluster is in its first half.
    double first_half(const LightCluster& cluster, int bin) const;
    // Its place in the tree's order.
    std::int32_t place(std::int32_t luminaire) const { return places_[luminaire]; }

  private:
    std::int32_t add_cluster(std::span<const LuminaireIlluminance> luminaires, std::int32_t first,
                             std::int32_t last);

    bool follows_cosine_ = true; // the root
    std::vector<LightCluster> clusters_;
    std::vector<std::int32_t> order_, places_;
    std::vector<double> cumulative_flux_; // lm, in the tree's order, from 0
};

// Of a single luminaire without `spread`.
ClusterIlluminance cluster_illuminance(const LightCluster& cluster, const Receiver& receiver);

// Chooses clusters for one receiver after another; keeps its memory.
class ClusterChoice {
  public:
    struct Chosen {
        ClusterIlluminance bound;
        const LightCluster* cluster;
    };
    // All that may light the receiver, in the tree's order, in clusters whose luminaires differ so
    // little in what they may give that the square root of the sum of their variances is allowed,
    // lx, as a function of the illuminance expected of them all, lx. Until the next choice.
    std::span<const Chosen> choose(const LightTree& tree, const Receiver& receiver,
                                   const std::function<double(double)>& allowed);

  private:
    struct LookedAt {
        Chosen cluster;
        std::int32_t halves; // place of the first, the other follows; -1: not split
    };
    struct Candidate {
        double variance; // lx²
        std::int32_t place;
    };

    void look_at(const LightCluster& cluster);
    void weigh(std::int32_t place);
    void split(std::int32_t place);
    void take(std::int32_t place);

    std::span<const LightCluster> clusters_;
    Receiver receiver_;
    double least_ = 0.0;                     // lx, error allowed where it is dark
    double variance_ = 0.0, expected_ = 0.0; // lx², lx, of the candidates
    std::vector<LookedAt> looked_at_;        // the root first
    std::vector<Candidate> candidates_;      // a heap
    std::vector<Chosen> chosen_;
};

} // namespace isolux
