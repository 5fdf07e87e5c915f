#include "core/ray_caster.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <new>
#include <stdexcept>

#if __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif
#include <tbb/task_arena.h>

namespace isolux {
namespace {

// AVX2 where there is it, else what Embree chooses: the same instructions, thus the same bits, on
// every machine of the last decade. For single incoherent rays AVX-512 measured no faster.
RTCDevice new_device() {
    RTCDevice device = rtcNewDevice("isa=avx2");
    return device != nullptr ? device : rtcNewDevice(nullptr);
}

// A ray starts this fraction of its coordinates off the surface: eight units in the last place
// of a float, the rounding of origin + distance * direction.
constexpr float kRelativeOffset = 0x1p-20F;

// Shadow rays that go through the tree together, and the least that gain by it.
constexpr std::size_t kPacket = 8, kLeastPacket = 4;

#if RTC_VERSION_MAJOR >= 4
void intersect(RTCScene scene, RTCRayHit& ray_hit) { rtcIntersect1(scene, &ray_hit); }
void occlude(RTCScene scene, RTCRay& ray) { rtcOccluded1(scene, &ray); }
void occlude(const int* valid, RTCScene scene, RTCRay8& rays) { rtcOccluded8(valid, scene, &rays); }
#else
void intersect(RTCScene scene, RTCRayHit& ray_hit) {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcIntersect1(scene, &context, &ray_hit);
}
void occlude(RTCScene scene, RTCRay& ray) {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcOccluded1(scene, &context, &ray);
}
void occlude(const int* valid, RTCScene scene, RTCRay8& rays) {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcOccluded8(valid, scene, &context, &rays);
}
#endif

RTCRay embree_ray(const Ray& ray, float far) {
    RTCRay out{};
    out.org_x = ray.origin.x;
    out.org_y = ray.origin.y;
    out.org_z = ray.origin.z;
    out.dir_x = ray.direction.x;
    out.dir_y = ray.direction.y;
    out.dir_z = ray.direction.z;
    out.tfar = far;
    out.mask = ~0U;
    return out;
}

} // namespace

struct RayCaster::Embree {
    RTCDevice device = new_device();
    RTCScene scene = rtcNewScene(device);

    // Watertight: a ray through an edge meets one of the triangles that share it.
    Embree() { rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST); }
    Embree(const Embree&) = delete;
    Embree& operator=(const Embree&) = delete;
    ~Embree() {
        rtcReleaseScene(scene);
        rtcReleaseDevice(device);
    }
};

RayCaster::RayCaster(std::span<const Vec3d> points,
                     std::span<const std::array<std::int32_t, 3>> triangles, int threads)
    : embree_(std::make_unique<Embree>()), least_offset_(0.0F) {
    Vec3d low{std::numeric_limits<double>::max(), std::numeric_limits<double>::max(),
              std::numeric_limits<double>::max()};
    Vec3d high = -low;
    for (const auto& p : points) {
        low = {std::min(low.x, p.x), std::min(low.y, p.y), std::min(low.z, p.z)};
        high = {std::max(high.x, p.x), std::max(high.y, p.y), std::max(high.z, p.z)};
    }
    if (points.empty()) {
        low = high = {};
    }
    origin_ = (low + high) * 0.5;
    const Vec3d half = (high - low) * 0.5;
    least_offset_ =
        kRelativeOffset * 0x1p-3F * static_cast<float>(std::max({half.x, half.y, half.z}));

    const RTCGeometry geometry = rtcNewGeometry(embree_->device, RTC_GEOMETRY_TYPE_TRIANGLE);
    const auto free_geometry =
        std::unique_ptr<RTCGeometryTy, void (*)(RTCGeometry)>(geometry, rtcReleaseGeometry);
    if (!triangles.empty()) {
        auto* vertex = static_cast<Vec3f*>(rtcSetNewGeometryBuffer(
            geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, sizeof(Vec3f), points.size()));
        auto* index = static_cast<std::array<std::int32_t, 3>*>(
            rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                    sizeof(std::array<std::int32_t, 3>), triangles.size()));
        if (vertex == nullptr || index == nullptr) {
            throw std::bad_alloc();
        }
        std::ranges::transform(points, vertex,
                               [this](const Vec3d& p) { return (p - origin_).as<float>(); });
        std::ranges::copy(triangles, index);
        rtcCommitGeometry(geometry);
        rtcAttachGeometry(embree_->scene, geometry);
    }
    tbb::task_arena(threads).execute([this] { rtcCommitScene(embree_->scene); });
    if (rtcGetDeviceError(embree_->device) != RTC_ERROR_NONE) {
        throw std::runtime_error("Embree could not build the tree");
    }
}

RayCaster::~RayCaster() = default;

Hit RayCaster::closest_hit(const Ray& ray) const {
    RTCRayHit ray_hit{};
    ray_hit.ray = embree_ray(ray, std::numeric_limits<float>::infinity());
    ray_hit.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    intersect(embree_->scene, ray_hit);
    if (ray_hit.hit.geomID == RTC_INVALID_GEOMETRY_ID) {
        return {};
    }
    return {static_cast<std::int32_t>(ray_hit.hit.primID),
            ray_hit.hit.u,
            ray_hit.hit.v,
            ray_hit.ray.tfar,
            {ray_hit.hit.Ng_x, ray_hit.hit.Ng_y, ray_hit.hit.Ng_z}};
}

bool RayCaster::occluded(const Ray& ray) const {
    RTCRay shadow_ray = embree_ray(ray, 1.0F);
    occlude(embree_->scene, shadow_ray);
    return shadow_ray.tfar < 0.0F; // Embree's mark
}

void RayCaster::occluded(std::span<const Ray> rays, std::span<bool> out) const {
    std::size_t done = 0;
    for (; done + kLeastPacket <= rays.size(); done += kPacket) {
        const std::size_t count = std::min(kPacket, rays.size() - done);
        alignas(32) RTCRay8 packet{};
        alignas(32) std::array<int, kPacket> valid{};
        for (std::size_t i = 0; i < count; ++i) {
            const Ray& ray = rays[done + i];
            valid[i] = -1;
            packet.org_x[i] = ray.origin.x;
            packet.org_y[i] = ray.origin.y;
            packet.org_z[i] = ray.origin.z;
            packet.dir_x[i] = ray.direction.x;
            packet.dir_y[i] = ray.direction.y;
            packet.dir_z[i] = ray.direction.z;
            packet.tfar[i] = 1.0F;
            packet.mask[i] = ~0U;
        }
        occlude(valid.data(), embree_->scene, packet);
        for (std::size_t i = 0; i < count; ++i) {
            out[done + i] = packet.tfar[i] < 0.0F;
        }
    }
    for (; done < rays.size(); ++done) {
        out[done] = occluded(rays[done]);
    }
}

float RayCaster::offset(const Vec3f& p, float distance) const {
    const float size = std::max({std::abs(p.x), std::abs(p.y), std::abs(p.z), distance});
    return std::max(kRelativeOffset * size, least_offset_);
}

} // namespace isolux
