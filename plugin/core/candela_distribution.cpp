#include "core/candela_distribution.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>

namespace isolux {
namespace {

// Intervals at most this wide, rad, let short series stand for sine and cosine (error below 1e-11).
constexpr double kMaxInterval = 0.1;
// Angles this far beyond the last are rounding, rad.
constexpr double kAngleSlack = 1e-9;
constexpr int kMaxIterations = 64;

// Series for |x| <= kMaxInterval / 2. They keep their relative precision where the closed forms in
// the comments cancel, so that thin bands at a pole stay exact.
struct Series {
    double x, x2;
    explicit Series(double offset) : x(offset), x2(offset * offset) {}
    double sine() const { return x * (1.0 - x2 * (1.0 / 6.0 - x2 / 120.0)); }
    double versine() const { return x2 * (0.5 - x2 * (1.0 / 24.0 - x2 / 720.0)); } // 1 - cos x
    // Integral of y cos y: x sin x + cos x - 1.
    double x_cosine() const { return x2 * (0.5 - x2 * (1.0 / 8.0 - x2 / 144.0)); }
    // Integral of y sin y: sin x - x cos x.
    double x_sine() const { return x * x2 * (1.0 / 3.0 - x2 * (1.0 / 30.0 - x2 / 840.0)); }
};

struct Point {
    double sine, cosine;
};

// Sine and cosine of the angle x past the middle of an interval.
Point turned(double sin_middle, double cos_middle, const Series& x) {
    const double cosine = 1.0 - x.versine();
    return {sin_middle * cosine + cos_middle * x.sine(),
            cos_middle * cosine - sin_middle * x.sine()};
}

// t in [0, 1] with the share u of a density that is linear from `first` to `last`.
double invert_linear(double first, double last, double u) {
    const double root = std::sqrt((1.0 - u) * first * first + u * last * last);
    return first + root > 0.0 ? std::min(1.0, u * (first + last) / (first + root)) : 0.0;
}

void require(bool holds, const char* wanted) {
    if (!holds) {
        throw std::invalid_argument(wanted);
    }
}

void require_increasing(std::span<const double> angles, double largest, const char* wanted) {
    require(angles.front() >= 0.0 && angles.back() <= largest + kAngleSlack, wanted);
    for (std::size_t i = 1; i < angles.size(); ++i) {
        require(angles[i - 1] < angles[i], wanted);
    }
}

double mix(double a, double b, double t) { return a + t * (b - a); }

struct Place {
    std::size_t index;
    double fraction;
};

// Divides wide intervals, which leaves a bilinear function as it is. Returns where the divided
// angles lie among the given ones.
std::vector<Place> divide(std::span<const double> angles, std::vector<double>& divided) {
    std::vector<Place> places;
    for (std::size_t i = 0; i + 1 < angles.size(); ++i) {
        const double width = angles[i + 1] - angles[i];
        const int parts = static_cast<int>(std::ceil(width / kMaxInterval));
        for (int part = 0; part < parts; ++part) {
            places.push_back({i, static_cast<double>(part) / parts});
            divided.push_back(mix(angles[i], angles[i + 1], places.back().fraction));
        }
    }
    places.push_back({angles.size() - 2, 1.0});
    divided.push_back(angles.back());
    return places;
}

} // namespace

CandelaDistribution::CandelaDistribution(std::span<const double> gamma,
                                         std::span<const double> c_angles,
                                         std::span<const double> candela)
    : axial_(c_angles.size() == 1) {
    constexpr double kPi = std::numbers::pi;
    require(gamma.size() >= 2 && !c_angles.empty(), "at least two gamma angles and one C-angle");
    require(candela.size() == gamma.size() * c_angles.size(), "one candela value for each angle");
    require_increasing(gamma, kPi, "gamma angles strictly increasing in [0, pi]");
    require_increasing(c_angles, 2.0 * kPi, "C-angles strictly increasing in [0, 2 pi]");
    require(std::ranges::all_of(candela, [](double i) { return i >= 0.0 && std::isfinite(i); }),
            "finite candela values of at least 0");

    // An axially symmetric diagram goes round between two equal planes.
    const std::vector full_circle{0.0, 2.0 * kPi};
    const auto rows = divide(gamma, gamma_);
    const auto planes = divide(axial_ ? full_circle : c_angles, c_angles_);
    gamma_table_ = AngleTable(gamma_);
    c_table_ = AngleTable(c_angles_);

    candela_.reserve(planes.size() * rows.size());
    for (const Place& plane : planes) {
        const double* first = &candela[axial_ ? 0 : plane.index * gamma.size()];
        const double* next = axial_ ? first : first + gamma.size();
        for (const Place& row : rows) {
            const std::size_t j = row.index;
            candela_.push_back(mix(mix(first[j], first[j + 1], row.fraction),
                                   mix(next[j], next[j + 1], row.fraction), plane.fraction));
        }
    }
    for (std::size_t j = 0; j + 1 < gamma_.size(); ++j) {
        bands_.push_back(make_band(gamma_[j], gamma_[j + 1]));
    }
    for (std::size_t k = 0; k + 1 < c_angles_.size(); ++k) {
        sectors_.push_back(make_interval(c_angles_[k], c_angles_[k + 1]));
    }
    tabulate_cells();
}

CandelaDistribution::Interval CandelaDistribution::make_interval(double first, double last) {
    const double middle = 0.5 * (first + last);
    return {0.5 * (last - first), std::sin(middle), std::cos(middle)};
}

CandelaDistribution::GammaBand CandelaDistribution::make_band(double first, double last) {
    const Interval band = make_interval(first, last);
    const Series end(band.half);
    const double mean = band.sin_middle * end.sine();
    const double tilt = band.cos_middle * end.x_sine() / band.half;
    // sin(pi) must not round to something negative.
    return {band, std::max(0.0, std::sin(first)), std::max(0.0, std::sin(last)), mean - tilt,
            mean + tilt};
}

void CandelaDistribution::tabulate_cells() {
    std::vector<std::uint32_t> cells;
    std::vector<double> fluxes;
    require(sectors_.size() * bands_.size() < std::numeric_limits<std::uint32_t>::max(),
            "fewer than 2^32 cells");
    for (std::size_t k = 0; k < sectors_.size(); ++k) {
        const double* plane = &candela_[k * gamma_.size()];
        const double* next = plane + gamma_.size();
        for (std::size_t j = 0; j < bands_.size(); ++j) {
            const double mean = 0.5 * (bands_[j].first_weight * (plane[j] + next[j]) +
                                       bands_[j].last_weight * (plane[j + 1] + next[j + 1]));
            const double flux = mean * 2.0 * sectors_[k].half;
            if (flux > 0.0) {
                cells.push_back(static_cast<std::uint32_t>(k * bands_.size() + j));
                fluxes.push_back(flux);
                luminous_flux_ += flux;
            }
        }
    }

    // Vose's construction: each column pairs a cell below the mean with one above.
    const double mean =
        luminous_flux_ / static_cast<double>(std::max<std::size_t>(1, cells.size()));
    std::vector<std::uint32_t> below;
    std::vector<std::uint32_t> above;
    columns_.reserve(cells.size());
    for (std::uint32_t i = 0; i < cells.size(); ++i) {
        columns_.push_back({1.0, cells[i], cells[i]});
        (fluxes[i] < mean ? below : above).push_back(i);
    }
    while (!below.empty() && !above.empty()) {
        const std::uint32_t small = below.back();
        const std::uint32_t large = above.back();
        below.pop_back();
        columns_[small].threshold = fluxes[small] / mean;
        columns_[small].alias = cells[large];
        fluxes[large] -= mean - fluxes[small];
        if (fluxes[large] < mean) {
            above.pop_back();
            below.push_back(large);
        }
    }
}

double CandelaDistribution::widest_gamma() const {
    std::size_t last = 0;
    for (std::size_t i = 0; i < candela_.size(); ++i) {
        if (candela_[i] > 0.0) { // light up to the next angle
            last = std::max(last, std::min(i % gamma_.size() + 1, gamma_.size() - 1));
        }
    }
    return gamma_[last];
}

double CandelaDistribution::peak_intensity() const { return std::ranges::max(candela_); }

double CandelaDistribution::intensity(const Vec3d& direction) const {
    const double squared = direction.x * direction.x + direction.y * direction.y;
    const double off = std::sqrt(squared);
    const double per_length = 1.0 / std::sqrt(squared + direction.z * direction.z);
    const auto row = gamma_table_.locate(off * per_length, -direction.z * per_length);
    if (!row) {
        return 0.0;
    }
    const double* first = &candela_[row->index];
    if (axial_) {
        return mix(first[0], first[1], row->fraction);
    }
    const auto plane = off > 0.0 ? c_table_.locate(direction.y / off, direction.x / off)
                                 : c_table_.locate(0.0, 1.0);
    if (!plane) {
        return 0.0;
    }
    first += plane->index * gamma_.size();
    const double* next = first + gamma_.size();
    return mix(mix(first[0], first[1], row->fraction), mix(next[0], next[1], row->fraction),
               plane->fraction);
}

Vec3d CandelaDistribution::sample(double u0, double u1, double u2) const {
    const double scaled = u0 * static_cast<double>(columns_.size());
    const std::size_t i = std::min(static_cast<std::size_t>(scaled), columns_.size() - 1);
    const Column& column = columns_[i];
    const bool below = scaled - static_cast<double>(i) < column.threshold;
    const std::uint32_t cell = below ? column.cell : column.alias;

    const std::size_t k = cell / bands_.size();
    const std::size_t j = cell % bands_.size();
    const GammaBand& band = bands_[j];
    const double* plane = &candela_[k * gamma_.size() + j];
    const double* next = plane + gamma_.size();

    // The flux per radian of C is linear across the cell.
    const double t = invert_linear(plane[0] * band.first_weight + plane[1] * band.last_weight,
                                   next[0] * band.first_weight + next[1] * band.last_weight, u1);
    const Interval& sector = sectors_[k];
    const Point c =
        turned(sector.sin_middle, sector.cos_middle, Series((2.0 * t - 1.0) * sector.half));
    const double x = invert_band(band, mix(plane[0], next[0], t), mix(plane[1], next[1], t), u2);
    const Point gamma = turned(band.sin_middle, band.cos_middle, Series(x));
    return {gamma.sine * c.cosine, gamma.sine * c.sine, -gamma.cosine};
}

// Offset x below which lies the share u of the flux of a band, its intensity linear from `first` to
// `last`: Newton on the closed-form flux, kept inside a shrinking bracket.
double CandelaDistribution::invert_band(const GammaBand& band, double first, double last,
                                        double u) {
    const double mean = 0.5 * (first + last);
    const double slope = 0.5 * (last - first) / band.half;
    const double a = band.sin_middle;
    const double b = band.cos_middle;
    const auto flux_to = [&](const Series& x) { // from the middle
        return mean * (a * x.sine() + b * x.versine()) +
               slope * (a * x.x_cosine() + b * x.x_sine());
    };
    const double target =
        flux_to(Series(-band.half)) + u * (first * band.first_weight + last * band.last_weight);

    double low = -band.half;
    double high = band.half;
    double x = mix(low, high, invert_linear(first * band.sin_first, last * band.sin_last, u));
    for (int i = 0; i < kMaxIterations; ++i) {
        const Series at(x);
        const double excess = flux_to(at) - target;
        (excess > 0.0 ? high : low) = x;
        const double density = (mean + slope * x) * turned(a, b, at).sine;
        double next = density > 0.0 ? x - excess / density : low - 1.0;
        if (!(next >= low && next <= high)) { // also where the density is zero
            next = 0.5 * (low + high);
        }
        const double step = std::abs(next - x);
        x = next;
        if (step <= 1e-4 * band.half) { // Newton has doubled its digits since: 1e-8
            break;
        }
    }
    return x;
}

} // namespace isolux
