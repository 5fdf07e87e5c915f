#include "core/luminous_outline.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace isolux {
namespace {

constexpr double kPi = std::numbers::pi;
// Of the distances between a receiver and the points of a circle: series below, where the closed
// form cancels. Their error is this to the third.
constexpr double kRoundCircle = 1e-4;

// Integral of n·(r × dr)/r² over the straight way from a to b.
double segment_integral(const Vec3d& a, const Vec3d& b, const Vec3d& normal) {
    const Vec3d across = cross(a, b);
    const double sine = length(across);
    return sine > 0.0 ? std::atan2(sine, dot(a, b)) / sine * dot(across, normal) : 0.0;
}

// The same over arcs. On the circle r² = a + b cos(phi), and n·(r × dr) is linear in cosine and
// sine.
class ArcIntegral {
  public:
    ArcIntegral(const CircleOfView& circle, const Vec3d& normal)
        : constant_(dot(cross(circle.cosine, circle.sine), normal)),
          cosine_(dot(cross(circle.centre, circle.sine), normal)),
          sine_(-dot(cross(circle.centre, circle.cosine), normal)),
          a_(dot(circle.centre, circle.centre) + dot(circle.cosine, circle.cosine)),
          b_(2.0 * dot(circle.centre, circle.cosine)),
          least_(length(circle.centre - circle.cosine)),
          most_(length(circle.centre + circle.cosine)) {}

    double operator()(double first, double last) const {
        if (std::abs(b_) <= kRoundCircle * a_) {
            return round_to(last) - round_to(first);
        }
        const double of_one = one_to(last) - one_to(first);
        const double of_cosine = (last - first - a_ * of_one) / b_;
        const double of_sine =
            -std::log((a_ + b_ * std::cos(last)) / (a_ + b_ * std::cos(first))) / b_;
        return constant_ * of_one + cosine_ * of_cosine + sine_ * of_sine;
    }

  private:
    // Integral of 1/(a + b cos), continuous in phi.
    double one_to(double phi) const {
        if (least_ * most_ == 0.0) { // the receiver lies on the circle
            return 0.0;
        }
        const double c = std::cos(phi);
        const double turn =
            std::atan2((least_ - most_) * std::sin(phi), most_ * (1.0 + c) + least_ * (1.0 - c));
        return (phi + 2.0 * turn) / (least_ * most_);
    }
    // All three integrals to second order in b/a.
    double round_to(double phi) const {
        const double e = b_ / a_, s = std::sin(phi), c = std::cos(phi);
        const double two = 0.5 * (phi + s * c), three = s - s * s * s / 3.0; // of cos², cos³
        const double of_one = phi - e * s + e * e * two;
        const double of_cosine = s - e * two + e * e * three;
        const double of_sine = -c + e * c * c / 2.0 - e * e * c * c * c / 3.0;
        return (constant_ * of_one + cosine_ * of_cosine + sine_ * of_sine) / a_;
    }

    double constant_, cosine_, sine_, a_, b_;
    double least_, most_; // roots of a - b and a + b, m
};

// The same angle at or above `first`, within a turn.
double unroll(double angle, double first) {
    return angle - 2.0 * kPi * std::floor((angle - first) / (2.0 * kPi));
}

// Angle into [first, last], where it belongs but for rounding.
double into(double angle, double first, double last) {
    const double a = unroll(angle, first);
    return a <= last ? a : (a - last < first + 2.0 * kPi - a ? last : first);
}

} // namespace

Vec3d CircleOfView::at(double phi) const {
    return centre + cosine * std::cos(phi) + sine * std::sin(phi);
}

double LuminousOutline::azimuth(const Vec3d& at) {
    if (!reference_) {
        reference_ = at;
    }
    return std::atan2(dot(cross(*reference_, at), normal_), dot(*reference_, at));
}

void LuminousOutline::add_segment(const Vec3d& from, const Vec3d& to) {
    const double first = dot(from, normal_), last = dot(to, normal_);
    if (first <= 0.0 && last <= 0.0) {
        return;
    }
    Vec3d a = from, b = to;
    if (first <= 0.0) {
        a = from + (to - from) * (first / (first - last));
        rise(a);
    } else if (last <= 0.0) {
        b = to + (from - to) * (last / (last - first));
        fall(b);
    }
    sum_ += segment_integral(a, b, normal_);
}

void LuminousOutline::add_arc(const CircleOfView& circle, double first, double last) {
    const ArcIntegral integral(circle, normal_);
    const double c = dot(circle.cosine, normal_), s = dot(circle.sine, normal_);
    const double swing = std::hypot(c, s), middle = dot(circle.centre, normal_);
    // Above the horizon from top - half to top + half. The ends decide as the pieces that join
    // there do.
    const double top = std::atan2(s, c);
    const double half = swing > 0.0 ? std::acos(std::clamp(-middle / swing, -1.0, 1.0)) : 0.0;
    const bool starts = dot(circle.at(first), normal_) > 0.0;
    const bool ends = dot(circle.at(last), normal_) > 0.0;
    if (starts != ends) {
        if (starts) {
            const double down = into(top + half, first, last);
            fall(circle.at(down));
            sum_ += integral(first, down);
        } else {
            const double up = into(top - half, first, last);
            rise(circle.at(up));
            sum_ += integral(up, last);
        }
        return;
    }
    const double up = unroll(top - half, first), down = unroll(top + half, first);
    const bool crosses = std::abs(middle) < swing && up < last && down < last;
    if (starts && crosses && down < up) {
        fall(circle.at(down));
        rise(circle.at(up));
        sum_ += integral(first, down) + integral(up, last);
    } else if (starts) {
        sum_ += integral(first, last);
    } else if (crosses && up < down) {
        rise(circle.at(up));
        fall(circle.at(down));
        sum_ += integral(up, down);
    }
}

void LuminousOutline::add_circle(const CircleOfView& circle) {
    const ArcIntegral integral(circle, normal_);
    const double c = dot(circle.cosine, normal_), s = dot(circle.sine, normal_);
    const double swing = std::hypot(c, s), middle = dot(circle.centre, normal_);
    if (middle >= swing) {
        sum_ += integral(-kPi, kPi);
    } else if (middle > -swing) {
        const double top = std::atan2(s, c), half = std::acos(-middle / swing);
        rise(circle.at(top - half));
        fall(circle.at(top + half));
        sum_ += integral(top - half, top + half);
    }
}

double LuminousOutline::projected_solid_angle() const { return 0.5 * std::abs(sum_ + horizon_); }

} // namespace isolux
