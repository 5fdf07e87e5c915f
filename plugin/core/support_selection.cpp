#include "core/support_selection.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace isolux {
namespace {

// Normals of a support agree within 25°, so that a curved surface is not taken for flat.
const float kNormalCosine = std::cos(25.0F * std::numbers::pi_v<float> / 180.0F);
// A vertex of another surface is coplanar where it is seen within 5° of the tangent plane.
const float kPlaneSine = std::sin(5.0F * std::numbers::pi_v<float> / 180.0F);
// Supports are judged each time their area has grown by this factor: a radius step of 15 %.
constexpr double kAreaStep = 1.3;
constexpr std::size_t kFirstCandidates = 24;
// Each further shell doubles the area.
constexpr float kSquaredRadiusStep = 2.0F;
// Departure: the search for a support ends after this many vertices, where the paper sets no bound:
// it keeps the cost of a vertex bounded in dark and vast surroundings.
constexpr std::size_t kMaxConnected = 512, kMaxOthers = 128;
// A surface with fewer photons than these (a deviation above 25 %) may draw on other surfaces.
constexpr double kFewPhotons = 16.0;

} // namespace

bool SupportSelection::accepts(std::int32_t vertex, const Neighbour& candidate) const {
    const auto& mesh = filter_.mesh_;
    const std::int32_t other = candidate.vertex;
    const Vec3f& normal = mesh.normals[vertex];
    if (dot(normal, mesh.normals[other]) < kNormalCosine) {
        // Without a normal, where all faces around have no area, any light nearby will do.
        return other == vertex || dot(normal, normal) == 0.0F;
    }
    if (mesh.components[vertex] == mesh.components[other]) {
        return true;
    }
    const float height = dot(normal, filter_.positions_[other] - filter_.positions_[vertex]);
    return height * height <= kPlaneSine * kPlaneSine * candidate.squared_distance;
}

bool SupportSelection::next_shell(std::int32_t vertex, Reach reach, Shell& shell) {
    const bool connected = reach == Reach::connected;
    const VertexKdTree& tree = connected ? filter_.connected_tree_ : filter_.tree_;
    const std::size_t all = connected ? static_cast<std::size_t>(filter_.component_sizes_[vertex])
                                      : filter_.positions_.size();
    const std::size_t enough = std::min(all, connected ? kMaxConnected : kMaxOthers);
    if (shell.seen >= enough || !std::isfinite(shell.squared_outer)) {
        return false;
    }
    if (shell.squared_outer > 0.0F) {
        const float squared_inner = shell.squared_outer;
        shell.squared_outer *= kSquaredRadiusStep;
        tree.within(vertex, squared_inner, shell.squared_outer, candidates_);
    } else {
        tree.nearest(vertex, kFirstCandidates, candidates_);
        if (candidates_.size() < kFirstCandidates) {
            shell.squared_outer = std::numeric_limits<float>::infinity();
        } else if (candidates_.back().squared_distance < filter_.least_squared_radius_) {
            // More vertices in one place than were asked for.
            shell.squared_outer = filter_.least_squared_radius_;
            tree.within(vertex, 0.0F, shell.squared_outer, candidates_);
        } else {
            // The last one may tie with others that were not returned: it waits for the next shell.
            shell.squared_outer = candidates_.back().squared_distance;
            std::erase_if(candidates_, [&](const Neighbour& candidate) {
                return candidate.squared_distance >= shell.squared_outer;
            });
        }
    }
    shell.seen += candidates_.size();
    return true;
}

void SupportSelection::take(const Neighbour& candidate, const std::vector<double>& hit_counts,
                            Growth& growth) {
    growth.taken.hit_count += hit_counts[candidate.vertex];
    growth.taken.area += filter_.mesh_.areas[candidate.vertex];
    growth.taken.size = accepted_.size();
    growth.taken.radius = std::sqrt(candidate.squared_distance);
}

void SupportSelection::judge(double to_luminance, Growth& growth) const {
    const double hit_count = growth.taken.hit_count;
    const double to_illuminance = criteria_.photon_flux / growth.taken.area;
    const Interval counts = criteria_.intervals(static_cast<std::uint64_t>(hit_count));
    const Interval here{counts.low * to_illuminance, counts.high * to_illuminance};
    const bool first = growth.judged.size == 0;
    growth.plausible.low = first ? here.low : std::max(growth.plausible.low, here.low);
    growth.plausible.high = first ? here.high : std::min(growth.plausible.high, here.high);
    if (growth.plausible.low > growth.plausible.high) { // discretisation error
        growth.stopped = true;
        return;
    }
    growth.judged = growth.taken;
    growth.next_area = growth.taken.area * kAreaStep;
    const bool smooth = hit_count * criteria_.accuracy * criteria_.accuracy >= 1.0; // Eq. 5
    // A black surface looks dark in any light; its illuminance is wanted all the same.
    const bool dark = to_luminance > 0.0 && here.high * to_luminance < criteria_.dark_luminance;
    growth.stopped = smooth || dark;
}

SupportSelection::Each<SupportSelection::Growth>
SupportSelection::grow(std::int32_t vertex, std::array<bool, 2> wanted, Reach reach) {
    const double to_luminance = filter_.reflectance_[vertex] / std::numbers::pi;
    Each<Growth> growths;
    std::size_t growing = 0;
    for (const std::size_t path : {0U, 1U}) {
        for (Growth& growth : growths[path]) {
            growth.stopped = !wanted[path];
            growing += wanted[path];
        }
    }
    accepted_.clear();
    for (Shell shell; next_shell(vertex, reach, shell);) {
        const std::size_t accepted_before = accepted_.size();
        for (const Neighbour& candidate : candidates_) {
            if (!accepts(vertex, candidate)) {
                continue;
            }
            accepted_.push_back(candidate);
            for (const std::size_t path : {0U, 1U}) {
                for (const std::size_t half : {0U, 1U}) {
                    Growth& growth = growths[path][half];
                    if (growth.stopped) {
                        continue;
                    }
                    take(candidate, hit_counts_[path][half], growth);
                    if (growth.taken.area > 0.0 && growth.taken.area >= growth.next_area) {
                        judge(to_luminance, growth);
                        growing -= growth.stopped;
                    }
                }
            }
            if (growing == 0) {
                return growths;
            }
        }
        if (!candidates_.empty() && accepted_.size() == accepted_before) {
            break; // what lies further off faces another way
        }
    }
    return growths;
}

SupportSelection::Each<Support> SupportSelection::select(std::int32_t vertex,
                                                         std::array<bool, 2> wanted) {
    Each<Growth> growths = grow(vertex, wanted, Reach::connected);
    std::array<bool, 2> few{};
    for (const std::size_t path : {0U, 1U}) {
        few[path] = std::ranges::any_of(growths[path], [](const Growth& growth) {
            return !growth.stopped && growth.support().hit_count < 0.5 * kFewPhotons;
        });
    }
    if (few[0] || few[1]) {
        // Both light paths, so that the accepted vertices are those of all supports.
        growths = grow(vertex, wanted, Reach::all);
    }
    Each<Support> supports;
    std::size_t largest = 0;
    for (const std::size_t path : {0U, 1U}) {
        for (const std::size_t half : {0U, 1U}) {
            supports[path][half] = growths[path][half].support();
            largest = std::max(largest, supports[path][half].size);
        }
    }
    accepted_.resize(largest);
    return supports;
}

} // namespace isolux
