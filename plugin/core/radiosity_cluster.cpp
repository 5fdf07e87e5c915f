#include "core/radiosity_cluster.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>

#include "core/coincident_surfaces.h"
#include "core/sampling.h"

namespace isolux {
namespace {

// Splits beyond the leaf area where a leaf is partly hidden: to a quarter of its edges.
constexpr int kExtraSplits = 2;
// How far from the middle to the corners a leaf is looked at.
constexpr double kNearCorner = 0.9;
// Of a leaf's radius: what faces it nearer than this shuts it off.
constexpr double kNarrowGap = 1.0 / 16.0;
// Where a point looks: tangential parts of unit vectors, all around and to the zenith.
constexpr std::array<std::array<float, 2>, 7> kAround{{{0.0F, 0.0F},
                                                       {0.8F, 0.0F},
                                                       {-0.4F, 0.693F},
                                                       {-0.4F, -0.693F},
                                                       {-0.5F, 0.0F},
                                                       {0.25F, 0.433F},
                                                       {0.25F, -0.433F}}};

double triangle_area(const Triangle& t) { return 0.5 * length(cross(t[1] - t[0], t[2] - t[0])); }

RadiosityNode triangle_node(const Triangle& corners, std::int32_t surface, std::int32_t element) {
    RadiosityNode node;
    node.element = element;
    node.corners = corners;
    node.centre = (corners[0] + corners[1] + corners[2]) * (1.0 / 3.0);
    node.normal = normalize(cross(corners[1] - corners[0], corners[2] - corners[0]));
    node.area = triangle_area(corners);
    for (const Vec3d& p : corners) {
        node.radius = std::max(node.radius, length(p - node.centre));
    }
    node.surface = surface;
    return node;
}

// Where a side lies among the others, and which way it looks: near sides that look alike make good
// clusters, and those that look alike the better ones.
using Place = std::array<double, 6>;

class Builder {
  public:
    Builder(const Scene& scene, double leaves) : scene_(scene) {
        const IlluminationMesh& mesh = scene.mesh();
        double total = 0.0;
        for (std::size_t e = 0; e < mesh.elements.size(); ++e) {
            const MeshElement& element = mesh.elements[e];
            const auto number = static_cast<std::int32_t>(e);
            const auto [a, b, c] = element.vertices;
            const Triangle front{mesh.positions[a], mesh.positions[b], mesh.positions[c]};
            if (triangle_area(front) <= 0.0) {
                continue;
            }
            sides_.push_back(triangle_node(front, element.surface, number));
            if (mesh.surfaces[static_cast<std::size_t>(element.surface)].back_offset >= 0) {
                sides_.push_back(
                    triangle_node({front[0], front[2], front[1]}, element.surface, number));
            }
        }
        for (const RadiosityNode& side : sides_) {
            total += side.area;
        }
        leaf_area_ = total / leaves;
        order_.resize(sides_.size());
        for (std::size_t i = 0; i < order_.size(); ++i) {
            order_[i] = static_cast<std::int32_t>(i);
        }
        double size = 0.0;
        for (const RadiosityNode& side : sides_) {
            size = std::max(size, length(side.centre - sides_[0].centre));
        }
        for (const RadiosityNode& side : sides_) {
            const Vec3d at = side.centre * (size > 0.0 ? 1.0 / size : 0.0);
            places_.push_back({at.x, at.y, at.z, side.normal.x, side.normal.y, side.normal.z});
        }
    }

    RadiosityHierarchy build() {
        if (!sides_.empty()) {
            out_.nodes.emplace_back();
            place(0, order_);
        }
        return std::move(out_);
    }

  private:
    // Makes node `at` of some sides.
    void place(std::int32_t at, std::span<std::int32_t> sides) {
        if (sides.size() == 1) {
            out_.nodes[at] = sides_[sides[0]];
            out_.element_sides.push_back(at);
            subdivide(at);
            return;
        }
        const auto dimension = widest(sides);
        const auto middle = sides.begin() + static_cast<std::ptrdiff_t>(sides.size() / 2);
        std::nth_element(sides.begin(), middle, sides.end(), [&](std::int32_t a, std::int32_t b) {
            const double pa = places_[a][dimension], pb = places_[b][dimension];
            return pa != pb ? pa < pb : a < b;
        });
        const auto first = static_cast<std::int32_t>(out_.nodes.size());
        out_.nodes.resize(out_.nodes.size() + 2);
        out_.nodes[at] = cluster_node(sides);
        out_.nodes[at].first_child = first;
        place(first, {sides.begin(), middle});
        place(first + 1, {middle, sides.end()});
    }

    std::size_t widest(std::span<const std::int32_t> sides) const {
        Place low, high;
        low.fill(std::numeric_limits<double>::max());
        high.fill(std::numeric_limits<double>::lowest());
        for (const std::int32_t s : sides) {
            for (std::size_t k = 0; k < low.size(); ++k) {
                low[k] = std::min(low[k], places_[s][k]);
                high[k] = std::max(high[k], places_[s][k]);
            }
        }
        std::size_t out = 0;
        for (std::size_t k = 1; k < low.size(); ++k) {
            if (high[k] - low[k] > high[out] - low[out]) {
                out = k;
            }
        }
        return out;
    }

    RadiosityNode cluster_node(std::span<const std::int32_t> sides) const {
        RadiosityNode node;
        Vec3d normal;
        for (const std::int32_t s : sides) {
            node.area += sides_[s].area;
            node.centre += sides_[s].centre * sides_[s].area;
            normal += sides_[s].normal * sides_[s].area;
        }
        node.centre = node.centre * (1.0 / node.area);
        node.normal = normalize(normal);
        double cosine = 1.0;
        for (const std::int32_t s : sides) {
            cosine = std::min(cosine, dot(node.normal, sides_[s].normal));
            for (const Vec3d& p : sides_[s].corners) {
                node.radius = std::max(node.radius, length(p - node.centre));
            }
        }
        node.normal_sine = cosine > 0.0 ? std::sqrt(std::max(0.0, 1.0 - cosine * cosine)) : 1.0;
        return node;
    }

    // Splits triangle `at` 1 -> 4 until its parts are as near to the leaf area as can be.
    void subdivide(std::int32_t at, int extra = 0) {
        const RadiosityNode node = out_.nodes[at];
        const bool small = node.area <= 2.0 * leaf_area_;
        if (small) {
            const InView view = in_view(node);
            if (extra == kExtraSplits || view.count % 4 == 0) {
                out_.nodes[at].hidden = view.count == 0;
                out_.nodes[at].owned = owned(node);
                if (view.count > 0 && !view.middle) {
                    move_centre(out_.nodes[at], view.mean);
                }
                out_.leaves.push_back(at);
                return;
            }
        }
        const auto first = static_cast<std::int32_t>(out_.nodes.size());
        const auto& [a, b, c] = node.corners;
        const Vec3d ab = (a + b) * 0.5, bc = (b + c) * 0.5, ca = (c + a) * 0.5;
        for (const Triangle& part : {Triangle{a, ab, ca}, Triangle{ab, b, bc}, Triangle{ca, bc, c},
                                     Triangle{bc, ca, ab}}) {
            out_.nodes.push_back(triangle_node(part, node.surface, node.element));
            out_.nodes.back().parent = at;
        }
        out_.nodes[at].first_child = first;
        for (std::int32_t k = 0; k < 4; ++k) {
            subdivide(first + k, small ? extra + 1 : 0);
            out_.nodes[at].hidden |= out_.nodes[first + k].hidden;
        }
    }

    // The middle of a triangle and three points near its corners, as far as light reaches them.
    struct InView {
        int count = 0;
        bool middle = false;
        Vec3d mean;
    };
    InView in_view(const RadiosityNode& node) const {
        InView out;
        out.middle = !hidden(node, node.centre);
        if (out.middle) {
            out.count = 1;
            out.mean = node.centre;
        }
        for (const Vec3d& p : node.corners) {
            const Vec3d at = node.centre + (p - node.centre) * kNearCorner;
            if (!hidden(node, at)) {
                ++out.count;
                out.mean += at;
            }
        }
        out.mean = out.mean * (1.0 / std::max(1, out.count));
        return out;
    }

    // Of what several surfaces cover, the first reflects: all others would double its light.
    double owned(const RadiosityNode& node) const {
        const IlluminationMesh& mesh = scene_.mesh();
        int own = 0, all = 0;
        const auto look = [&](const Vec3d& p) {
            const std::int32_t first = first_element_at(mesh, scene_.ray_caster(), p, node.normal);
            own += first < 0 || first == node.element ? 1 : 0;
            ++all;
        };
        look(node.centre);
        for (const Vec3d& p : node.corners) {
            look(node.centre + (p - node.centre) * kNearCorner);
        }
        return static_cast<double>(own) / all;
    }

    // What is seen of a leaf is as bright as where it is seen, not as under what stands on it.
    static void move_centre(RadiosityNode& node, const Vec3d& to) {
        node.centre = to;
        node.radius = 0.0;
        for (const Vec3d& p : node.corners) {
            node.radius = std::max(node.radius, length(p - to));
        }
    }

    // All that a point of a triangle sees is near, or the black back of a mesh.
    bool hidden(const RadiosityNode& node, const Vec3d& at) const {
        const RayCaster& caster = scene_.ray_caster();
        const Vec3f normal = node.normal.as<float>();
        const Vec3f local = (at - caster.origin()).as<float>();
        const Vec3f from = local + normal * caster.offset(local, 0.0F);
        const auto [s, t] = tangents(normal);
        for (const auto& [a, b] : kAround) {
            const Vec3f direction = s * a + t * b + normal * std::sqrt(1.0F - a * a - b * b);
            const Hit hit = caster.closest_hit({from, direction});
            if (hit.triangle == kNoHit) {
                return false;
            }
            const MeshElement& element =
                scene_.mesh().elements[static_cast<std::size_t>(hit.triangle)];
            const Surface& surface =
                scene_.mesh().surfaces[static_cast<std::size_t>(element.surface)];
            const bool black = surface.back_offset < 0 && dot(hit.normal, direction) > 0.0F;
            if (!black && static_cast<double>(hit.distance) > kNarrowGap * node.radius) {
                return false;
            }
        }
        return true;
    }

    const Scene& scene_;
    double leaf_area_ = 0.0; // m²
    std::vector<RadiosityNode> sides_;
    std::vector<Place> places_;
    std::vector<std::int32_t> order_;
    RadiosityHierarchy out_;
};

} // namespace

RadiosityHierarchy radiosity_hierarchy(const Scene& scene, double leaves) {
    return Builder(scene, leaves).build();
}

} // namespace isolux
