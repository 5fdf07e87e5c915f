#include "core/bright_patches.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <queue>

namespace isolux {
namespace {

// Of the mean exitance. On the office 4 leaves a tenth of the variance of a ray.
constexpr float kCap = 4.0F;
// Each vertex weighs all of them.
constexpr std::size_t kMostGroups = 512;
// Of the cap, that a patch is thought to be above beyond what it is by light that is known for
// sure: one that is just above the cap gets indirect light too, and must not be drawn too seldom.
constexpr float kUnknown = 0.5F;
// Square distance, in areas of the patch, from which it counts as a point; and in square extents of
// a group, from which that stands for its patches.
constexpr float kFar = 16.0F, kFarGroup = 16.0F;
// m^4, lest a group at no distance divides by it.
constexpr float kTiny = 1e-30F;

} // namespace

bool BrightPatches::is_far(const Patch& patch, const Vec3f& position) {
    const Vec3f to = patch.position - position;
    return dot(to, to) > kFar * patch.area;
}

BrightPatches::BrightPatches(const Scene& scene, std::span<const Receiver> receivers,
                             std::span<const float> exitances)
    : caster_(&scene.ray_caster()), patch_of_(receivers.size(), -1) {
    const std::vector<double>& areas = scene.mesh().areas;
    double flux = 0.0, area = 0.0;
    for (std::size_t v = 0; v < receivers.size(); ++v) {
        flux += areas[v] * static_cast<double>(exitances[v]);
        area += areas[v];
    }
    cap_ = area > 0.0 ? kCap * static_cast<float>(flux / area) : 0.0F;
    for (std::size_t v = 0; v < receivers.size(); ++v) {
        const auto a = static_cast<float>(areas[v]);
        if (exitances[v] > cap_ && a > 0.0F && receivers[v].normal != Vec3f{}) {
            const Vec3f local = (receivers[v].position - caster_->origin()).as<float>();
            const Vec3f& n = receivers[v].normal;
            patches_.push_back({local + n * caster_->offset(local, 0.0F), n, a,
                                (exitances[v] - (1.0F - kUnknown) * cap_) * a,
                                static_cast<std::int32_t>(v)});
        }
    }
    make_groups();
    before_.resize(patches_.size());
    for (Group& group : groups_) {
        float sum = 0.0F;
        for (std::int32_t p = group.begin; p < group.end; ++p) {
            patch_of_[patches_[p].vertex] = p;
            before_[p] = sum;
            sum += patches_[p].flux;
        }
        group.flux = sum;
    }
    blocks_.resize((groups_.size() + Block::kSize - 1) / Block::kSize);
    for (std::size_t g = 0; g < groups_.size(); ++g) {
        const Group& group = groups_[g];
        Block& block = blocks_[g / Block::kSize];
        const std::size_t i = g % Block::kSize;
        block.x[i] = group.position.x;
        block.y[i] = group.position.y;
        block.z[i] = group.position.z;
        block.normal_x[i] = group.normal.x;
        block.normal_y[i] = group.normal.y;
        block.normal_z[i] = group.normal.z;
        block.extent[i] = group.extent;
        block.thickness[i] = group.thickness;
        block.spread[i] = group.spread;
        block.flux[i] = group.flux;
    }
}

BrightPatches::Group BrightPatches::group(std::size_t begin, std::size_t end) const {
    Group out{.begin = static_cast<std::int32_t>(begin), .end = static_cast<std::int32_t>(end)};
    Vec3d position, normal;
    double flux = 0.0;
    for (std::size_t p = begin; p < end; ++p) {
        const double of = static_cast<double>(patches_[p].flux);
        position += patches_[p].position.as<double>() * of;
        normal += patches_[p].normal.as<double>() * of;
        flux += of;
    }
    out.flux = static_cast<float>(flux);
    out.position = (position * (1.0 / flux)).as<float>();
    out.normal = normalize(normal).as<float>();
    for (std::size_t p = begin; p < end; ++p) {
        const Patch& patch = patches_[p];
        out.extent = std::max(out.extent, length(patch.position - out.position) +
                                              (end - begin > 1 ? std::sqrt(patch.area) : 0.0F));
        out.thickness =
            std::max(out.thickness, std::abs(dot(patch.position - out.position, out.normal)));
        out.spread = std::max(out.spread, length(patch.normal - out.normal));
    }
    return out;
}

// The group whose light differs most over its extent is halved, until there are enough.
void BrightPatches::make_groups() {
    const auto differs = [](const Group& g) { return g.flux * (g.extent + g.spread); };
    const auto less = [&](const Group& a, const Group& b) {
        return differs(a) < differs(b) || (differs(a) == differs(b) && a.begin > b.begin);
    };
    std::priority_queue<Group, std::vector<Group>, decltype(less)> open(less);
    if (!patches_.empty()) {
        open.push(group(0, patches_.size()));
    }
    while (!open.empty()) {
        const Group widest = open.top();
        open.pop();
        const auto count = static_cast<std::size_t>(widest.end - widest.begin);
        if (count == 1 || open.size() + groups_.size() + 1 >= kMostGroups) {
            groups_.push_back(widest);
            continue;
        }
        // Across where it is widest, of its positions or its normals.
        const auto begin = patches_.begin() + widest.begin, end = patches_.begin() + widest.end;
        const auto coordinate = [&](const Patch& p, int axis) {
            const Vec3f& of = axis < 3 ? p.position : p.normal;
            const std::array<float, 3> all{of.x, of.y, of.z};
            return all[static_cast<std::size_t>(axis % 3)] *
                   (axis < 3 ? 1.0F : std::max(widest.extent, 1e-6F));
        };
        int axis = 0;
        float width = -1.0F;
        for (int a = 0; a < 6; ++a) {
            const auto [low, high] =
                std::minmax_element(begin, end, [&](const Patch& p, const Patch& q) {
                    return coordinate(p, a) < coordinate(q, a);
                });
            if (coordinate(*high, a) - coordinate(*low, a) > width) {
                width = coordinate(*high, a) - coordinate(*low, a);
                axis = a;
            }
        }
        std::sort(begin, end, [&](const Patch& p, const Patch& q) {
            const float a = coordinate(p, axis), b = coordinate(q, axis);
            return a < b || (a == b && p.vertex < q.vertex);
        });
        const auto middle = static_cast<std::size_t>(widest.begin) + count / 2;
        open.push(group(static_cast<std::size_t>(widest.begin), middle));
        open.push(group(middle, static_cast<std::size_t>(widest.end)));
    }
    // Groups side by side are drawn one after the other, at even steps of their light.
    std::ranges::sort(groups_, {}, &Group::begin);
}

// No less than what the patches of each group give if nothing is between, lx; -1: they are near.
void BrightPatches::weigh(const Block& block, const Vec3f& position, const Vec3f& normal,
                          std::span<float, Block::kSize> light) {
    for (std::size_t i = 0; i < Block::kSize; ++i) {
        const float x = block.x[i] - position.x, y = block.y[i] - position.y,
                    z = block.z[i] - position.z;
        const float square = x * x + y * y + z * z;
        const float cosine = normal.x * block.normal_x[i] + normal.y * block.normal_y[i] +
                             normal.z * block.normal_z[i];
        const float above = block.thickness[i] * std::abs(cosine) +
                            block.extent[i] * std::sqrt(std::abs(1.0F - cosine * cosine));
        const float here = above + x * normal.x + y * normal.y + z * normal.z;
        const float there = block.thickness[i] +
                            (std::sqrt(square) + block.extent[i]) * block.spread[i] -
                            (x * block.normal_x[i] + y * block.normal_y[i] + z * block.normal_z[i]);
        // Four times the cosines' product: branches would keep the compiler from vectors.
        const float cosines = (here + std::abs(here)) * (there + std::abs(there));
        const float far = square > kFarGroup * block.extent[i] * block.extent[i] ? 0.25F : 0.0F;
        const float given = far * block.flux[i] * cosines / (square * square + kTiny);
        light[i] = far > 0.0F ? given : -1.0F;
    }
}

void BrightPatches::look(const Vec3f& position, const Vec3f& normal, std::size_t count,
                         PhotonRandom& random, std::vector<BrightHit>& hits) const {
    // What is drawn: a group from afar, each patch of one that is near.
    struct Candidate {
        float light;             // lx, if nothing is between; of a group no less than that
        std::int32_t begin, end; // patches
        float flux;              // lm
    };
    std::vector<Candidate> candidates;
    candidates.reserve(groups_.size());
    float sum = 0.0F;
    const auto add = [&](float light, std::int32_t begin, std::int32_t end, float flux) {
        if (light > 0.0F) {
            candidates.push_back({light, begin, end, flux});
            sum += light;
        }
    };
    const auto cosines = [&](const Patch& patch, const Vec3f& to) {
        return std::max(0.0F, dot(to, normal)) * std::max(0.0F, -dot(to, patch.normal));
    };
    std::array<float, Block::kSize> of_groups{};
    for (std::size_t g = 0; g < groups_.size(); ++g) {
        const std::size_t i = g % Block::kSize;
        if (i == 0) {
            weigh(blocks_[g / Block::kSize], position, normal, of_groups);
        }
        const Group& group = groups_[g];
        if (of_groups[i] >= 0.0F) {
            add(of_groups[i], group.begin, group.end, group.flux);
            continue;
        }
        for (std::int32_t p = group.begin; p < group.end; ++p) {
            const Patch& patch = patches_[p];
            const Vec3f to = patch.position - position;
            const float square = dot(to, to);
            if (square > kFar * patch.area) {
                add(patch.flux * cosines(patch, to) / (square * square), p, p + 1, patch.flux);
            }
        }
    }
    const float start = high_float(random.next());
    if (candidates.empty()) {
        hits.resize(hits.size() + count, {0, 0.0F});
        return;
    }
    std::size_t at = 0;
    float before = 0.0F; // sum of the light of earlier candidates
    constexpr std::size_t kRays = 16;
    std::array<Ray, kRays> rays;
    std::array<float, kRays> seen{};
    for (std::size_t first = 0; first < count; first += kRays) {
        const std::size_t end = std::min(count, first + kRays);
        const std::size_t begin = hits.size();
        for (std::size_t k = first; k < end; ++k) {
            const float target = (static_cast<float>(k) + start) / static_cast<float>(count) * sum;
            while (at + 1 < candidates.size() && before + candidates[at].light <= target) {
                before += candidates[at++].light;
            }
            const Candidate& drawn = candidates[at];
            const float within = (target - before) / drawn.light * drawn.flux;
            const auto p = static_cast<std::int32_t>(
                std::upper_bound(before_.begin() + drawn.begin + 1, before_.begin() + drawn.end,
                                 within + before_[drawn.begin]) -
                before_.begin() - 1);
            const Patch& patch = patches_[p];
            const Vec3f to = patch.position - position;
            const float square = dot(to, to);
            float weight = 0.0F;
            if (square > kFar * patch.area) {
                weight = cosines(patch, to) / (square * square) * (sum / drawn.light) *
                         (drawn.flux / patch.flux) * patch.area * std::numbers::inv_pi_v<float>;
            }
            rays[k - first] = {position, to * (1.0F - 0x1p-12F)};
            hits.push_back({p, weight});
        }
        caster_->transmitted(std::span(rays).first(end - first), seen);
        for (std::size_t k = 0; k < end - first; ++k) {
            hits[begin + k].weight *= seen[k];
        }
    }
}

} // namespace isolux
