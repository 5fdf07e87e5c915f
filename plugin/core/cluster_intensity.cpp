#include "core/cluster_intensity.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace isolux {
namespace {

// Directions on each side of a bin that are looked at.
constexpr int kFinePerBin = 4;
// And so many beyond it for the most.
constexpr int kAround = 2;
constexpr int kFineSide = ClusterIntensity::kSide * kFinePerBin;

double sign(double a) { return a < 0.0 ? -1.0 : 1.0; }

// The octahedron, unfolded to [-1, 1]² [Cigolle et al. 2014].
Vec3d unfolded(double u, double v) {
    const double z = 1.0 - std::abs(u) - std::abs(v);
    return z >= 0.0 ? Vec3d{u, v, z}
                    : Vec3d{(1.0 - std::abs(v)) * sign(u), (1.0 - std::abs(u)) * sign(v), z};
}

// Of the fine directions, also beyond an edge of the unfolded octahedron by less than its side.
int fine_index(int x, int y) {
    const auto wrap = [](int& a, int& b) {
        if (a < 0 || a >= kFineSide) {
            a = a < 0 ? -1 - a : 2 * kFineSide - 1 - a;
            b = kFineSide - 1 - b;
        }
    };
    wrap(x, y);
    wrap(y, x);
    return y * kFineSide + x;
}

} // namespace

ClusterIntensity::ClusterIntensity(const LuminaireIlluminance& luminaire)
    : fine_(kFineSide * kFineSide), weights_(kSide * kSide) {
    const double even = LuminaireIlluminance::kEvenIntensity * luminaire.luminaire().luminous_flux;
    std::ranges::fill(weights_, static_cast<float>(even));
    const auto weight = [this](int i) -> float& {
        return weights_[i / kFineSide / kFinePerBin * kSide + i % kFineSide / kFinePerBin];
    };
    for (int i = 0; i < kFineSide * kFineSide; ++i) {
        const auto middle = [](int k) { return (2.0 * k + 1.0) / kFineSide - 1.0; };
        fine_[i].intensity = static_cast<float>(
            luminaire.intensity(-unfolded(middle(i % kFineSide), middle(i / kFineSide))));
        weight(i) += fine_[i].intensity / (kFinePerBin * kFinePerBin);
    }
    for (int i = 0; i < kFineSide * kFineSide; ++i) {
        fine_[i].most = fine_[i].intensity / weight(i);
        fine_[i].squares = fine_[i].intensity * fine_[i].most;
    }
}

ClusterIntensity::ClusterIntensity(const ClusterIntensity& a, const ClusterIntensity& b)
    : fine_(a.fine_), weights_(a.weights_) {
    for (std::size_t i = 0; i < weights_.size(); ++i) {
        weights_[i] += b.weights_[i];
    }
    for (std::size_t i = 0; i < fine_.size(); ++i) {
        fine_[i].intensity += b.fine_[i].intensity;
        fine_[i].squares += b.fine_[i].squares;
        fine_[i].most = std::max(fine_[i].most, b.fine_[i].most);
    }
}

void ClusterIntensity::settle() {
    bins_.resize(kSide * kSide);
    constexpr double kCount = kFinePerBin * kFinePerBin;
    for (int bin = 0; bin < kSide * kSide; ++bin) {
        const double weight = weights_[bin];
        double sum = 0.0, squared = 0.0, between = 0.0, most = 0.0;
        for (int y = -kAround; y < kFinePerBin + kAround; ++y) {
            for (int x = -kAround; x < kFinePerBin + kAround; ++x) {
                const Fine& f =
                    fine_[fine_index(bin % kSide * kFinePerBin + x, bin / kSide * kFinePerBin + y)];
                most = std::max(most, weight * f.most);
                if (std::min(x, y) >= 0 && std::max(x, y) < kFinePerBin) {
                    const double mean = f.intensity;
                    sum += mean;
                    squared += mean * mean;
                    between += std::max(0.0, weight * f.squares - mean * mean);
                }
            }
        }
        bins_[bin].most = static_cast<float>(most);
        if (sum > 0.0) {
            const double mean = sum / kCount, relative = 1.0 / (kCount * mean * mean);
            bins_[bin] = {static_cast<float>(mean), static_cast<float>(most),
                          static_cast<float>(between * relative),
                          static_cast<float>(std::max(0.0, squared * relative - 1.0))};
        }
    }
    fine_ = std::vector<Fine>(); // braces alone would keep the memory
    weights_ = std::vector<float>();
}

int ClusterIntensity::bin(const Vec3d& d) {
    const double size =
        std::max(std::numeric_limits<double>::min(), std::abs(d.x) + std::abs(d.y) + std::abs(d.z));
    double u = d.x / size, v = d.y / size;
    if (d.z < 0.0) {
        const double folded = (1.0 - std::abs(v)) * sign(u);
        v = (1.0 - std::abs(u)) * sign(v);
        u = folded;
    }
    const auto place = [](double a) { // the last for NaN
        constexpr double kHalf = 0.5 * kSide;
        return static_cast<int>(std::max(0.0, std::min(2.0 * kHalf - 1.0, (a + 1.0) * kHalf)));
    };
    return place(v) * kSide + place(u);
}

} // namespace isolux
