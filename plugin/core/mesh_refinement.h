// The adaptive mesh: elements split where direct light bends more than the eye would miss
// [Volevich 2000, §3.1.1, §4].
//
// The oracle samples direct light along the edges of elements, carries it with the indirect light
// of the place to the brightness that a display would show, and splits edges next to what linear
// interpolation would not show. Where light is sampled it says, and another component illuminates.
//
// An edge is one for all elements of a mesh that meet in two points at the same positions, however
// many creases and sides there are, and is split once for all of them: no T-junction arises.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <unordered_map>
#include <vector>

#include "core/edge_oracle.h"
#include "core/receiver.h"
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

struct RefinedElement {
    std::array<std::int32_t, 3> vertices; // front, counter-clockwise
    std::array<std::int32_t, 3> edges;    // edge k from vertex k to the next
    std::int32_t parent;                  // the scene's element
    std::array<Vec3d, 3> barycentrics;    // place of each vertex in the parent
};

// A vertex that the scene doesn't have. Its light is that of a sample.
struct SplitVertex {
    std::array<std::int32_t, 2> parents; // vertices between which it lies
    double fraction;                     // 0 at the first parent, 1 at the second
    std::int32_t twin;  // on the back of a double-sided mesh; -1: itself a back, or none
    std::int32_t point; // shared by all vertices of this split of the edge
    std::int32_t sample;
};

class MeshRefinement {
  public:
    // The scene must outlive it.
    explicit MeshRefinement(const Scene& scene);

    // Back to the scene's own elements. Samples are kept, so that a run with another threshold
    // tests them again and asks for new ones only.
    // adaptation_luminance : of the scene's observer, cd/m²
    // threshold : of displayed brightness, ToneMapping::displayed_brightness
    void begin(const VertexIllumination& light, double adaptation_luminance, double threshold);

    // One iteration: samples are wanted until none is left, then edges are split.
    // The receivers to be illuminated next; empty: ready to split.
    std::span<const std::int32_t> wanted_samples();
    // Direct light of the wanted samples, in their order: lx by channel, and photometric.
    void add_samples(std::span<const Vec3f> direct, std::span<const float> standard_error);
    // Splits elements; false where no element wanted it.
    bool split();

    // Of the scene.
    std::size_t vertex_count() const { return twins_.size(); }
    const std::vector<RefinedElement>& elements() const { return elements_; }
    const std::vector<SplitVertex>& split_vertices() const { return split_vertices_; }
    // Of a vertex of the refined mesh; the scene's vertices come first.
    std::int32_t sample_of(std::int32_t vertex) const;

    // Where light was or will be sampled: a little off the element's edges.
    const Receiver& receiver(std::int32_t sample) const { return samples_[sample].receiver; }
    const Vec3d& position(std::int32_t sample) const { return samples_[sample].position; }
    const Vec3f& direct(std::int32_t sample) const { return samples_[sample].direct; }
    float standard_error(std::int32_t sample) const { return samples_[sample].standard_error; }
    const Vec3f& indirect(std::int32_t sample) const { return local_[sample].indirect; }
    // m², a third of the elements around each vertex.
    std::vector<double> vertex_areas() const;

  private:
    static constexpr int kInner = kEdgeSamples - 2;

    enum class State : std::uint8_t { unknown, wanted, known };

    // Kept from run to run. The scene's vertices come first, then samples in the middle between
    // two.
    struct Sample {
        Vec3d position; // m, on the edge
        Receiver receiver;
        Vec3f direct;
        float standard_error = 0.0F;
        std::array<std::int32_t, 2> between{-1, -1};
        State state = State::unknown;
    };
    // What the run was given at each sample, interpolated between vertices.
    struct Local {
        Vec3f indirect, regional;
        float regional_deviation = 0.0F;
    };
    // One surface along an edge.
    struct Side {
        std::array<std::int32_t, 2> ends;         // vertices
        std::array<std::int32_t, kInner> samples; // between them
        std::array<std::int32_t, kInner> splits;  // vertices at those samples
        Vec3f reflectance;
        std::int32_t next = -1; // of the edge
        std::int32_t back = -1; // the same on the back of a double-sided mesh
        bool is_back = false;
    };
    struct Edge {
        std::int32_t first_side = -1;
        std::int32_t first_part = -1; // the edges that it was split into lie in a row
        std::array<double, kInner> fractions{};
        int inner_count = 0;
        std::uint32_t splits = 0; // bit i: at inner sample i
        bool open = false;        // may still be split
    };

    Vec3f albedo(std::int32_t element) const;
    bool is_needle(const std::array<std::int32_t, 3>& vertices) const;
    double edge_length(const Edge& edge) const;
    std::int32_t middle(std::int32_t a, std::int32_t b);
    void interpolate_local(std::int32_t sample);
    double brightness(std::int32_t sample, const Vec3f& reflectance) const;
    EdgeProfile profile(const Edge& edge) const;
    double threshold_of(const Edge& edge, bool& uniform) const;
    bool advance(std::int32_t edge);
    void add_inner_samples(Edge& edge, std::uint32_t gaps);
    std::int32_t add_side(std::int32_t edge, std::int32_t a, std::int32_t b, Vec3f rho);
    std::int32_t find_side(std::int32_t edge, std::int32_t a, std::int32_t b) const;
    std::int32_t twin(std::int32_t vertex) const;
    void divide(std::int32_t edge);
    void split_element(const RefinedElement& element, std::vector<RefinedElement>& out);

    const Scene& scene_;
    double least_length_;             // m
    std::vector<std::int32_t> twins_; // of the scene's vertices
    std::vector<Edge> base_edges_;
    std::vector<Side> base_sides_;
    std::vector<RefinedElement> base_elements_;

    std::vector<Sample> samples_;
    std::unordered_map<std::uint64_t, std::int32_t> middles_; // by the pair of samples

    ToneMapping tone_mapping_{0.0};
    double threshold_ = 0.0;
    std::vector<Local> local_; // one a sample
    bool has_regional_ = false;
    std::vector<Edge> edges_;
    std::vector<Side> sides_;
    std::vector<RefinedElement> elements_;
    std::vector<SplitVertex> split_vertices_;
    std::int32_t point_count_ = 0;
    std::int32_t first_edge_of_iteration_ = 0;
    std::vector<std::int32_t> pending_; // edges that may want samples
    std::vector<std::int32_t> decided_; // edges that have all they want
    std::vector<std::int32_t> wanted_;  // samples
};

} // namespace isolux
