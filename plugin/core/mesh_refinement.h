// The adaptive mesh: elements split where direct light bends more than the eye would miss
// [Volevich 2000, §3.1.1, §4].
//
// The oracle samples direct light along the edges of elements, carries it with the indirect light
// of the place to the brightness that a display would show, and splits edges next to what linear
// interpolation would not show. Where light is wanted it says; another component illuminates.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <unordered_map>
#include <vector>

#include "core/receiver.h"
#include "core/refined_mesh.h"
#include "core/scene.h"
#include "core/tone_mapping.h"

namespace isolux {

// One entry an illumination vertex of the scene.
struct VertexIllumination {
    std::span<const Vec3f> direct;         // lx by channel, as at the vertex
    std::span<const float> standard_error; // lx, photometric
    std::span<const Vec3f> indirect;       // lx by channel
    // Direct light of the region around the vertex, from photons (DDEPT), lx by channel, and its
    // relative deviation; or both empty.
    std::span<const Vec3f> regional;
    std::span<const float> regional_deviation;
};

// Direct light at a point of an edge. Kept from run to run.
struct LightSample {
    Vec3d position;    // m, on the edge
    Receiver receiver; // where it is sampled: a little off the element's edges
    Vec3f direct;      // lx by channel
    float standard_error = 0.0F;
    std::array<std::int32_t, 2> between{-1, -1}; // samples in whose middle it lies
    enum class State : std::uint8_t { unknown, wanted, known } state = State::unknown;
};

class MeshRefinement {
  public:
    // The scene must outlive it.
    explicit MeshRefinement(const Scene& scene);

    // Back to the scene's own elements. Samples are kept: a run with another threshold tests them
    // again, and wants new ones only where it has none.
    // adaptation_luminance : of the scene's observer, cd/m²
    // threshold : of displayed brightness, see ToneMapping; steps below it may be lost
    void begin(const VertexIllumination& light, double adaptation_luminance, double threshold);

    // An iteration: samples are wanted until none is left, then edges are split.
    // Numbers of the samples to be illuminated next; empty: ready to split.
    std::span<const std::int32_t> wanted_samples();
    // Direct light of the wanted samples, in their order: lx by channel; lx, photometric.
    void add_samples(std::span<const Vec3f> direct, std::span<const float> standard_error);
    // Returns whether any edge was split.
    bool split();

    const RefinedMesh& mesh() const { return mesh_; }
    const LightSample& sample(std::int32_t s) const { return samples_[s]; }
    // lx by channel, interpolated between the scene's vertices.
    const Vec3f& indirect(std::int32_t s) const { return local_[s].indirect; }
    // Light of a vertex of the refined mesh.
    const LightSample& vertex(std::int32_t v) const { return samples_[mesh_.sample_of(v)]; }
    // m², a third of the elements around each vertex.
    std::vector<double> vertex_areas() const;

  private:
    // What the run was given for the place of a sample, interpolated between vertices.
    struct Local {
        Vec3f indirect, regional;
        float regional_deviation = 0.0F;
    };
    // What two estimates of direct light at an edge's ends have to say about it.
    struct Expectation {
        double threshold;
        bool uniform; // nothing to be found between them
    };

    std::int32_t middle(std::int32_t a, std::int32_t b);
    void interpolate_local(std::int32_t sample);
    double brightness(const Vec3f& direct, std::int32_t sample, const Vec3f& reflectance) const;
    EdgeProfile profile(const RefinedEdge& edge) const;
    Expectation expectation(const RefinedEdge& edge) const;
    std::uint32_t wanted_gaps(const RefinedEdge& edge) const;
    void add_inner_samples(RefinedEdge& edge, std::uint32_t gaps);
    bool has_all_samples(std::int32_t edge);
    void queue_edges(std::int32_t first);

    RefinedMesh base_, mesh_;
    std::vector<LightSample> samples_;                        // the scene's vertices first
    std::unordered_map<std::uint64_t, std::int32_t> middles_; // by the pair of samples

    ToneMapping tone_mapping_{0.0};
    double threshold_ = 0.0;
    bool has_regional_ = false;
    std::vector<Local> local_;          // one a sample
    std::vector<std::int32_t> pending_; // edges that may want samples
    std::vector<std::int32_t> sampled_; // edges that have all that they want
    std::vector<std::int32_t> wanted_;  // samples
};

} // namespace isolux
