#include "core/mesh_refinement.h"

#include <algorithm>
#include <bit>
#include <cassert>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "core/refinement_template.h"

namespace isolux {
namespace {

// Edges aren't split below this share of the scene's diagonal, 1.2 mm in a room of 10 m, nor for
// the sake of elements that are thinner.
constexpr double kLeastLength = 0x1p-13;

struct PositionHash {
    std::size_t operator()(const Vec3d& p) const {
        std::size_t hash = 0;
        for (const double x : {p.x, p.y, p.z}) {
            // + 0.0: both zeros are one
            hash = (hash ^ std::bit_cast<std::uint64_t>(x + 0.0)) * 0x9e3779b97f4a7c15ULL;
            hash ^= hash >> 32;
        }
        return hash;
    }
};

std::uint64_t pair_key(std::int32_t a, std::int32_t b) {
    return static_cast<std::uint64_t>(std::min(a, b)) << 32 |
           static_cast<std::uint32_t>(std::max(a, b));
}

double diagonal(const std::vector<Vec3d>& positions) {
    Vec3d low = positions.front(), high = low;
    for (const Vec3d& p : positions) {
        low = {std::min(low.x, p.x), std::min(low.y, p.y), std::min(low.z, p.z)};
        high = {std::max(high.x, p.x), std::max(high.y, p.y), std::max(high.z, p.z)};
    }
    return length(high - low);
}

// Points at the same position of one mesh share a number; one entry a vertex.
std::vector<std::int32_t> number_points(const IlluminationMesh& mesh) {
    std::vector<std::int32_t> out(mesh.positions.size());
    std::int32_t count = 0;
    for (const MeshRange& range : mesh.meshes) {
        std::unordered_map<Vec3d, std::int32_t, PositionHash> points;
        for (std::int32_t v = range.front_begin; v < range.back_end; ++v) {
            const auto [entry, is_new] = points.try_emplace(mesh.positions[v], count);
            count += is_new;
            out[v] = entry->second;
        }
    }
    return out;
}

} // namespace

MeshRefinement::MeshRefinement(const Scene& scene)
    : scene_(scene), least_length_(kLeastLength * diagonal(scene.mesh().positions)),
      twins_(scene.mesh().positions.size(), -1) {
    const IlluminationMesh& mesh = scene.mesh();
    const std::vector<Receiver> receivers = vertex_receivers(mesh);
    samples_.resize(receivers.size());
    for (std::size_t v = 0; v < receivers.size(); ++v) {
        samples_[v].position = mesh.positions[v];
        samples_[v].receiver = receivers[v];
        samples_[v].state = State::known;
    }
    for (const MeshElement& element : mesh.elements) {
        const std::int32_t back = mesh.surfaces[element.surface].back_offset;
        for (const std::int32_t v : element.vertices) {
            twins_[v] = back >= 0 ? v + back : -1;
        }
    }

    const std::vector<std::int32_t> points = number_points(mesh);
    std::unordered_map<std::uint64_t, std::int32_t> edge_of_points;
    base_elements_.reserve(mesh.elements.size());
    for (std::size_t e = 0; e < mesh.elements.size(); ++e) {
        const auto parent = static_cast<std::int32_t>(e);
        const auto& vertices = mesh.elements[e].vertices;
        RefinedElement element{vertices, {}, parent, {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}};
        const bool needle = is_needle(vertices);
        for (int k = 0; k < 3; ++k) {
            std::int32_t a = vertices[k], b = vertices[(k + 1) % 3];
            const auto [entry, is_new] = edge_of_points.try_emplace(
                pair_key(points[a], points[b]), static_cast<std::int32_t>(edges_.size()));
            if (is_new) {
                edges_.emplace_back();
            }
            element.edges[k] = entry->second;
            if (points[a] > points[b]) {
                std::swap(a, b); // all sides of an edge run the same way
            }
            const std::int32_t front = add_side(entry->second, a, b, albedo(parent));
            // Of two elements beside it, the brighter says what is seen.
            if (luminance(albedo(parent)) > luminance(sides_[front].reflectance)) {
                sides_[front].reflectance = albedo(parent);
                if (sides_[front].back >= 0) {
                    sides_[sides_[front].back].reflectance = albedo(parent);
                }
            }
            edges_[entry->second].open |= !needle;
        }
        base_elements_.push_back(element);
    }
    base_edges_ = std::move(edges_);
    base_sides_ = std::move(sides_);
}

void MeshRefinement::begin(const VertexIllumination& light, double adaptation_luminance,
                           double threshold) {
    const std::size_t vertex_count = twins_.size();
    tone_mapping_ = ToneMapping(adaptation_luminance);
    threshold_ = threshold;
    has_regional_ = !light.regional.empty();
    local_.assign(samples_.size(), {});
    for (std::size_t s = 0; s < samples_.size(); ++s) {
        if (s < vertex_count) {
            samples_[s].direct = light.direct[s];
            samples_[s].standard_error = light.standard_error[s];
            local_[s].indirect = light.indirect[s];
            if (has_regional_) {
                local_[s].regional = light.regional[s];
                local_[s].regional_deviation = light.regional_deviation[s];
            }
        } else {
            interpolate_local(static_cast<std::int32_t>(s));
            if (samples_[s].state == State::wanted) {
                samples_[s].state = State::unknown; // of a run that was given up
            }
        }
    }
    edges_ = base_edges_;
    sides_ = base_sides_;
    elements_ = base_elements_;
    split_vertices_.clear();
    point_count_ = 0;
    wanted_.clear();
    decided_.clear();
    pending_.clear();
    for (std::size_t e = 0; e < edges_.size(); ++e) {
        if (edges_[e].open) {
            pending_.push_back(static_cast<std::int32_t>(e));
        }
    }
}

std::int32_t MeshRefinement::sample_of(std::int32_t vertex) const {
    const auto first = static_cast<std::int32_t>(twins_.size());
    return vertex < first ? vertex : split_vertices_[vertex - first].sample;
}

std::int32_t MeshRefinement::twin(std::int32_t vertex) const {
    const auto first = static_cast<std::int32_t>(twins_.size());
    return vertex < first ? twins_[vertex] : split_vertices_[vertex - first].twin;
}

Vec3f MeshRefinement::albedo(std::int32_t element) const {
    const IlluminationMesh& mesh = scene_.mesh();
    return mesh.surfaces[mesh.elements[element].surface].reflectance;
}

bool MeshRefinement::is_needle(const std::array<std::int32_t, 3>& vertices) const {
    const Vec3d& a = position(sample_of(vertices[0]));
    const Vec3d& b = position(sample_of(vertices[1]));
    const Vec3d& c = position(sample_of(vertices[2]));
    const double longest = std::max({length(b - a), length(c - b), length(a - c)});
    return length(cross(b - a, c - a)) < least_length_ * longest;
}

double MeshRefinement::edge_length(const Edge& edge) const {
    const auto& [a, b] = sides_[edge.first_side].ends;
    return length(position(sample_of(b)) - position(sample_of(a)));
}

// The sample in the middle between two: the same in every run.
std::int32_t MeshRefinement::middle(std::int32_t a, std::int32_t b) {
    const auto [entry, is_new] =
        middles_.try_emplace(pair_key(a, b), static_cast<std::int32_t>(samples_.size()));
    if (is_new) {
        const Receiver &from = samples_[a].receiver, &to = samples_[b].receiver;
        Sample sample;
        sample.position = (samples_[a].position + samples_[b].position) * 0.5;
        sample.receiver = {(from.position + to.position) * 0.5, normalize(from.normal + to.normal)};
        sample.between = {a, b};
        samples_.push_back(sample);
        local_.emplace_back();
        interpolate_local(entry->second);
    }
    Sample& sample = samples_[entry->second];
    if (sample.state == State::unknown) {
        sample.state = State::wanted;
        wanted_.push_back(entry->second);
    }
    return entry->second;
}

void MeshRefinement::interpolate_local(std::int32_t sample) {
    const auto& [a, b] = samples_[sample].between;
    local_[sample] = {
        (local_[a].indirect + local_[b].indirect) * 0.5F,
        (local_[a].regional + local_[b].regional) * 0.5F,
        (local_[a].regional_deviation + local_[b].regional_deviation) * 0.5F,
    };
}

double MeshRefinement::brightness(std::int32_t sample, const Vec3f& reflectance) const {
    const Vec3f exitance = reflectance * (direct(sample) + indirect(sample));
    return tone_mapping_.displayed_brightness(luminance(exitance) / std::numbers::pi);
}

EdgeProfile MeshRefinement::profile(const Edge& edge) const {
    EdgeProfile out;
    out.count = edge.inner_count + 2;
    std::copy_n(edge.fractions.begin(), edge.inner_count, out.fractions.begin() + 1);
    out.fractions[out.count - 1] = 1.0;
    for (std::int32_t s = edge.first_side; s >= 0; s = sides_[s].next) {
        const Side& side = sides_[s];
        auto& row = out.brightness.emplace_back();
        row[0] = brightness(sample_of(side.ends[0]), side.reflectance);
        for (int i = 0; i < edge.inner_count; ++i) {
            row[i + 1] = brightness(side.samples[i], side.reflectance);
        }
        row[out.count - 1] = brightness(sample_of(side.ends[1]), side.reflectance);
    }
    return out;
}

// Direct light at the ends against that of the region around them [§4]: where photons contradict
// it, a pattern of high contrast lies between, and the threshold is halved; where they agree, the
// edge is uniform and wants no samples beyond its middle.
double MeshRefinement::threshold_of(const Edge& edge, bool& uniform) const {
    uniform = has_regional_;
    if (!has_regional_) {
        return threshold_;
    }
    constexpr float kDeviations = 2.0F; // a tenth of the disagreements by chance
    bool contradicted = false;
    for (std::int32_t s = edge.first_side; s >= 0; s = sides_[s].next) {
        for (const std::int32_t vertex : sides_[s].ends) {
            const std::int32_t sample = sample_of(vertex);
            const Local& local = local_[sample];
            const auto displayed = [&](const Vec3f& light) {
                return tone_mapping_.displayed_brightness(
                    luminance(sides_[s].reflectance * (light + local.indirect)) / std::numbers::pi);
            };
            const float spread = kDeviations * local.regional_deviation;
            const double here = displayed(direct(sample));
            const double low = displayed(local.regional * std::max(0.0F, 1.0F - spread));
            const double high = displayed(local.regional * (1.0F + spread));
            contradicted |= here < low - 0.5 * threshold_ || here > high + 0.5 * threshold_;
            uniform &= std::max(here, high) - std::min(here, low) < threshold_;
        }
    }
    return contradicted ? 0.5 * threshold_ : threshold_;
}

void MeshRefinement::add_inner_samples(Edge& edge, std::uint32_t gaps) {
    std::array<double, kInner> fractions{};
    int count = 0;
    for (int i = 0; i <= edge.inner_count; ++i) {
        const double from = i == 0 ? 0.0 : edge.fractions[i - 1];
        const double to = i == edge.inner_count ? 1.0 : edge.fractions[i];
        if ((gaps >> i & 1U) != 0) {
            fractions[count++] = 0.5 * (from + to);
        }
        if (i < edge.inner_count) {
            fractions[count++] = to;
        }
    }
    for (std::int32_t s = edge.first_side; s >= 0; s = sides_[s].next) {
        std::array<std::int32_t, kInner> samples{};
        int at = 0;
        for (int i = 0; i <= edge.inner_count; ++i) {
            const Side& side = sides_[s];
            const std::int32_t from = i == 0 ? sample_of(side.ends[0]) : side.samples[i - 1];
            const std::int32_t to =
                i == edge.inner_count ? sample_of(side.ends[1]) : side.samples[i];
            if ((gaps >> i & 1U) != 0) {
                samples[at++] = middle(from, to);
            }
            if (i < edge.inner_count) {
                samples[at++] = to;
            }
        }
        sides_[s].samples = samples;
    }
    edge.fractions = fractions;
    edge.inner_count = count;
}

// False where the edge waits for samples, true where it wants no more.
bool MeshRefinement::advance(std::int32_t e) {
    Edge& edge = edges_[e];
    for (;;) {
        for (std::int32_t s = edge.first_side; s >= 0; s = sides_[s].next) {
            for (int i = 0; i < edge.inner_count; ++i) {
                if (samples_[sides_[s].samples[i]].state != State::known) {
                    return false;
                }
            }
        }
        std::uint32_t gaps = 1;
        if (edge.inner_count > 0) {
            bool uniform = false;
            const double threshold = threshold_of(edge, uniform);
            gaps = uniform ? 0 : gaps_to_sample(profile(edge), threshold);
        }
        const double whole = edge_length(edge);
        for (int i = 0; i <= edge.inner_count; ++i) {
            const double from = i == 0 ? 0.0 : edge.fractions[i - 1];
            const double to = i == edge.inner_count ? 1.0 : edge.fractions[i];
            if ((to - from) * whole < 2.0 * least_length_) {
                gaps &= ~(1U << i);
            }
        }
        if (gaps == 0) {
            return true;
        }
        add_inner_samples(edge, gaps);
    }
}

std::span<const std::int32_t> MeshRefinement::wanted_samples() {
    if (wanted_.empty()) {
        std::erase_if(pending_, [&](std::int32_t e) {
            if (!advance(e)) {
                return false;
            }
            decided_.push_back(e);
            return true;
        });
    }
    return wanted_;
}

void MeshRefinement::add_samples(std::span<const Vec3f> direct,
                                 std::span<const float> standard_error) {
    if (direct.size() != wanted_.size() || standard_error.size() != wanted_.size()) {
        throw std::invalid_argument("as many illuminances as samples were wanted");
    }
    for (std::size_t i = 0; i < wanted_.size(); ++i) {
        Sample& sample = samples_[wanted_[i]];
        sample.direct = direct[i];
        sample.standard_error = standard_error[i];
        sample.state = State::known;
    }
    wanted_.clear();
}

std::int32_t MeshRefinement::find_side(std::int32_t edge, std::int32_t a, std::int32_t b) const {
    std::int32_t s = edges_[edge].first_side;
    while (s >= 0 && (sides_[s].is_back || sides_[s].ends != std::array{a, b})) {
        s = sides_[s].next;
    }
    return s;
}

// The front side from vertex a to b, and with it the back; that which is there, or a new one.
std::int32_t MeshRefinement::add_side(std::int32_t edge, std::int32_t a, std::int32_t b,
                                      Vec3f rho) {
    const std::int32_t known = find_side(edge, a, b);
    if (known >= 0) {
        return known;
    }
    const auto front = static_cast<std::int32_t>(sides_.size());
    Side side{{a, b}, {}, {}, rho, -1, -1, false};
    const std::int32_t back_a = twin(a), back_b = twin(b);
    if (back_a >= 0 && back_b >= 0) {
        side.back = side.next = front + 1;
    }
    sides_.push_back(side);
    if (side.back >= 0) {
        sides_.push_back({{back_a, back_b}, {}, {}, rho, -1, -1, true});
    }
    std::int32_t* link = &edges_[edge].first_side;
    while (*link >= 0) {
        link = &sides_[*link].next;
    }
    *link = front;
    return front;
}

// Makes the vertices of an edge's splits, and the edges between them.
void MeshRefinement::divide(std::int32_t e) {
    const Edge edge = edges_[e];
    if (edge.first_part >= 0) {
        return;
    }
    const auto vertex_begin = static_cast<std::int32_t>(twins_.size());
    std::vector<int> cuts; // inner samples, -1 and inner_count at the ends
    cuts.push_back(-1);
    for (int i = 0; i < edge.inner_count; ++i) {
        if ((edge.splits >> i & 1U) == 0) {
            continue;
        }
        cuts.push_back(i);
        for (std::int32_t s = edge.first_side; s >= 0; s = sides_[s].next) {
            Side& side = sides_[s];
            side.splits[i] = vertex_begin + static_cast<std::int32_t>(split_vertices_.size());
            // A front is followed by its back.
            split_vertices_.push_back({side.ends, edge.fractions[i],
                                       side.back >= 0 ? side.splits[i] + 1 : -1, point_count_,
                                       side.samples[i]});
        }
        ++point_count_;
    }
    cuts.push_back(edge.inner_count);

    edges_[e].first_part = static_cast<std::int32_t>(edges_.size());
    for (std::size_t part = 0; part + 1 < cuts.size(); ++part) {
        const int first = cuts[part], last = cuts[part + 1];
        const double from = first < 0 ? 0.0 : edge.fractions[first];
        const double to = last == edge.inner_count ? 1.0 : edge.fractions[last];
        Edge piece;
        for (int i = first + 1; i < last; ++i) {
            piece.fractions[piece.inner_count++] = (edge.fractions[i] - from) / (to - from);
        }
        const auto id = static_cast<std::int32_t>(edges_.size());
        edges_.push_back(piece);
        for (std::int32_t s = edge.first_side; s >= 0; s = sides_[s].next) {
            const Side& whole = sides_[s];
            if (whole.is_back) {
                continue; // comes with its front
            }
            const auto copy_samples = [&](std::int32_t source, std::int32_t target) {
                std::copy_n(sides_[source].samples.begin() + first + 1, piece.inner_count,
                            sides_[target].samples.begin());
            };
            const std::int32_t a = first < 0 ? whole.ends[0] : whole.splits[first];
            const std::int32_t b = last == edge.inner_count ? whole.ends[1] : whole.splits[last];
            const std::int32_t source_back = whole.back;
            const std::int32_t added = add_side(id, a, b, whole.reflectance);
            copy_samples(s, added);
            if (source_back >= 0) {
                copy_samples(source_back, sides_[added].back);
            }
        }
    }
}

void MeshRefinement::split_element(const RefinedElement& element,
                                   std::vector<RefinedElement>& out) {
    std::array<TemplateNode, kTemplateNodes> nodes;
    std::array<std::int32_t, kTemplateNodes> vertices{}, boundary{}; // edge from node i to the next
    std::array<Vec3d, kTemplateNodes> barycentrics;
    const Vec3f rho = albedo(element.parent);
    int n = 0;
    const auto add_node = [&](std::int32_t vertex, const Vec3d& barycentric, unsigned edges,
                              std::int32_t following) {
        const std::int32_t sample = sample_of(vertex), back = twin(vertex);
        const double front = brightness(sample, rho);
        nodes[n] = {
            position(sample), {front, back >= 0 ? brightness(sample_of(back), rho) : front}, edges};
        vertices[n] = vertex;
        barycentrics[n] = barycentric;
        boundary[n++] = following;
    };
    for (int k = 0; k < 3; ++k) {
        const std::int32_t a = element.vertices[k], b = element.vertices[(k + 1) % 3];
        const Vec3d &from = element.barycentrics[k], &to = element.barycentrics[(k + 1) % 3];
        const unsigned bit = 1U << k, bit_before = 1U << (k + 2) % 3;
        const std::int32_t e = element.edges[k];
        if (edges_[e].splits == 0) {
            add_node(a, from, bit | bit_before, e);
            continue;
        }
        divide(e);
        const Edge& edge = edges_[e];
        const int count = std::popcount(edge.splits);
        const bool forward = find_side(e, a, b) >= 0;
        const Side& side = sides_[forward ? find_side(e, a, b) : find_side(e, b, a)];
        add_node(a, from, bit | bit_before, edge.first_part + (forward ? 0 : count));
        for (int i = 0, done = 0; i < edge.inner_count; ++i) {
            const int at = forward ? i : edge.inner_count - 1 - i;
            if ((edge.splits >> at & 1U) == 0) {
                continue;
            }
            ++done;
            const double t = forward ? edge.fractions[at] : 1.0 - edge.fractions[at];
            add_node(side.splits[at], from * (1.0 - t) + to * t, bit,
                     edge.first_part + (forward ? done : count - done));
        }
    }

    std::array<std::array<std::int32_t, kTemplateNodes>, kTemplateNodes> inner; // edge ij, i < j
    for (auto& row : inner) {
        row.fill(-1);
    }
    const auto edge_between = [&](int i, int j) {
        if (j == i + 1 || (i == n - 1 && j == 0)) {
            return boundary[i];
        }
        std::int32_t& e = inner[std::min(i, j)][std::max(i, j)];
        if (e < 0) {
            e = static_cast<std::int32_t>(edges_.size());
            edges_.emplace_back();
            add_side(e, vertices[i], vertices[j], rho);
        }
        return e;
    };
    for (const auto& [i, j, k] : triangulate_template({nodes.data(), std::size_t(n)}, threshold_)) {
        const RefinedElement part{{vertices[i], vertices[j], vertices[k]},
                                  {edge_between(i, j), edge_between(j, k), edge_between(k, i)},
                                  element.parent,
                                  {barycentrics[i], barycentrics[j], barycentrics[k]}};
        if (!is_needle(part.vertices)) {
            for (const std::int32_t e : part.edges) {
                if (e >= first_edge_of_iteration_) {
                    edges_[e].open = true;
                }
            }
        }
        out.push_back(part);
    }
}

bool MeshRefinement::split() {
    if (!pending_.empty() || !wanted_.empty()) {
        throw std::logic_error("samples are still wanted");
    }
    bool any = false;
    for (const std::int32_t e : decided_) {
        Edge& edge = edges_[e];
        bool uniform = false;
        const double threshold = threshold_of(edge, uniform);
        edge.splits = samples_to_split_at(profile(edge), threshold) >> 1;
        any |= edge.splits != 0;
    }
    decided_.clear();
    first_edge_of_iteration_ = static_cast<std::int32_t>(edges_.size());
    std::vector<RefinedElement> finer;
    finer.reserve(elements_.size());
    for (const RefinedElement& element : elements_) {
        const bool whole = std::ranges::all_of(
            element.edges, [&](std::int32_t e) { return edges_[e].splits == 0; });
        if (whole) {
            finer.push_back(element);
        } else {
            split_element(element, finer);
        }
    }
    elements_ = std::move(finer);
    for (auto e = first_edge_of_iteration_; e < std::ssize(edges_); ++e) {
        if (edges_[e].open) {
            pending_.push_back(e);
        }
    }
    return any;
}

std::vector<double> MeshRefinement::vertex_areas() const {
    std::vector<double> areas(twins_.size() + split_vertices_.size(), 0.0);
    for (const RefinedElement& element : elements_) {
        const Vec3d& p = position(sample_of(element.vertices[0]));
        const Vec3d& q = position(sample_of(element.vertices[1]));
        const Vec3d& r = position(sample_of(element.vertices[2]));
        const double third = length(cross(q - p, r - p)) / 6.0;
        for (const std::int32_t v : element.vertices) {
            areas[v] += third;
            if (twin(v) >= 0) {
                areas[twin(v)] += third;
            }
        }
    }
    return areas;
}

} // namespace isolux
