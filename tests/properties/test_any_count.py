"""The plausible means of any photon count."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from isolux._core import poisson_interval
from scipy.stats import poisson

EXACT = 2**53  # up to it counts are doubles


@given(st.integers(0, EXACT - 1))
def test_the_corrected_interval_holds_the_count_and_rises_with_it(n):
    low, high = poisson_interval(n, paper=False)
    assert 0 <= low <= n <= high < np.inf
    next_low, next_high = poisson_interval(n + 1, paper=False)
    assert low <= next_low and high <= next_high


# From 1592 on there is none; below, the mean that gives the count most often is the count.
@given(st.integers(1, 1591), st.floats(0, 1), st.floats(1e-6, 10))
def test_the_papers_interval_is_all_means_that_give_the_count_more_than_one_percent(n, t, beyond):
    low, high = poisson_interval(n, paper=True)
    assert poisson.pmf(n, low + t * (high - low)) >= 0.01 * (1 - 1e-6)
    assert poisson.pmf(n, high * (1 + beyond)) < 0.01
    assert poisson.pmf(n, low / (1 + beyond)) < 0.01
    assert poisson.pmf(n, low) == pytest.approx(0.01, rel=1e-6)
