#include "core/poisson_interval.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace isolux {
namespace {

// ln(n!) less Stirling's main terms: ln n! = n ln n - n + ln(2 pi n)/2 + this.
double stirling_remainder(double n) {
    if (n < 16.0) {
        return std::lgamma(n + 1.0) - n * std::log(n) + n -
               0.5 * std::log(2.0 * std::numbers::pi * n);
    }
    return 1.0 / (12.0 * n) - 1.0 / (360.0 * n * n * n) + 1.0 / (1260.0 * n * n * n * n * n);
}

// u - ln(1 + u), whose first terms cancel for small u.
double log_excess(double u) {
    if (std::abs(u) < 1e-3) {
        return u * u * (0.5 - u * (1.0 / 3.0 - u * (0.25 - u * 0.2)));
    }
    return u - std::log1p(u);
}

// The root of u - ln(1 + u) = a on the side where the start lies, by Newton: the function is
// convex, so that steps from beyond the root close in on it monotonically.
double solve(double a, double u) {
    for (int i = 0; i < 12; ++i) {
        const double step = (log_excess(u) - a) * (1.0 + u) / u;
        u -= step;
        if (std::abs(step) <= 1e-14 * std::abs(u)) {
            break;
        }
    }
    return u;
}

} // namespace

Interval poisson_interval(std::uint64_t count, IntervalRule rule) {
    const double log_threshold = rule == IntervalRule::paper ? -std::log(0.01) : -std::log(0.05);
    if (count == 0) {
        return {0.0, log_threshold};
    }
    const auto n = static_cast<double>(count);
    // n ln(lambda/n) - (lambda - n) > -c is the condition on lambda = n (1 + u).
    double c = log_threshold - 0.5 * std::log(2.0 * std::numbers::pi * n) - stirling_remainder(n);
    if (rule == IntervalRule::corrected) {
        c = std::max(c, 0.5); // one standard deviation: u - ln(1 + u) = u²/2 + ...
    } else if (c <= 0.0) {
        return {n, 0.0};
    }
    const double s = std::sqrt(2.0 * c / n);
    const double above = solve(c / n, s + s * s / 3.0 + s * s * s / 36.0);
    const double below =
        solve(c / n, s > 1.0 ? std::expm1(-1.0 - c / n) : -s + s * s / 3.0 - s * s * s / 36.0);
    return {n * (1.0 + below), n * (1.0 + above)};
}

IntervalTable::IntervalTable(IntervalRule rule) : rule_(rule), table_(1024) {
    for (std::size_t n = 0; n < table_.size(); ++n) {
        table_[n] = poisson_interval(n, rule);
    }
}

} // namespace isolux
