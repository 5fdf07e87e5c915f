// The elements of the adaptive mesh, their edges, and how they are split.
//
// An edge is one for all elements of a mesh that meet in two points at the same positions, however
// many creases and sides there are, and is split once for all of them: no T-junction arises.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "core/edge_oracle.h"
#include "core/illumination_mesh.h"
#include "core/refinement_template.h"

namespace isolux {

struct RefinedElement {
    std::array<std::int32_t, 3> vertices; // front, counter-clockwise
    std::array<std::int32_t, 3> edges;    // edge k from vertex k to the next
    std::int32_t parent;                  // the scene's element
    std::array<Vec3d, 3> barycentrics;    // place of each vertex in the parent
};

// A vertex that the scene doesn't have.
struct SplitVertex {
    std::array<std::int32_t, 2> parents; // vertices between which it lies
    double fraction;                     // 0 at the first parent, 1 at the second
    std::int32_t twin;                   // of a front, on a double-sided mesh's back; else -1
    std::int32_t point;                  // shared by all vertices of this split of the edge
    std::int32_t sample;                 // of light, at the same place
};

inline constexpr int kInnerSamples = kEdgeSamples - 2;

// One surface along an edge.
struct EdgeSide {
    std::array<std::int32_t, 2> ends;                // vertices
    std::array<std::int32_t, kInnerSamples> samples; // between them
    std::array<std::int32_t, kInnerSamples> splits; // vertices at samples that the edge is split at
    Vec3f reflectance;
    std::int32_t next = -1; // side of the edge
    std::int32_t back = -1; // of a front, the same on a double-sided mesh's back; else -1
    bool is_back = false;
};

struct RefinedEdge {
    std::int32_t first_side = -1;
    std::int32_t first_part = -1;                  // the edges that it became lie in a row
    std::array<double, kInnerSamples> fractions{}; // of its samples, from start to end
    int inner_count = 0;                           // of samples between the ends
    std::uint32_t splits = 0;                      // bit i: at sample i between the ends
    bool open = false;                             // long enough to be split, as elements beside it
};

class RefinedMesh {
  public:
    using NodeOf = std::function<TemplateNode(std::int32_t vertex, const Vec3f& reflectance)>;

    RefinedMesh() = default;
    // The scene's own elements.
    explicit RefinedMesh(const IlluminationMesh& mesh);

    // Of the scene.
    std::size_t vertex_count() const { return twins_.size(); }
    const std::vector<RefinedElement>& elements() const { return elements_; }
    const std::vector<SplitVertex>& split_vertices() const { return split_vertices_; }

    std::int32_t edge_count() const { return static_cast<std::int32_t>(edges_.size()); }
    RefinedEdge& edge(std::int32_t e) { return edges_[e]; }
    const RefinedEdge& edge(std::int32_t e) const { return edges_[e]; }
    EdgeSide& side(std::int32_t s) { return sides_[s]; }
    const EdgeSide& side(std::int32_t s) const { return sides_[s]; }

    // Of a vertex, the sample of its light: the scene's vertices are the first samples.
    std::int32_t sample_of(std::int32_t vertex) const;
    // Of a front vertex; -1 where there is no back.
    std::int32_t twin(std::int32_t vertex) const;
    // m; edges aren't split to shorter parts, nor for the sake of elements that are thinner
    double least_length() const { return least_length_; }

    // Splits edges where they ask for it, and the elements around them.
    // node_of : a front vertex as the template of an element of some reflectance sees it, without
    //     its edges
    // threshold : of the node's brightness
    void split(const NodeOf& node_of, double threshold);

  private:
    std::int32_t add_side(std::int32_t edge, std::int32_t a, std::int32_t b, Vec3f reflectance);
    std::int32_t find_side(std::int32_t edge, std::int32_t a, std::int32_t b) const;
    void divide(std::int32_t edge);
    bool is_needle(const Vec3d& a, const Vec3d& b, const Vec3d& c) const;

    struct Outline;
    void add_nodes(Outline& outline, const RefinedElement& element, int k, const NodeOf& node_of);
    void split_element(const RefinedElement& element, const NodeOf& node_of, double threshold,
                       std::int32_t first_new_edge, std::vector<RefinedElement>& out);

    double least_length_ = 0.0;
    std::vector<std::int32_t> twins_; // of the scene's vertices
    std::vector<Vec3f> reflectances_; // of the scene's elements
    std::vector<RefinedEdge> edges_;
    std::vector<EdgeSide> sides_;
    std::vector<RefinedElement> elements_;
    std::vector<SplitVertex> split_vertices_;
    std::int32_t point_count_ = 0;
};

} // namespace isolux
