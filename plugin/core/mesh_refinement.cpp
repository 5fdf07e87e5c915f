#include "core/mesh_refinement.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>

namespace isolux {
namespace {

using State = LightSample::State;

double gap_start(const RefinedEdge& edge, int i) { return i == 0 ? 0.0 : edge.fractions[i - 1]; }
double gap_end(const RefinedEdge& edge, int i) {
    return i == edge.inner_count ? 1.0 : edge.fractions[i];
}

} // namespace

MeshRefinement::MeshRefinement(const Scene& scene) : base_(scene.mesh()), mesh_(base_) {
    const std::vector<Receiver> receivers = scene.receivers();
    samples_.resize(receivers.size());
    for (std::size_t v = 0; v < receivers.size(); ++v) {
        samples_[v].position = scene.mesh().positions[v];
        samples_[v].receiver = receivers[v];
        samples_[v].state = State::known;
    }
}

void MeshRefinement::begin(const VertexIllumination& light, double adaptation_luminance,
                           double threshold) {
    tone_mapping_ = ToneMapping(adaptation_luminance);
    threshold_ = threshold;
    has_regional_ = !light.regional.empty();
    local_.assign(samples_.size(), {});
    for (std::size_t s = 0; s < samples_.size(); ++s) {
        if (s < base_.vertex_count()) {
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
    mesh_ = base_;
    wanted_.clear();
    sampled_.clear();
    pending_.clear();
    queue_edges(0);
}

void MeshRefinement::queue_edges(std::int32_t first) {
    for (std::int32_t e = first; e < mesh_.edge_count(); ++e) {
        if (mesh_.edge(e).open) {
            pending_.push_back(e);
        }
    }
}

// The sample in the middle between two: the same in every run.
std::int32_t MeshRefinement::middle(std::int32_t a, std::int32_t b) {
    const auto key = static_cast<std::uint64_t>(std::min(a, b)) << 32 |
                     static_cast<std::uint32_t>(std::max(a, b));
    const auto [entry, is_new] =
        middles_.try_emplace(key, static_cast<std::int32_t>(samples_.size()));
    const std::int32_t s = entry->second;
    if (is_new) {
        const Receiver &from = samples_[a].receiver, &to = samples_[b].receiver;
        LightSample sample;
        sample.position = (samples_[a].position + samples_[b].position) * 0.5;
        sample.receiver = {(from.position + to.position) * 0.5, normalize(from.normal + to.normal),
                           from.mesh};
        sample.between = {a, b};
        samples_.push_back(sample);
        local_.emplace_back();
        interpolate_local(s);
    }
    if (samples_[s].state == State::unknown) {
        samples_[s].state = State::wanted;
        wanted_.push_back(s);
    }
    return s;
}

void MeshRefinement::interpolate_local(std::int32_t sample) {
    const auto& [a, b] = samples_[sample].between;
    local_[sample] = {
        (local_[a].indirect + local_[b].indirect) * 0.5F,
        (local_[a].regional + local_[b].regional) * 0.5F,
        (local_[a].regional_deviation + local_[b].regional_deviation) * 0.5F,
    };
}

// Of a surface at a sample under a direct light and the indirect light of the place.
double MeshRefinement::brightness(const Vec3f& direct, std::int32_t sample,
                                  const Vec3f& reflectance) const {
    const Vec3f exitance = reflectance * (direct + indirect(sample));
    return tone_mapping_.displayed_brightness(luminance(exitance) / std::numbers::pi);
}

EdgeProfile MeshRefinement::profile(const RefinedEdge& edge) const {
    EdgeProfile out;
    out.count = edge.inner_count + 2;
    std::copy_n(edge.fractions.begin(), edge.inner_count, out.fractions.begin() + 1);
    out.fractions[out.count - 1] = 1.0;
    for (std::int32_t s = edge.first_side; s >= 0; s = mesh_.side(s).next) {
        const EdgeSide& side = mesh_.side(s);
        const auto at = [&](std::int32_t sample) {
            return brightness(samples_[sample].direct, sample, side.reflectance);
        };
        auto& row = out.brightness.emplace_back();
        row[0] = at(mesh_.sample_of(side.ends[0]));
        std::transform(side.samples.begin(), side.samples.begin() + edge.inner_count,
                       row.begin() + 1, at);
        row[out.count - 1] = at(mesh_.sample_of(side.ends[1]));
    }
    return out;
}

// Direct light at the ends against that of the region around them [§4]: where photons contradict
// it, a pattern of high contrast lies near, and the threshold is halved.
// Departure: where photons agree with it, the paper takes fewer samples; here none, but asks for
// twice the agreement, and of both ends. In the spot room that saves 33 % of all samples for the
// same picture; with the midpoint kept it saves nothing (tools/mesh_elements.py).
MeshRefinement::Expectation MeshRefinement::expectation(const RefinedEdge& edge) const {
    constexpr float kDeviations = 2.0F; // of the photons' noise: one in twenty by chance
    bool contradicted = false, uniform = has_regional_;
    for (std::int32_t s = edge.first_side; has_regional_ && s >= 0; s = mesh_.side(s).next) {
        const EdgeSide& side = mesh_.side(s);
        double least = std::numeric_limits<double>::infinity(), most = 0.0;
        for (const std::int32_t vertex : side.ends) {
            const std::int32_t sample = mesh_.sample_of(vertex);
            const Local& local = local_[sample];
            const float spread = kDeviations * local.regional_deviation;
            const auto regional = [&](float factor) {
                return brightness(local.regional * factor, sample, side.reflectance);
            };
            const double here = brightness(samples_[sample].direct, sample, side.reflectance);
            const double low = regional(std::max(0.0F, 1.0F - spread));
            const double high = regional(1.0F + spread);
            contradicted |= here < low - threshold_ || here > high + threshold_;
            least = std::min({least, here, low});
            most = std::max({most, here, high});
        }
        uniform &= most - least < 0.5 * threshold_;
    }
    return {contradicted ? 0.5 * threshold_ : threshold_, uniform};
}

// Bit i: the gap after sample i wants a sample in its middle.
std::uint32_t MeshRefinement::wanted_gaps(const RefinedEdge& edge) const {
    const auto [threshold, uniform] = expectation(edge);
    if (uniform) {
        return 0;
    }
    std::uint32_t gaps = edge.inner_count == 0 ? 1 : gaps_to_sample(profile(edge), threshold);
    const auto& [a, b] = mesh_.side(edge.first_side).ends;
    const double whole = length(vertex(b).position - vertex(a).position);
    for (int i = 0; i <= edge.inner_count; ++i) {
        if ((gap_end(edge, i) - gap_start(edge, i)) * whole < 2.0 * mesh_.least_length()) {
            gaps &= ~(1U << i);
        }
    }
    return gaps;
}

void MeshRefinement::add_inner_samples(RefinedEdge& edge, std::uint32_t gaps) {
    RefinedEdge finer = edge;
    finer.inner_count = 0;
    for (int i = 0; i <= edge.inner_count; ++i) {
        if ((gaps >> i & 1U) != 0) {
            finer.fractions[finer.inner_count++] = 0.5 * (gap_start(edge, i) + gap_end(edge, i));
        }
        if (i < edge.inner_count) {
            finer.fractions[finer.inner_count++] = edge.fractions[i];
        }
    }
    for (std::int32_t s = edge.first_side; s >= 0; s = mesh_.side(s).next) {
        EdgeSide& side = mesh_.side(s);
        const auto samples = side.samples;
        int count = 0;
        std::int32_t before = mesh_.sample_of(side.ends[0]);
        for (int i = 0; i <= edge.inner_count; ++i) {
            const bool last = i == edge.inner_count;
            const std::int32_t after = last ? mesh_.sample_of(side.ends[1]) : samples[i];
            if ((gaps >> i & 1U) != 0) {
                side.samples[count++] = middle(before, after);
            }
            if (!last) {
                side.samples[count++] = before = after;
            }
        }
    }
    edge = finer;
}

// False where the edge waits for samples, true where it wants no more.
bool MeshRefinement::has_all_samples(std::int32_t e) {
    RefinedEdge& edge = mesh_.edge(e);
    for (;;) {
        for (std::int32_t s = edge.first_side; s >= 0; s = mesh_.side(s).next) {
            for (int i = 0; i < edge.inner_count; ++i) {
                if (samples_[mesh_.side(s).samples[i]].state != State::known) {
                    return false;
                }
            }
        }
        const std::uint32_t gaps = wanted_gaps(edge);
        if (gaps == 0) {
            return true;
        }
        add_inner_samples(edge, gaps);
    }
}

std::span<const std::int32_t> MeshRefinement::wanted_samples() {
    if (wanted_.empty()) {
        std::erase_if(pending_, [&](std::int32_t e) {
            const bool done = has_all_samples(e);
            if (done) {
                sampled_.push_back(e);
            }
            return done;
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
        LightSample& sample = samples_[wanted_[i]];
        sample.direct = direct[i];
        sample.standard_error = standard_error[i];
        sample.state = State::known;
    }
    wanted_.clear();
}

bool MeshRefinement::split() {
    if (!pending_.empty() || !wanted_.empty()) {
        throw std::logic_error("samples are still wanted");
    }
    bool any = false;
    for (const std::int32_t e : sampled_) {
        RefinedEdge& edge = mesh_.edge(e);
        edge.splits = samples_to_split_at(profile(edge), expectation(edge).threshold) >> 1;
        any |= edge.splits != 0;
    }
    sampled_.clear();
    const std::int32_t first_new = mesh_.edge_count();
    mesh_.split(
        [&](std::int32_t v, const Vec3f& reflectance) {
            const std::int32_t s = mesh_.sample_of(v), twin = mesh_.twin(v);
            const double front = brightness(sample(s).direct, s, reflectance);
            const std::int32_t back = twin >= 0 ? mesh_.sample_of(twin) : s;
            return TemplateNode{
                sample(s).position, {front, brightness(sample(back).direct, back, reflectance)}, 0};
        },
        threshold_);
    queue_edges(first_new);
    return any;
}

std::vector<double> MeshRefinement::vertex_areas() const {
    std::vector<double> areas(mesh_.vertex_count() + mesh_.split_vertices().size(), 0.0);
    for (const RefinedElement& element : mesh_.elements()) {
        const auto& [a, b, c] = element.vertices;
        const Vec3d& p = vertex(a).position;
        const double third = length(cross(vertex(b).position - p, vertex(c).position - p)) / 6.0;
        for (const std::int32_t v : element.vertices) {
            areas[v] += third;
            if (mesh_.twin(v) >= 0) {
                areas[mesh_.twin(v)] += third;
            }
        }
    }
    return areas;
}

} // namespace isolux
