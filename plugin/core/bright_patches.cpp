#include "core/bright_patches.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

namespace isolux {
namespace {

// Of the mean exitance. On the office 4 leaves a tenth of the variance of a ray.
constexpr float kCap = 4.0F;
// Each vertex weighs all of them.
constexpr std::size_t kMostPatches = 512;
// Square distance, in areas of the patch, from which it counts as a point.
constexpr float kFar = 16.0F;

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
                                (exitances[v] - cap_) * a, static_cast<std::int32_t>(v)});
        }
    }
    const auto noise = [](const Patch& p) { return p.flux * p.flux / p.area; };
    std::ranges::sort(patches_, [&](const Patch& a, const Patch& b) {
        return noise(a) > noise(b) || (noise(a) == noise(b) && a.vertex < b.vertex);
    });
    patches_.resize(std::min(patches_.size(), kMostPatches));
    blocks_.resize((patches_.size() + Block::kSize - 1) / Block::kSize);
    for (std::size_t p = 0; p < patches_.size(); ++p) {
        const auto& [position, normal, a, above, vertex] = patches_[p];
        patch_of_[vertex] = static_cast<std::int32_t>(p);
        Block& block = blocks_[p / Block::kSize];
        const std::size_t i = p % Block::kSize;
        block.x[i] = position.x;
        block.y[i] = position.y;
        block.z[i] = position.z;
        block.normal_x[i] = normal.x;
        block.normal_y[i] = normal.y;
        block.normal_z[i] = normal.z;
        block.area[i] = a;
        block.flux[i] = above;
    }
}

void BrightPatches::look(const Vec3f& position, const Vec3f& normal, std::size_t count,
                         PhotonRandom& random, std::vector<BrightHit>& hits) const {
    constexpr std::size_t kSize = Block::kSize;
    static_assert(kMostPatches % kSize == 0);
    std::array<float, kMostPatches> light; // lx, if nothing is in the way
    std::array<float, kMostPatches / kSize> of_block;
    float sum = 0.0F;
    for (std::size_t b = 0; b < blocks_.size(); ++b) {
        const Block& block = blocks_[b];
        float* const of = &light[b * kSize];
        for (std::size_t i = 0; i < kSize; ++i) {
            const float x = block.x[i] - position.x, y = block.y[i] - position.y,
                        z = block.z[i] - position.z;
            const float square = x * x + y * y + z * z;
            const float here = x * normal.x + y * normal.y + z * normal.z;
            const float there =
                -(x * block.normal_x[i] + y * block.normal_y[i] + z * block.normal_z[i]);
            // Four times the cosines' product: branches would keep the compiler from vectors.
            const float cosines = (here + std::abs(here)) * (there + std::abs(there));
            const float near = kFar * block.area[i];
            const float far = square > near ? 0.25F : 0.0F;
            const float divisor = std::max(square, near); // no patch is at no distance
            of[i] = far * block.flux[i] * cosines / (divisor * divisor);
        }
        of_block[b] = std::accumulate(of, of + kSize, 0.0F);
        sum += of_block[b];
    }
    const float share = sum / std::numbers::pi_v<float>;
    const float start = high_float(random.next());
    std::size_t at = 0;
    float before = 0.0F; // sum of the light of earlier patches
    constexpr std::size_t kRays = 16;
    std::array<Ray, kRays> rays;
    std::array<float, kRays> seen{};
    hits.reserve(hits.size() + count);
    for (std::size_t first = 0; first < count; first += kRays) {
        const std::size_t end = std::min(count, first + kRays);
        const std::size_t begin = hits.size();
        for (std::size_t k = first; k < end; ++k) {
            const float target = (static_cast<float>(k) + start) / static_cast<float>(count) * sum;
            for (;;) {
                const bool begins = at % kSize == 0 && at + kSize < patches_.size();
                if (begins && before + of_block[at / kSize] <= target) {
                    before += of_block[at / kSize];
                    at += kSize;
                } else if (at + 1 < patches_.size() && before + light[at] <= target) {
                    before += light[at++];
                } else {
                    break;
                }
            }
            while (at > 0 && light[at] == 0.0F) { // by rounding, beyond the last
                before -= light[--at];
            }
            const Patch& patch = patches_[at];
            const Vec3f to = patch.position - position;
            rays[k - first] = {position, to * (1.0F - 0x1p-12F)};
            hits.push_back({static_cast<std::int32_t>(at), share * patch.area / patch.flux});
        }
        if (sum > 0.0F) {
            caster_->transmitted(std::span(rays).first(end - first), seen);
        }
        for (std::size_t k = 0; k < end - first; ++k) {
            hits[begin + k].weight *= sum > 0.0F ? seen[k] : 0.0F;
        }
    }
}

} // namespace isolux
