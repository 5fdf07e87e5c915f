#include "core/triangulation.h"

#include <algorithm>
#include <numeric>

namespace isolux {
namespace {

// Each takes a whole round without an ear; beyond it there is no shape left to keep.
constexpr std::size_t kMostForcedCuts = 16;

struct Vec2d {
    double x, y;
};

double cross(const Vec2d& o, const Vec2d& a, const Vec2d& b) {
    return (a.x - o.x) * (b.y - o.y) - (a.y - o.y) * (b.x - o.x);
}

bool same(const Vec2d& p, const Vec2d& q) { return p.x == q.x && p.y == q.y; }

// Corners of the triangle are not in it: a face may touch itself there.
bool inside(const Vec2d& p, const Vec2d& a, const Vec2d& b, const Vec2d& c) {
    return cross(a, b, p) >= 0.0 && cross(b, c, p) >= 0.0 && cross(c, a, p) >= 0.0 && !same(p, a) &&
           !same(p, b) && !same(p, c);
}

// The face seen along its normal's largest component, counter-clockwise.
std::vector<Vec2d> project(const PolygonMesh& mesh, std::int32_t first, std::int32_t count,
                           const Vec3d& normal) {
    const double ax = std::abs(normal.x), ay = std::abs(normal.y), az = std::abs(normal.z);
    std::vector<Vec2d> out(static_cast<std::size_t>(count));
    for (std::int32_t i = 0; i < count; ++i) {
        const Vec3d& p = mesh.points[mesh.face_vertex_indices[first + i]];
        auto& q = out[i];
        if (az >= ax && az >= ay) {
            q = normal.z > 0 ? Vec2d{p.x, p.y} : Vec2d{p.y, p.x};
        } else if (ax >= ay) {
            q = normal.x > 0 ? Vec2d{p.y, p.z} : Vec2d{p.z, p.y};
        } else {
            q = normal.y > 0 ? Vec2d{p.z, p.x} : Vec2d{p.x, p.z};
        }
    }
    return out;
}

bool convex(const std::vector<Vec2d>& polygon) {
    const std::size_t n = polygon.size();
    for (std::size_t i = 0; i < n; ++i) {
        if (cross(polygon[i], polygon[(i + 1) % n], polygon[(i + 2) % n]) < 0.0) {
            return false;
        }
    }
    return true;
}

// Calls emit(i, j, k) for each triangle, positions in the polygon, counter-clockwise.
template <typename Emit> void clip_ears(const std::vector<Vec2d>& polygon, const Emit& emit) {
    std::vector<std::int32_t> ring(polygon.size());
    std::iota(ring.begin(), ring.end(), 0);
    std::size_t at = 0, without_ear = 0, forced_cuts = 0;
    while (ring.size() > 3) {
        const std::size_t n = ring.size();
        const std::int32_t before = ring[(at + n - 1) % n], tip = ring[at],
                           after = ring[(at + 1) % n];
        const Vec2d &a = polygon[before], &b = polygon[tip], &c = polygon[after];
        const bool ear =
            same(a, c) || (cross(a, b, c) > 0.0 && std::ranges::none_of(ring, [&](std::int32_t i) {
                               return inside(polygon[i], a, b, c);
                           }));
        // A face that crosses itself has no ear left at some point: cut the corner all the same.
        const bool forced = without_ear == n;
        if (forced && ++forced_cuts > kMostForcedCuts) {
            break;
        }
        if (ear || forced) {
            emit(before, tip, after);
            ring.erase(ring.begin() + static_cast<std::ptrdiff_t>(at));
            without_ear = 0;
            at = (at + n - 2) % (n - 1); // the corner before: it may be an ear now
        } else {
            ++without_ear;
            at = (at + 1) % n;
        }
    }
    for (std::size_t i = 1; i + 1 < ring.size(); ++i) {
        emit(ring[0], ring[i], ring[i + 1]);
    }
}

} // namespace

std::vector<bool> hole_flags(const PolygonMesh& mesh) {
    std::vector<bool> hole(mesh.face_vertex_counts.size(), false);
    for (const std::int32_t face : mesh.hole_faces) {
        hole[static_cast<std::size_t>(face)] = true;
    }
    return hole;
}

Vec3d area_vector(const PolygonMesh& mesh, std::int32_t first_corner, std::int32_t count) {
    Vec3d sum;
    const Vec3d& origin = mesh.points[mesh.face_vertex_indices[first_corner]];
    for (std::int32_t i = 1; i + 1 < count; ++i) {
        const Vec3d& a = mesh.points[mesh.face_vertex_indices[first_corner + i]];
        const Vec3d& b = mesh.points[mesh.face_vertex_indices[first_corner + i + 1]];
        sum += cross(a - origin, b - origin);
    }
    return mesh.flip_winding ? -sum : sum;
}

Triangulation triangulate(const PolygonMesh& mesh) {
    Triangulation out;
    out.corners.reserve(mesh.face_vertex_indices.size());
    out.faces.reserve(mesh.face_vertex_indices.size());
    const std::vector<bool> hole = hole_flags(mesh);
    std::int32_t first = 0;
    for (std::size_t face = 0; face < mesh.face_vertex_counts.size(); ++face) {
        const std::int32_t count = mesh.face_vertex_counts[face];
        const auto emit = [&](std::int32_t i, std::int32_t j, std::int32_t k) {
            const auto point = [&](std::int32_t c) -> const Vec3d& {
                return mesh.points[mesh.face_vertex_indices[first + c]];
            };
            const Vec3d normal = cross(point(j) - point(i), point(k) - point(i));
            if (dot(normal, normal) > 0.0) {
                if (mesh.flip_winding) {
                    std::swap(j, k);
                }
                out.corners.push_back({first + i, first + j, first + k});
                out.faces.push_back(static_cast<std::int32_t>(face));
            }
        };
        if (count == 3 && !hole[face]) {
            emit(0, 1, 2);
        } else if (count > 3 && !hole[face]) {
            const Vec3d front = area_vector(mesh, first, count);
            const auto polygon = project(mesh, first, count, mesh.flip_winding ? -front : front);
            if (count > kMostEarCorners || convex(polygon)) {
                for (std::int32_t i = 1; i + 1 < count; ++i) {
                    emit(0, i, i + 1);
                }
            } else {
                clip_ears(polygon, emit);
            }
        }
        first += count;
    }
    return out;
}

} // namespace isolux
