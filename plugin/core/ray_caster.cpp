#include "core/ray_caster.h"

#include <algorithm>
#include <atomic>
#include <bit>
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

#include "core/float_traps.h"
#include "core/random.h"

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

// A ray this near to an edge, in barycentric terms, may meet both triangles there: sixteen times
// what Embree lets them overlap.
constexpr float kAtEdge = 0x1p-19F;

#if RTC_VERSION_MAJOR >= 4
using EmbreeContext = RTCRayQueryContext;
#else
using EmbreeContext = RTCIntersectContext;
#endif

// What the filters need beside Embree's own.
struct Query : EmbreeContext {
    std::uint64_t key = 0; // of a ray that looks for its closest hit
    // By the rays' ids; a single ray's is 0:
    std::array<const std::uint8_t*, kPacket> meshes{};
    std::array<float, kPacket> transmitted{};
    std::array<std::uint8_t, kPacket> edge_count{};  // edges met, as far as there is room
    std::array<std::array<float, 4>, kPacket> edges; // distances to them

    Query() : EmbreeContext() {
#if RTC_VERSION_MAJOR >= 4
        rtcInitRayQueryContext(this);
#else
        rtcInitIntersectContext(this);
#endif
        transmitted.fill(1.0F);
    }

    // Whether no other triangle was met at this edge.
    bool first_at_edge(unsigned ray, float distance) {
        const std::span met(edges[ray].data(), edge_count[ray]);
        const auto same = [distance](float d) { return std::abs(d - distance) <= kAtEdge * d; };
        if (std::ranges::any_of(met, same)) {
            return false;
        }
        if (met.size() < edges[ray].size()) {
            edges[ray][edge_count[ray]++] = distance;
        }
        return true;
    }
};

#if RTC_VERSION_MAJOR >= 4
void intersect(RTCScene scene, Query& query, RTCRayHit& ray_hit) {
    [[maybe_unused]] const FloatTraps traps(false);
    RTCIntersectArguments arguments;
    rtcInitIntersectArguments(&arguments);
    arguments.context = &query;
    rtcIntersect1(scene, &ray_hit, &arguments);
}
void occlude(RTCScene scene, Query& query, RTCRay& ray) {
    [[maybe_unused]] const FloatTraps traps(false);
    RTCOccludedArguments arguments;
    rtcInitOccludedArguments(&arguments);
    arguments.context = &query;
    rtcOccluded1(scene, &ray, &arguments);
}
void occlude(const int* valid, RTCScene scene, Query& query, RTCRay8& rays) {
    [[maybe_unused]] const FloatTraps traps(false);
    RTCOccludedArguments arguments;
    rtcInitOccludedArguments(&arguments);
    arguments.context = &query;
    rtcOccluded8(valid, scene, &rays, &arguments);
}
#else
void intersect(RTCScene scene, Query& query, RTCRayHit& ray_hit) {
    [[maybe_unused]] const FloatTraps traps(false);
    rtcIntersect1(scene, &query, &ray_hit);
}
void occlude(RTCScene scene, Query& query, RTCRay& ray) {
    [[maybe_unused]] const FloatTraps traps(false);
    rtcOccluded1(scene, &query, &ray);
}
void occlude(const int* valid, RTCScene scene, Query& query, RTCRay8& rays) {
    [[maybe_unused]] const FloatTraps traps(false);
    rtcOccluded8(valid, scene, &query, &rays);
}
#endif

std::uint64_t ray_key(const Ray& ray) {
    const auto two = [](float a, float b) {
        return static_cast<std::uint64_t>(std::bit_cast<std::uint32_t>(a)) << 32 |
               std::bit_cast<std::uint32_t>(b);
    };
    return mix64(
        two(ray.origin.x, ray.origin.y) +
        mix64(two(ray.origin.z, ray.direction.x) + mix64(two(ray.direction.y, ray.direction.z))));
}

RTCRay embree_ray(const Ray& ray, float far) {
    RTCRay out{};
    out.org_x = ray.origin.x;
    out.org_y = ray.origin.y;
    out.org_z = ray.origin.z;
    out.dir_x = ray.direction.x;
    out.dir_y = ray.direction.y;
    out.dir_z = ray.direction.z;
    out.tnear = ray.near;
    out.tfar = far;
    out.mask = ~0U;
    return out;
}

using Triangles = std::span<const std::array<std::int32_t, 3>>;

// Triangles that make one geometry of the scene.
struct Part {
    std::int32_t first = 0;
    // Of copies, as in TriangleCopies; and where the axes of the source's area vectors go.
    std::array<std::uint8_t, 3> corners{0, 1, 2};
    std::array<Vec3f, 3> areas{};

    void place(Hit& hit) const {
        const std::array weights{1.0F - hit.u - hit.v, hit.u, hit.v};
        hit.triangle += first;
        hit.u = weights[corners[1]];
        hit.v = weights[corners[2]];
        hit.normal = areas[0] * hit.normal.x + areas[1] * hit.normal.y + areas[2] * hit.normal.z;
    }
};

} // namespace

struct RayCaster::Embree {
    RTCDevice device = new_device();
    RTCScene scene = rtcNewScene(device);
    std::atomic<std::int64_t> bytes = 0;
    std::vector<Part> parts; // by geometry of the scene
    // One a triangle, or none.
    std::vector<float> opacity;
    std::vector<std::int32_t> meshes;

    bool filtered() const { return !opacity.empty() || !meshes.empty(); }
    float opacity_of(std::uint32_t triangle) const {
        return opacity.empty() ? 1.0F : opacity[triangle];
    }
    bool passes_by(const std::uint8_t* met, std::uint32_t triangle) const {
        return met != nullptr && met[meshes[triangle]] == 0;
    }

    std::uint32_t triangle(const RTCFilterFunctionNArguments* arguments, unsigned i) const {
        const unsigned copy = RTCHitN_instID(arguments->hit, arguments->N, i, 0);
        const unsigned part = copy != RTC_INVALID_GEOMETRY_ID
                                  ? copy
                                  : RTCHitN_geomID(arguments->hit, arguments->N, i);
        return static_cast<std::uint32_t>(parts[part].first) +
               RTCHitN_primID(arguments->hit, arguments->N, i);
    }

    // Of single rays. What it refuses is not hit.
    static void meet(const RTCFilterFunctionNArguments* arguments) {
        const auto& embree = *static_cast<const Embree*>(arguments->geometryUserPtr);
        const auto& query = *static_cast<const Query*>(arguments->context);
        const std::uint32_t triangle = embree.triangle(arguments, 0);
        const float opacity = embree.opacity_of(triangle);
        if (embree.passes_by(query.meshes[0], triangle) ||
            (opacity < 1.0F && high_float(mix64(query.key ^ mix64(triangle))) >= opacity)) {
            arguments->valid[0] = 0;
        }
    }
    // Of shadow rays, some at once. What is refused is passed.
    static void pass(const RTCFilterFunctionNArguments* arguments) {
        const auto& embree = *static_cast<const Embree*>(arguments->geometryUserPtr);
        auto& query = *static_cast<Query*>(arguments->context);
        const unsigned n = arguments->N;
        for (unsigned i = 0; i < n; ++i) {
            if (arguments->valid[i] == 0) {
                continue;
            }
            const std::uint32_t triangle = embree.triangle(arguments, i);
            const unsigned ray = RTCRayN_id(arguments->ray, n, i);
            if (embree.passes_by(query.meshes[ray], triangle)) {
                arguments->valid[i] = 0;
                continue;
            }
            const float opacity = embree.opacity_of(triangle);
            if (opacity == 1.0F) {
                continue;
            }
            arguments->valid[i] = 0;
            const float u = RTCHitN_u(arguments->hit, n, i), v = RTCHitN_v(arguments->hit, n, i);
            if (std::min({u, v, 1.0F - u - v}) > kAtEdge ||
                query.first_at_edge(ray, RTCRayN_tfar(arguments->ray, n, i))) {
                query.transmitted[ray] *= 1.0F - opacity;
            }
        }
    }

    // Watertight: a ray through an edge meets one of the triangles that share it.
    Embree() {
        const auto count = [](void* sum, ssize_t change, bool) {
            *static_cast<std::atomic<std::int64_t>*>(sum) += change;
            return true;
        };
        rtcSetDeviceMemoryMonitorFunction(device, count, &bytes);
        rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST);
    }
    Embree(const Embree&) = delete;
    Embree& operator=(const Embree&) = delete;
    ~Embree() {
        rtcReleaseScene(scene);
        rtcReleaseDevice(device);
    }

    void add_triangles(RTCScene to, std::span<const Vec3d> points, Triangles triangles,
                       const Vec3d& centre) {
        std::int32_t low = std::numeric_limits<std::int32_t>::max(), high = 0;
        for (const auto& [a, b, c] : triangles) {
            low = std::min({low, a, b, c});
            high = std::max({high, a + 1, b + 1, c + 1});
        }
        const RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
        const auto free_geometry =
            std::unique_ptr<RTCGeometryTy, void (*)(RTCGeometry)>(geometry, rtcReleaseGeometry);
        auto* vertex = static_cast<Vec3f*>(
            rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                    sizeof(Vec3f), static_cast<std::size_t>(high - low)));
        auto* index = static_cast<std::array<std::int32_t, 3>*>(
            rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                    sizeof(std::array<std::int32_t, 3>), triangles.size()));
        if (vertex == nullptr || index == nullptr) {
            throw std::bad_alloc();
        }
        std::ranges::transform(points.subspan(low, high - low), vertex,
                               [&](const Vec3d& p) { return (p - centre).as<float>(); });
        std::ranges::transform(triangles, index, [low](const auto& t) {
            return std::array{t[0] - low, t[1] - low, t[2] - low};
        });
        if (filtered()) {
            rtcSetGeometryUserData(geometry, this);
            rtcSetGeometryIntersectFilterFunction(geometry, meet);
            rtcSetGeometryOccludedFilterFunction(geometry, pass);
        }
        rtcCommitGeometry(geometry);
        rtcAttachGeometry(to, geometry);
    }

    // About its first point, near which its coordinates are exact.
    RTCScene copied_tree(std::span<const Vec3d> points, Triangles triangles) {
        const RTCScene tree = rtcNewScene(device);
        rtcSetSceneFlags(tree, RTC_SCENE_FLAG_ROBUST);
        add_triangles(tree, points, triangles, points[triangles[0][0]]);
        rtcCommitScene(tree);
        return tree;
    }

    // centre : of the tree. origin : of the scene.
    void add_copy(RTCScene tree, const TriangleCopies& copy, const Vec3d& centre,
                  const Vec3d& origin) {
        const RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_INSTANCE);
        const Placement& p = copy.placement;
        const auto x = p.x.as<float>(), y = p.y.as<float>(), z = p.z.as<float>();
        const std::array columns{x, y, z, (p(centre) - origin).as<float>()};
        rtcSetGeometryInstancedScene(geometry, tree);
        rtcSetGeometryTransform(geometry, 0, RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR, columns.data());
        rtcCommitGeometry(geometry);
        rtcAttachGeometry(scene, geometry);
        rtcReleaseGeometry(geometry);
        const float side = copy.mirrored_order() ? -1.0F : 1.0F;
        parts.push_back({copy.first,
                         copy.corners,
                         {cross(y, z) * side, cross(z, x) * side, cross(x, y) * side}});
    }
};

RayCaster::RayCaster(RayTargets targets, int threads)
    : embree_(std::make_unique<Embree>()), least_offset_(0.0F) {
    const std::span points = targets.points;
    const Triangles triangles = targets.triangles;
    embree_->opacity = std::move(targets.opacity);
    embree_->meshes = std::move(targets.meshes);
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

#ifdef __SANITIZE_THREAD__
    threads = 1; // as in parallel.h, of Embree's library
#endif
    tbb::task_arena(threads).execute([&] {
        const auto count = static_cast<std::int32_t>(triangles.size());
        std::vector<TriangleCopies> placed(targets.copies);
        std::ranges::sort(placed, {}, &TriangleCopies::source);
        std::vector<std::array<std::int32_t, 2>> apart; // ranges that have a tree of their own
        for (auto at = placed.begin(); at != placed.end();) {
            const std::int32_t source = at->source, size = at->count;
            const RTCScene tree = embree_->copied_tree(points, triangles.subspan(source, size));
            const Vec3d& centre = points[triangles[source][0]];
            embree_->add_copy(tree, {.first = source, .count = size, .source = source}, centre,
                              origin_);
            apart.push_back({source, source + size});
            for (; at != placed.end() && at->source == source; ++at) {
                embree_->add_copy(tree, *at, centre, origin_);
                apart.push_back({at->first, at->first + size});
            }
            rtcReleaseScene(tree); // its instances keep it
        }
        std::ranges::sort(apart);
        apart.push_back({count, count});
        std::int32_t begin = 0;
        for (const auto& [end, next] : apart) {
            if (begin < end) {
                embree_->add_triangles(embree_->scene, points,
                                       triangles.subspan(begin, end - begin), origin_);
                embree_->parts.push_back({begin});
            }
            begin = next;
        }
        rtcCommitScene(embree_->scene);
    });
    if (rtcGetDeviceError(embree_->device) != RTC_ERROR_NONE) {
        throw std::runtime_error("Embree could not build the tree");
    }
}

RayCaster::~RayCaster() = default;

std::int64_t RayCaster::tree_bytes() const { return embree_->bytes; }

Hit RayCaster::closest_hit(const Ray& ray) const {
    RTCRayHit ray_hit{};
    ray_hit.ray = embree_ray(ray, std::numeric_limits<float>::infinity());
    ray_hit.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    Query query;
    query.meshes[0] = ray.meshes;
    if (!embree_->opacity.empty()) {
        query.key = ray_key(ray);
    }
    intersect(embree_->scene, query, ray_hit);
    if (ray_hit.hit.geomID == RTC_INVALID_GEOMETRY_ID) {
        return {};
    }
    Hit out{static_cast<std::int32_t>(ray_hit.hit.primID),
            ray_hit.hit.u,
            ray_hit.hit.v,
            ray_hit.ray.tfar,
            {ray_hit.hit.Ng_x, ray_hit.hit.Ng_y, ray_hit.hit.Ng_z}};
    if (ray_hit.hit.instID[0] != RTC_INVALID_GEOMETRY_ID) {
        embree_->parts[ray_hit.hit.instID[0]].place(out);
    } else {
        out.triangle += embree_->parts[ray_hit.hit.geomID].first;
    }
    return out;
}

float RayCaster::transmitted(const Ray& ray) const {
    RTCRay shadow_ray = embree_ray(ray, 1.0F);
    Query query;
    query.meshes[0] = ray.meshes;
    occlude(embree_->scene, query, shadow_ray);
    return shadow_ray.tfar < 0.0F ? 0.0F : query.transmitted[0]; // Embree's mark
}

void RayCaster::transmitted(std::span<const Ray> rays, std::span<float> out) const {
    std::size_t done = 0;
    for (; done + kLeastPacket <= rays.size(); done += kPacket) {
        const std::size_t count = std::min(kPacket, rays.size() - done);
        alignas(32) RTCRay8 packet{};
        alignas(32) std::array<int, kPacket> valid{};
        Query query;
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
            query.meshes[i] = ray.meshes;
            packet.id[i] = static_cast<unsigned>(i);
        }
        occlude(valid.data(), embree_->scene, query, packet);
        for (std::size_t i = 0; i < count; ++i) {
            out[done + i] = packet.tfar[i] < 0.0F ? 0.0F : query.transmitted[i];
        }
    }
    for (; done < rays.size(); ++done) {
        out[done] = transmitted(rays[done]);
    }
}

std::vector<std::int32_t> RayCaster::triangles_near(const Vec3f& p, float radius) const {
    struct Found {
        const Embree& embree;
        std::vector<std::int32_t> triangles;
    } found{*embree_, {}};
    RTCPointQuery query{p.x, p.y, p.z, 0.0F, radius};
    RTCPointQueryContext context;
    rtcInitPointQueryContext(&context);
    const auto add = [](RTCPointQueryFunctionArguments* arguments) {
        auto& out = *static_cast<Found*>(arguments->userPtr);
        const bool copy = arguments->context->instStackSize > 0;
        const unsigned part = copy ? arguments->context->instID[0] : arguments->geomID;
        out.triangles.push_back(out.embree.parts[part].first +
                                static_cast<std::int32_t>(arguments->primID));
        return false; // the radius stays
    };
    rtcPointQuery(embree_->scene, &query, &context, add, &found);
    return std::move(found.triangles);
}

float RayCaster::offset(const Vec3f& p, float distance) const {
    const float size = std::max({std::abs(p.x), std::abs(p.y), std::abs(p.z), distance});
    return std::max(kRelativeOffset * size, least_offset_);
}

} // namespace isolux
