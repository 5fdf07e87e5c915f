"""Plausible means of a photon count, against the Poisson distribution itself."""

import numpy as np
import pytest
from isolux._core import poisson_interval
from scipy.optimize import brentq
from scipy.stats import poisson

EPSILON = 0.01
CORRECTED_EPSILON = 0.05


@pytest.mark.parametrize(
    ("n", "low", "high"),
    [
        (0, 0.0, 4.6052),
        (1, 0.010102, 6.472775),
        (5, 1.361832, 12.410321),
        (10, 4.466251, 18.883804),
        (100, 84.278641, 117.564544),
        (400, 376.958288, 423.962064),
    ],
)
def test_known_intervals_of_the_paper_rule(n, low, high):
    assert poisson_interval(n, paper=True) == pytest.approx(
        (low, high), abs=5e-5 if n == 0 else 1e-6
    )


@pytest.mark.parametrize("n", [0, 1, 2, 3, 7, 15, 16, 17, 40, 150, 399, 1000, 1500])
def test_the_paper_rule_by_search(n):
    """All λ under which n has more than probability 1 %."""

    def excess(mean):
        return poisson.pmf(n, mean) - EPSILON

    low = brentq(excess, 1e-9, n) if n > 0 else 0.0
    high = brentq(excess, max(n, 1e-9), 10 * n + 10)
    assert poisson_interval(n, paper=True) == pytest.approx((low, high), rel=1e-7)


def test_the_paper_rule_leaves_nothing_from_1592_photons_on():
    """No mean gives the count more than probability 1 % any longer."""
    assert poisson.pmf(1591, 1591) > EPSILON > poisson.pmf(1592, 1592)
    low, high = poisson_interval(1591, paper=True)
    assert low < 1591 < high
    for n in (1592, 10_000, 10**9):
        low, high = poisson_interval(n, paper=True)
        assert low > high


@pytest.mark.parametrize("n", [0, 1, 2, 5, 10, 20])
def test_the_corrected_rule_is_the_papers_at_5_percent_for_small_counts(n):
    for end in poisson_interval(n, paper=False):
        if end > 0:
            assert poisson.pmf(n, end) == pytest.approx(CORRECTED_EPSILON, rel=1e-6)


COUNTS = [*range(200), *np.unique(np.geomspace(200, 1e9, 60).astype(int)).tolist()]


def test_the_corrected_rule_is_never_narrower_than_a_standard_deviation():
    for n in COUNTS[1:]:
        low, high = poisson_interval(n, paper=False)
        # The likelihood falls by e^-½ at one deviation: ±√n + 1/3 to the second order.
        assert low <= n - np.sqrt(n) + 1 / 3 + 0.05 / np.sqrt(n), n
        assert high >= n + np.sqrt(n) + 1 / 3 - 0.05 / np.sqrt(n), n


def test_the_corrected_rule_tends_to_one_standard_deviation():
    for n in (10**4, 10**6, 10**9):
        low, high = poisson_interval(n, paper=False)
        deviations = (np.array([low, high]) - n) / np.sqrt(n)
        assert deviations == pytest.approx([-1, 1], abs=0.4 / np.sqrt(n))


def test_the_corrected_rule_contains_the_count_and_rises_with_it():
    low, high = np.array([poisson_interval(n, paper=False) for n in COUNTS]).T
    assert np.isfinite(high).all()
    assert (low <= COUNTS).all()
    assert (high >= COUNTS).all()
    assert (np.diff(low) > 0)[1:].all()
    assert (np.diff(high) > 0).all()


@pytest.mark.parametrize("paper", [True, False])
def test_series_and_table_join_without_a_step(paper):
    """n = 16: another form of ln n!. n = 1024: past the filter's table. |u| = 10⁻³: a series."""
    first, last = 10, 1500
    ends = np.array([poisson_interval(n, paper) for n in range(first, last)])
    second_differences = np.diff(ends, 2, axis=0)
    bend = np.abs(second_differences) * np.arange(first + 1, last - 1)[:, None] ** 1.5
    # Where the corrected rule takes over, at n = 24, its width has a kink.
    smooth = np.arange(first + 1, last - 1) > 30
    if paper:  # near its end the interval closes like a root
        smooth &= np.arange(first + 1, last - 1) < 1000
    assert bend[smooth].max() < 3
