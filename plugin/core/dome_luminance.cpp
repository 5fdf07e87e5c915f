#include "core/dome_luminance.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace isolux {
namespace {

constexpr double kPi = std::numbers::pi;
// Cells around, at least: a coarse map's texels are divided, so that a horizon passes between
// cells.
constexpr std::int32_t kLeastColumns = 256;
// Of the flux density: what a node across the horizon may add uncertainly.
constexpr double kTolerance = 1e-6;
// Half the range of the cosines within a node, of the radius around it: a square's, from its side
// to its diagonal.
constexpr double kSpread = 0.6;

// Illuminance from a node's light; its cosines are even within the spread of their mean.
double light_above(const Vec3f& vector, const Vec3d& normal, double spread) {
    const auto v = vector.as<double>();
    const double along = dot(v, normal), half = spread * length(v);
    if (std::abs(along) >= half) {
        return std::max(0.0, along);
    }
    return (along + half) * (along + half) / (4.0 * half);
}

} // namespace

DomeLuminance::DomeLuminance(std::span<const Vec3f> texels, std::int32_t width, std::int32_t height)
    : width_(width), height_(height), repeat_(1), columns_(width), rows_(height),
      texels_(texels.begin(), texels.end()) {
    grey_ = std::ranges::all_of(texels_, [](const Vec3f& c) { return c.x == c.y && c.y == c.z; });
    if (is_constant()) {
        flux_density_ = texels_.front().as<double>() * (4.0 * kPi);
        photometric_ = isolux::luminance(flux_density_);
        return;
    }
    repeat_ = (kLeastColumns + width - 1) / width;
    repeat_ = std::max(repeat_, (kLeastColumns / 2 + height - 1) / height);
    columns_ = width * repeat_;
    rows_ = height * repeat_;
    tabulate_flux();
    std::int32_t level = 0;
    do {
        levels_.push_back(make_level(level++));
    } while (levels_.back().columns > 1 || levels_.back().rows > 1);
}

double DomeLuminance::latitude(double row) const { return kPi * (0.5 - row / rows_); }
double DomeLuminance::longitude(double column) const {
    return kPi * (1.0 - 2.0 * column / columns_);
}

const Vec3f& DomeLuminance::texel(std::int32_t row, std::int32_t column) const {
    return texels_[static_cast<std::size_t>(row / repeat_) * width_ + column / repeat_];
}

void DomeLuminance::tabulate_flux() {
    row_flux_.push_back(0.0);
    texel_flux_.reserve(static_cast<std::size_t>(width_ + 1) * height_);
    for (std::int32_t j = 0; j < height_; ++j) {
        const double first = std::sin(latitude(j * repeat_));
        const double last = std::sin(latitude((j + 1) * repeat_));
        const double solid_angle = (first - last) * 2.0 * kPi / width_;
        const std::size_t begin = texel_flux_.size();
        Vec3d sum;
        texel_flux_.push_back(0.0);
        for (std::int32_t i = 0; i < width_; ++i) {
            sum += texels_[static_cast<std::size_t>(j) * width_ + i].as<double>();
            texel_flux_.push_back(isolux::luminance(sum));
        }
        const double all = texel_flux_.back();
        for (std::size_t i = begin; all > 0.0 && i < texel_flux_.size(); ++i) {
            texel_flux_[i] /= all;
        }
        flux_density_ += sum * solid_angle;
        row_flux_.push_back(row_flux_.back() + all * solid_angle);
    }
    photometric_ = row_flux_.back();
}

DomeLuminance::Level DomeLuminance::make_level(std::int32_t level) const {
    const std::int32_t size = std::int32_t{1} << level;
    Level out;
    out.columns = (columns_ + size - 1) >> level;
    out.rows = (rows_ + size - 1) >> level;
    const auto end = [size](std::int32_t i, std::int32_t all) {
        return std::min<double>((i + 1.0) * size, all);
    };
    const double across = 2.0 * kPi * std::min<double>(size, columns_) / columns_;
    for (std::int32_t j = 0; j < out.rows; ++j) {
        const double first = latitude(static_cast<double>(j) * size);
        const double last = latitude(end(j, rows_));
        const double middle = 0.5 * (first + last);
        // Along the meridian, then along the widest parallel.
        const double widest = first * last <= 0.0 ? 1.0 : std::max(std::cos(first), std::cos(last));
        out.row.push_back(
            {std::sin(middle), std::cos(middle), 0.5 * (first - last) + 0.5 * across * widest});
    }
    for (std::int32_t i = 0; i < out.columns; ++i) {
        const double middle =
            0.5 * (longitude(static_cast<double>(i) * size) + longitude(end(i, columns_)));
        out.column.push_back({std::sin(middle), std::cos(middle)});
    }
    if (level == 0) {
        return out;
    }
    const Level& finer = levels_.back();
    out.nodes.resize(static_cast<std::size_t>(out.rows) * out.columns);
    for (std::int32_t j = 0; j < finer.rows; ++j) {
        for (std::int32_t i = 0; i < finer.columns; ++i) {
            Node& node = out.nodes[static_cast<std::size_t>(j / 2) * out.columns + i / 2];
            const Node part = level == 1
                                  ? texel_node(j, i)
                                  : finer.nodes[static_cast<std::size_t>(j) * finer.columns + i];
            node.red += part.red;
            node.green += part.green;
            node.blue += part.blue;
            node.flux += part.flux;
        }
    }
    return out;
}

// ∫ ω dω over a cell is known in closed form.
DomeLuminance::Node DomeLuminance::texel_node(std::int32_t row, std::int32_t column) const {
    const double high = latitude(row), low = latitude(row + 1);
    const double squares =
        0.5 * (high - low) + 0.25 * (std::sin(2.0 * high) - std::sin(2.0 * low)); // ∫ cos² dφ
    const double first = std::sin(high), last = std::sin(low);
    const double width = 2.0 * kPi / columns_, chord = 2.0 * std::sin(0.5 * width);
    const Column& c = levels_.front().column[static_cast<std::size_t>(column)];
    const Vec3f vector =
        Vec3d{squares * chord * c.sine, 0.5 * (first * first - last * last) * width,
              squares * chord * c.cosine}
            .as<float>();
    const Vec3f& l = texel(row, column);
    return {vector * l.x, vector * l.y, vector * l.z,
            isolux::luminance(l) * static_cast<float>((first - last) * width)};
}

Vec3f DomeLuminance::luminance(const Vec3d& direction) const {
    if (is_constant()) {
        return texels_.front();
    }
    const double latitude = std::asin(std::clamp(direction.y, -1.0, 1.0));
    const double longitude = std::atan2(direction.x, direction.z);
    const auto cell = [](double share, std::int32_t all) {
        return std::clamp(static_cast<std::int32_t>(share * all), 0, all - 1);
    };
    const std::int32_t j = cell(0.5 - latitude / kPi, height_);
    const std::int32_t i = cell(0.5 - longitude / (2.0 * kPi), width_);
    return texels_[static_cast<std::size_t>(j) * width_ + i];
}

double DomeLuminance::density(const Vec3d& direction) const {
    return static_cast<double>(isolux::luminance(luminance(direction))) / photometric_;
}

DomeLuminance::Sample DomeLuminance::sample(double u, double v) const {
    if (is_constant()) {
        const double y = 1.0 - 2.0 * u, r = std::sqrt(std::max(0.0, 1.0 - y * y));
        const Vec3d direction{r * std::sin(2.0 * kPi * v), y, r * std::cos(2.0 * kPi * v)};
        return {direction, 0.25 / kPi, texels_.front()};
    }
    // The interval of a table that holds u, and where in it.
    const auto find = [](const double* begin, const double* end, double at, double& within) {
        const double* above = std::upper_bound(begin + 1, end, at);
        above = above == end ? std::lower_bound(begin + 1, end, *(end - 1)) : above;
        within = std::clamp((at - *(above - 1)) / (*above - *(above - 1)), 0.0, 1.0);
        return static_cast<std::int32_t>(above - begin - 1);
    };
    double down = 0.0, along = 0.0;
    const std::int32_t j =
        find(row_flux_.data(), row_flux_.data() + row_flux_.size(), u * photometric_, down);
    const double* row = texel_flux_.data() + static_cast<std::size_t>(j) * (width_ + 1);
    const std::int32_t i = find(row, row + width_ + 1, v, along);
    const double first = std::sin(latitude(j * repeat_));
    const double last = std::sin(latitude((j + 1) * repeat_));
    const double y = first + (last - first) * down;
    const double r = std::sqrt(std::max(0.0, 1.0 - y * y));
    const double turn = longitude((i + along) * repeat_);
    const Vec3f& l = texels_[static_cast<std::size_t>(j) * width_ + i];
    return {{r * std::sin(turn), y, r * std::cos(turn)},
            static_cast<double>(isolux::luminance(l)) / photometric_,
            l};
}

Vec3d DomeLuminance::illuminance(const Vec3d& normal) const {
    if (is_constant()) {
        return texels_.front().as<double>() * kPi;
    }
    Vec3d sum;
    add_illuminance(static_cast<std::int32_t>(levels_.size()) - 1, 0, 0, normal, sum);
    return sum;
}

void DomeLuminance::add_illuminance(std::int32_t level, std::int32_t row, std::int32_t column,
                                    const Vec3d& normal, Vec3d& sum) const {
    const Level& at = levels_[static_cast<std::size_t>(level)];
    const Row& r = at.row[static_cast<std::size_t>(row)];
    const Column& c = at.column[static_cast<std::size_t>(column)];
    const double cosine = r.cosine * (c.sine * normal.x + c.cosine * normal.z) + r.sine * normal.y;
    const double reach = r.radius < 0.5 * kPi ? std::sin(r.radius) : 2.0;
    if (cosine <= -reach) {
        return;
    }
    const Node node = level == 0 ? texel_node(row, column)
                                 : at.nodes[static_cast<std::size_t>(row) * at.columns + column];
    const auto flux = static_cast<double>(node.flux);
    const bool above = cosine >= reach;
    if (above || level == 0 || flux * reach < kTolerance * photometric_) {
        const double spread = above ? 0.0 : kSpread * r.radius;
        sum += Vec3d{light_above(node.red, normal, spread), light_above(node.green, normal, spread),
                     light_above(node.blue, normal, spread)};
        return;
    }
    const Level& finer = levels_[static_cast<std::size_t>(level - 1)];
    for (std::int32_t j = 2 * row; j < std::min(2 * row + 2, finer.rows); ++j) {
        for (std::int32_t i = 2 * column; i < std::min(2 * column + 2, finer.columns); ++i) {
            add_illuminance(level - 1, j, i, normal, sum);
        }
    }
}

} // namespace isolux
