#include "core/bucket_variation.h"

#include <array>

namespace isolux {
namespace {

void divide(std::vector<double>& sums, const std::vector<double>& areas) {
    for (std::size_t v = 0; v < sums.size(); ++v) {
        sums[v] = areas[v] > 0.0 ? sums[v] / areas[v] : 0.0;
    }
}

// What the means over buckets exceed the values at their vertices by. Of the third of an element
// that lies nearest to a corner in barycentric terms, the mean of that corner's coordinate is
// 11/18, of each other one 7/36.
std::vector<double> offset(const IlluminationMesh& mesh, std::span<const double> at_vertices) {
    std::vector<double> out(at_vertices.size());
    for_each_side(mesh, [&](const MeshElement& element, const auto& vertices) {
        const double third = mesh.area(element) / 3.0;
        const auto& [a, b, c] = vertices;
        const double all = at_vertices[a] + at_vertices[b] + at_vertices[c];
        for (const std::int32_t v : vertices) {
            out[v] += third * 7.0 / 36.0 * (all - 3.0 * at_vertices[v]);
        }
    });
    divide(out, mesh.areas);
    return out;
}

} // namespace

std::vector<double> bucket_offset(const IlluminationMesh& mesh, std::span<const double> means) {
    std::vector<double> at_vertices = offset(mesh, means);
    for (std::size_t v = 0; v < means.size(); ++v) {
        at_vertices[v] = means[v] - at_vertices[v];
    }
    // Once more, of what the vertices then have: means are flatter than the light itself.
    return offset(mesh, at_vertices);
}

std::vector<double> offset_square(const IlluminationMesh& mesh, std::span<const double> offsets) {
    // As much again for what bends between vertices; where none of it shows at one, it does around.
    std::vector<double> out(offsets.size());
    for_each_side(mesh, [&](const MeshElement& element, const auto& vertices) {
        const double third = mesh.area(element) / 3.0;
        double square = 0.0;
        for (const std::int32_t v : vertices) {
            square += offsets[v] * offsets[v] / 3.0;
        }
        for (const std::int32_t v : vertices) {
            out[v] += third * square;
        }
    });
    divide(out, mesh.areas);
    for (std::size_t v = 0; v < out.size(); ++v) {
        out[v] += offsets[v] * offsets[v];
    }
    return out;
}

std::vector<double> photometric(std::span<const Vec3f> illuminance) {
    std::vector<double> out(illuminance.size());
    for (std::size_t v = 0; v < out.size(); ++v) {
        out[v] = luminance(illuminance[v].as<double>());
    }
    return out;
}

} // namespace isolux
