"""When photons give way to direct lighting [Volevich 2000, §3.3]."""

import pytest

from isolux.switchover import (
    LEAST_PILOT_SECONDS,
    START_ERROR,
    pilot_seconds,
    switchover_photons,
)


def test_the_pilot_takes_a_tenth_of_the_first_iteration_and_long_enough_to_tell():
    assert pilot_seconds(20.0) == pytest.approx(2.0)
    assert pilot_seconds(1e-3) == LEAST_PILOT_SECONDS


@pytest.mark.parametrize(
    ("pilot_error", "first_iteration", "factor"),
    [
        (2 * START_ERROR, 100.0, 4.0),  # half the error takes four times the photons
        (10 * START_ERROR, 30.0, 30.0),  # no longer than direct lighting takes
        (0.5 * START_ERROR, 30.0, 1.0),  # already good enough
        (10 * START_ERROR, 0.1, 1.0),  # the pilot itself was longer than direct lighting
    ],
)
def test_t1_is_when_the_error_is_small_or_direct_lighting_would_be_done(
    pilot_error, first_iteration, factor
):
    assert switchover_photons(50_000, 1.0, pilot_error, first_iteration) == 50_000 * factor
