"""The display looks as bright as the scene [Tumblin and Rushmeier 1993]."""

import math

import numpy as np
import pytest
from isolux._core import adaptation_luminance, dark_luminance, tone_map


def display_value(luminance, adaptation):
    grey = np.full((1, 3), luminance, np.float32)
    return float(tone_map(grey, adaptation)[0, 0])


def brightness(luminance, adaptation):
    """In brils; the published fit, with luminances in lamberts."""
    log_adaptation = math.log10(math.pi * 1e-4 * adaptation)
    alpha = 0.4 * log_adaptation + 2.92
    beta = -0.4 * log_adaptation**2 - 2.584 * log_adaptation + 2.0208
    return 10**beta * (math.pi * 1e-4 * luminance) ** alpha


def test_the_brightness_used_as_truth_here_has_its_published_value():
    assert brightness(100.0, 100.0) == pytest.approx(32.80, abs=0.005)


def test_a_scene_as_bright_as_the_display_shows_its_own_luminance_less_the_black():
    # An observer of a display of 100 cd/m^2 and contrast 100 is adapted to 10 cd/m^2.
    assert display_value(10.0, 10.0) == pytest.approx(0.09, abs=1e-6)


@pytest.mark.parametrize("adaptation", [0.1, 3.0, 10.0, 50.0, 1000.0])
@pytest.mark.parametrize("contrast", [0.5, 1.0, 2.0])
def test_the_display_is_as_bright_as_the_scene(adaptation, contrast):
    luminance = adaptation * contrast
    shown = 100.0 * (display_value(luminance, adaptation) + 0.01)  # cd/m^2, black included
    assert brightness(shown, 10.0) == pytest.approx(brightness(luminance, adaptation), rel=1e-4)


@pytest.mark.parametrize("adaptation", [0.0, 1e-3, 1.0, 30.0, 1e5])
def test_the_darkest_luminance_is_the_first_step_above_black(adaptation):
    dark = dark_luminance(adaptation)
    after_gamma = display_value(dark, adaptation) ** (1 / 2.2)
    assert after_gamma == pytest.approx(1 / 255, rel=2e-3)
    assert display_value(0.99 * dark, adaptation) == 0.0
    assert display_value(1.1 * dark, adaptation) ** (1 / 2.2) > 1 / 255


@pytest.mark.parametrize("adaptation", [0.0, 1e-3, 1.0, 30.0, 1e5, 1e12])
def test_the_table_of_many_values_shows_what_each_alone_would(adaptation):
    luminance = np.geomspace(1e-12, 1e13, 100_001)
    grey = np.repeat(luminance.astype(np.float32)[:, None], 3, axis=1)
    together = tone_map(grey, adaptation)
    # Too few at a time for a table.
    alone = np.concatenate([tone_map(some, adaptation) for some in np.array_split(grey, 50)])
    assert together == pytest.approx(alone, abs=1e-5)
    assert np.all(np.diff(together[:, 0]) >= -1e-6)
    assert together[0].tolist() == [0, 0, 0] and together[-1].tolist() == [1, 1, 1]


def test_colour_keeps_its_chromaticity_and_is_clamped_only_at_the_top():
    colours = np.array([[4.0, 2.0, 1.0], [0.0, 5.0, 0.0], [0.0, 0.0, 0.0]], np.float32)
    shown = tone_map(colours, 5.0)
    assert shown[0] / shown[0, 2] == pytest.approx([4.0, 2.0, 1.0], rel=1e-5)
    assert shown[1, [0, 2]].tolist() == [0.0, 0.0]
    assert shown[2].tolist() == [0.0, 0.0, 0.0]
    assert tone_map(np.array([[1e6, 1.0, 0.0]], np.float32), 5.0)[0, 0] == 1.0


def test_an_observer_adapts_to_the_area_weighted_log_average_of_what_is_lit():
    luminance = np.array([1.0, 100.0, 0.0])
    assert adaptation_luminance(luminance, np.array([1.0, 1.0, 50.0])) == pytest.approx(10.0)
    assert adaptation_luminance(luminance, np.array([3.0, 1.0, 50.0])) == pytest.approx(10**0.5)
    assert adaptation_luminance(np.zeros(3), np.ones(3)) == 0.0


@pytest.mark.parametrize("luminance", [3.0, 10.0, 30.0, 100.0, 300.0])
def test_an_evenly_lit_room_is_shown_in_mid_tones(luminance):
    adaptation = adaptation_luminance(np.full(4, luminance), np.ones(4))
    shown = display_value(luminance, adaptation) ** (1 / 2.2)
    assert 0.25 < shown < 0.55
    assert display_value(luminance, adaptation * 10**0.84) ** (1 / 2.2) < 0.1


def test_lengths_that_differ_are_refused():
    with pytest.raises(ValueError, match="length"):
        adaptation_luminance(np.ones(3), np.ones(2))
