// Vertices that are far brighter than the rest, as around a lamp: seen by shadow rays to them,
// drawn by the light that each would give were nothing in the way, since of the rays over the
// hemisphere most miss them [the area form of the rendering equation; next event estimation, Kajiya
// 1986].
//
// Of their exitance only what is above a cap is gathered so; up to the cap it is left to the rays
// over the hemisphere, which also see all of a patch that is too near to count as a point.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "core/random.h"
#include "core/scene.h"

namespace isolux {

// What a shadow ray says: the exitance above the cap of the patch, lm/m², times the weight is the
// illuminance by all patches.
struct BrightHit {
    std::int32_t patch;
    float weight;
};

class BrightPatches {
  public:
    BrightPatches() = default;
    // exitances: lm/m², photometric, one a vertex, as far as they are known for sure
    BrightPatches(const Scene& scene, std::span<const Receiver> receivers,
                  std::span<const float> exitances);

    std::size_t size() const { return patches_.size(); }
    float cap() const { return cap_; } // lm/m²
    std::int32_t vertex(std::size_t patch) const { return patches_[patch].vertex; }
    // The patch that a vertex is, if one and as far from a receiver as a point; else -1.
    std::int32_t seen_from(const Vec3f& position, std::int32_t vertex) const {
        const std::int32_t patch = patch_of_.empty() ? -1 : patch_of_[vertex];
        return patch >= 0 && is_far(patches_[patch], position) ? patch : -1;
    }

    // As many shadow rays from a receiver; position: local
    void look(const Vec3f& position, const Vec3f& normal, std::size_t count, PhotonRandom& random,
              std::vector<BrightHit>& hits) const;

  private:
    struct Patch {
        Vec3f position, normal; // local, off the surface
        float area;             // m²
        float flux;             // lm above the cap
        std::int32_t vertex;
    };
    // Side by side, so that the compiler weighs several at once; those that are missing give none.
    struct Block {
        static constexpr std::size_t kSize = 16;
        std::array<float, kSize> x{}, y{}, z{}, normal_x{}, normal_y{}, normal_z{}, area, flux{};

        Block() { area.fill(1.0F); } // lest those at no distance divide by none
    };
    static bool is_far(const Patch& patch, const Vec3f& position);

    const RayCaster* caster_ = nullptr;
    std::vector<Patch> patches_;
    std::vector<Block> blocks_;          // of the same patches
    std::vector<std::int32_t> patch_of_; // one a vertex
    float cap_ = 0.0F;
};

} // namespace isolux
