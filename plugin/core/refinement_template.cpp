#include "core/refinement_template.h"

#include <cassert>
#include <cmath>
#include <limits>

namespace isolux {
namespace {

constexpr double kNever = std::numeric_limits<double>::infinity();

using Table = std::array<std::array<double, kTemplateNodes>, kTemplateNodes>;
using Choice = std::array<std::array<int, kTemplateNodes>, kTemplateNodes>;

// Brightness that an inner edge blurs, by the length over which it does: of two that cross the
// shorter is better where all is even, and one along a shadow border better than one across it.
double blur(const TemplateNode& a, const TemplateNode& b, double threshold) {
    const double difference = std::max(std::abs(a.brightness[0] - b.brightness[0]),
                                       std::abs(a.brightness[1] - b.brightness[1]));
    return length(b.position - a.position) * (threshold + difference);
}

void collect(const Choice& apex, int i, int j, std::vector<std::array<int, 3>>& triangles) {
    if (j - i > 1) {
        const int k = apex[i][j];
        triangles.push_back({i, k, j});
        collect(apex, i, k, triangles);
        collect(apex, k, j, triangles);
    }
}

} // namespace

// Departure: the paper picks among drawn templates and splits 1 to 4 where none fits. The
// triangulation of least total blur is the drawn one in each of its cases (a segment of one edge in
// shadow, a border across two edges, splits in the middle of all three) and fits all others.
std::vector<std::array<int, 3>> triangulate_template(std::span<const TemplateNode> nodes,
                                                     double threshold) {
    const int n = static_cast<int>(nodes.size());
    assert(3 <= n && n <= kTemplateNodes);
    // cost[i][j]: least blur of the inner edges of the polygon i, i + 1, ..., j, with its edge ij.
    Table cost{};
    Choice apex{};
    for (int span = 2; span < n; ++span) {
        for (int i = 0; i + span < n; ++i) {
            const int j = i + span;
            cost[i][j] = kNever;
            for (int k = i + 1; k < j; ++k) {
                if ((nodes[i].edges & nodes[j].edges & nodes[k].edges) != 0) {
                    continue; // all on one edge: no area
                }
                const double sum = cost[i][k] + cost[k][j];
                if (sum < cost[i][j]) {
                    cost[i][j] = sum;
                    apex[i][j] = k;
                }
            }
            if (span < n - 1) {
                cost[i][j] += blur(nodes[i], nodes[j], threshold);
            }
        }
    }
    std::vector<std::array<int, 3>> triangles;
    collect(apex, 0, n - 1, triangles);
    return triangles;
}

} // namespace isolux
