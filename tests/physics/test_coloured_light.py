"""Colour travels beside photons of equal luminous flux, and each channel obeys its own law.

In a closed room of reflectance ρ_c the mean indirect illuminance of a channel is
ρ_c Φ_c / (S (1 - ρ_c)), whatever the others are.
"""

import numpy as np
import pytest
from usd_scenes.shapes import box

from core_scenes import luminaire, retrace, surface, trace
from isolux.solution import LUMINANCE_WEIGHTS
from validation.rows import INVARIANCE

pytestmark = pytest.mark.validation(INVARIANCE)

SIDE = 4.0  # m
AREA = 6 * SIDE**2
FLUX = 10_000.0  # lm
RUNS, PHOTONS = 16, 20_000


def coloured(rgb):
    """Scaled to luminance 1."""
    return np.array(rgb) / (np.array(rgb) @ LUMINANCE_WEIGHTS)


CASES = {
    "white light on a red wall": ((1, 1, 1), (0.8, 0.3, 0.1)),
    "blue light on a red wall": ((0.2, 0.3, 1.0), (0.7, 0.2, 0.1)),
    "red light on a grey wall": ((1.0, 0.2, 0.1), (0.6, 0.6, 0.6)),
    "green light on a wall without red": ((0.1, 1.0, 0.1), (0.0, 0.5, 0.5)),
}


@pytest.fixture(scope="module", params=CASES.values(), ids=CASES)
def runs(request):
    light, reflectance = request.param
    colour = coloured(light)
    room = surface(box((SIDE,) * 3, 1.0).flipped(), reflectance)
    first = trace([room], [luminaire(FLUX, colour=colour)], PHOTONS)
    return colour, np.array(reflectance), [retrace(first, PHOTONS, s) for s in range(RUNS)]


def means(traced):
    """Direct and indirect (3,), lx by channel."""
    return [np.average(light, axis=0, weights=traced.areas) for light in traced.colours()]


def test_each_channel_is_a_room_of_its_own(validation, request, runs):
    colour, reflectance, traced = runs
    direct, indirect = np.array([means(run) for run in traced]).transpose(1, 0, 2)
    assert direct == pytest.approx(np.tile(FLUX / AREA * colour, (RUNS, 1)), rel=1e-5)
    expected = FLUX / AREA * colour * reflectance / (1 - reflectance)
    sigma = indirect.std(axis=0, ddof=1) / np.sqrt(RUNS)
    validation.check(
        f"{request.node.callspec.id}, mean indirect light by channel, photons",
        *(expected, indirect.mean(axis=0)),
        sigma=sigma,
        absolute=1e-6 * FLUX / AREA,
    )
    assert sigma.max() < 0.02 * expected.max()


def test_the_channels_add_up_to_the_count_of_photons(runs):
    _, _, traced = runs
    for light, counted in zip(traced[0].colours(), traced[0].illuminance.T, strict=True):
        assert light @ LUMINANCE_WEIGHTS == pytest.approx(counted, rel=1e-5)


def test_grey_light_on_grey_walls_stays_grey():
    room = surface(box((SIDE,) * 3, 1.0).flipped(), 0.5)
    traced = trace([room], [luminaire(FLUX)], PHOTONS)
    assert not traced.scene.coloured
    for light, counted in zip(traced.colours(), traced.illuminance.T, strict=True):
        assert np.array_equal(light, np.repeat(light[:, :1], 3, axis=1))
        assert light[:, 0] == pytest.approx(counted, rel=1e-6)
