#include "core/authored_mesh.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "core/float_traps.h"
#include "core/parallel.h"

namespace isolux {
namespace {

// Entries that one thread takes at a time: a fraction of a millisecond of work.
constexpr std::size_t kPart = 1 << 14;

// Calls visit(part, begin, end) for all parts of n entries.
template <typename Visit> void for_parts(std::size_t n, int threads, const Visit& visit) {
    const std::size_t parts = (n + kPart - 1) / kPart;
    const auto one = [&](std::size_t part) {
        [[maybe_unused]] const FloatTraps traps(false); // authored NaNs are looked for here
        visit(part, part * kPart, std::min(n, (part + 1) * kPart));
    };
    if (parts <= 1 || threads == 1) {
        for (std::size_t part = 0; part < parts; ++part) {
            one(part);
        }
        return;
    }
    parallel_for(threads, parts, one);
}

template <std::size_t Count> bool repeats(const std::int32_t* face) {
    bool twice = false;
    for (std::size_t i = 1; i < Count; ++i) {
        for (std::size_t j = 0; j < i; ++j) {
            twice |= face[i] == face[j];
        }
    }
    return twice;
}

bool uses_a_point_twice(std::span<const std::int32_t> face, std::vector<std::int32_t>& sorted) {
    if (face.size() == 4) {
        return repeats<4>(face.data());
    }
    if (face.size() == 3) {
        return repeats<3>(face.data());
    }
    sorted.assign(face.begin(), face.end());
    std::ranges::sort(sorted);
    return std::ranges::adjacent_find(sorted) != sorted.end();
}

bool within(const Vec3d& v, double limit) { // false for NaN
    return std::abs(v.x) <= limit && std::abs(v.y) <= limit && std::abs(v.z) <= limit;
}

} // namespace

TopologySurvey survey_topology(std::span<const std::int32_t> counts,
                               std::span<const std::int32_t> indices, int threads) {
    TopologySurvey out;
    if (counts.empty()) {
        return out;
    }
    std::vector<std::int64_t> sums((counts.size() + kPart - 1) / kPart);
    const auto [least, greatest] = std::ranges::minmax(counts);
    out.least_count = least;
    out.greatest_count = greatest;
    for_parts(counts.size(), threads, [&](std::size_t part, std::size_t begin, std::size_t end) {
        for (std::size_t f = begin; f < end; ++f) {
            sums[part] += counts[f];
        }
    });
    std::vector<std::int64_t> first_corners;
    for (const std::int64_t sum : sums) {
        first_corners.push_back(out.corners);
        out.corners += sum;
    }
    if (least < 0 || out.corners != static_cast<std::int64_t>(indices.size()) || indices.empty()) {
        return out;
    }

    std::vector<TopologySurvey> surveys(sums.size());
    for_parts(counts.size(), threads, [&](std::size_t part, std::size_t begin, std::size_t end) {
        TopologySurvey own;
        std::vector<std::int32_t> sorted;
        auto first = static_cast<std::size_t>(first_corners[part]);
        const auto last = first + static_cast<std::size_t>(sums[part]);
        own.least_index = std::numeric_limits<std::int32_t>::max();
        own.greatest_index = std::numeric_limits<std::int32_t>::min();
        for (std::size_t c = first; c < last; ++c) {
            own.least_index = std::min(own.least_index, indices[c]);
            own.greatest_index = std::max(own.greatest_index, indices[c]);
        }
        for (std::size_t f = begin; f < end; ++f) {
            const auto face = indices.subspan(first, static_cast<std::size_t>(counts[f]));
            own.degenerate_faces += face.size() < 3 || uses_a_point_twice(face, sorted);
            first += face.size();
        }
        surveys[part] = own;
    });
    out.least_index = std::ranges::min(surveys, {}, &TopologySurvey::least_index).least_index;
    out.greatest_index =
        std::ranges::max(surveys, {}, &TopologySurvey::greatest_index).greatest_index;
    for (const TopologySurvey& survey : surveys) {
        out.degenerate_faces += survey.degenerate_faces;
    }
    return out;
}

bool place_points(std::span<const Vec3f> points, const Placement& placement, std::span<Vec3d> out,
                  int threads) {
    std::vector<char> sound((points.size() + kPart - 1) / kPart);
    for_parts(points.size(), threads, [&](std::size_t part, std::size_t begin, std::size_t end) {
        bool all = true;
        for (std::size_t i = begin; i < end; ++i) {
            out[i] = placement(points[i].as<double>());
            all &= within(out[i], kFarthestPoint);
        }
        sound[part] = all;
    });
    return std::ranges::all_of(sound, [](char all) { return all != 0; });
}

bool place_normals(std::span<const Vec3f> normals, std::span<const std::int32_t> of,
                   const Placement& placement, std::span<Vec3f> out, int threads) {
    std::vector<char> sound((normals.size() + kPart - 1) / kPart);
    std::vector<Vec3f> placed(of.empty() ? 0 : normals.size());
    const std::span<Vec3f> to = of.empty() ? out : std::span(placed);
    for_parts(normals.size(), threads, [&](std::size_t part, std::size_t begin, std::size_t end) {
        bool all = true;
        for (std::size_t i = begin; i < end; ++i) {
            const Vec3d normal = placement.linear(normals[i].as<double>());
            const double square = dot(normal, normal);
            const bool is_direction = square > 0.0 && std::isfinite(square);
            all &= is_direction;
            to[i] = is_direction ? (normal * (1.0 / std::sqrt(square))).as<float>() : Vec3f{};
        }
        sound[part] = all;
    });
    for_parts(of.size(), threads, [&](std::size_t, std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            out[i] = placed[static_cast<std::size_t>(of[i])];
        }
    });
    return std::ranges::all_of(sound, [](char all) { return all != 0; });
}

} // namespace isolux
