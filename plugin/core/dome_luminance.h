// Luminance of an environment over direction: a latitude-longitude map of texels of constant
// luminance, integrated by a pyramid and sampled by luminous flux.
//
// Local axes as OpenEXR has them: the first row is at +Y; the middle of a row is +Z, and from there
// the longitude grows to the left, by way of +X.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/vec3.h"

namespace isolux {

class DomeLuminance {
  public:
    // texels : cd/m² by channel, rows from +Y to -Y; one alone: constant.
    DomeLuminance(std::span<const Vec3f> texels, std::int32_t width, std::int32_t height);

    bool is_constant() const { return columns_ == 1 && rows_ == 1; }
    bool is_grey() const { return grey_; }
    Vec3d flux_density() const { return flux_density_; } // lm/m² by channel: ∫ L dω

    // cd/m² by channel; direction: local, unit.
    Vec3f luminance(const Vec3d& direction) const;
    // lx by channel, of a plane with nothing in the way; its horizon is followed to a millionth of
    // the flux density.
    Vec3d illuminance(const Vec3d& normal) const;

    // A direction by luminous flux, and its density luminance / flux density, 1/sr.
    struct Sample {
        Vec3d direction;
        double density;
        Vec3f luminance;
    };
    // u, v in [0, 1)
    Sample sample(double u, double v) const;
    double density(const Vec3d& direction) const;

  private:
    // Light of 2^level by 2^level texels as a vector: where all of it is above the horizon, the
    // illuminance is its component along the normal.
    struct Node {
        Vec3f red, green, blue;
        float flux = 0.0F;
    };
    // Of a level: where its nodes begin, and where they lie on the sphere.
    struct Row {
        double sine, cosine, radius; // of the middle's latitude; rad, of all of a node
    };
    struct Column {
        double sine, cosine; // of the middle's longitude
    };
    struct Level {
        std::int32_t columns = 0, rows = 0;
        std::vector<Row> row;
        std::vector<Column> column;
        std::vector<Node> nodes; // none at level 0: texels speak for themselves
    };

    Level make_level(std::int32_t level) const;
    Node texel_node(std::int32_t row, std::int32_t column) const;
    const Vec3f& texel(std::int32_t row, std::int32_t column) const;
    double latitude(double row) const;
    double longitude(double column) const;
    void tabulate_flux();
    void add_illuminance(std::int32_t level, std::int32_t row, std::int32_t column,
                         const Vec3d& normal, Vec3d& sum) const;

    std::int32_t width_, height_; // of the texels
    std::int32_t repeat_;         // cells along each side of a texel
    std::int32_t columns_, rows_; // of the cells
    std::vector<Vec3f> texels_;
    bool grey_ = true;
    Vec3d flux_density_;
    double photometric_ = 0.0;       // lm/m²
    std::vector<double> row_flux_;   // from 0, in order
    std::vector<double> texel_flux_; // along each row of texels, from 0 to 1
    std::vector<Level> levels_;
};

} // namespace isolux
