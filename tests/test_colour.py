"""Exposure by the meter's definition, and colours as the display is to show them."""

import numpy as np
import PyOpenColorIO
import pytest

from isolux.colour import (
    display_colours,
    exposure_value,
    log_average_exposure,
    middle_grey_luminance,
)
from isolux.errors import SettingsError


def grey(*luminances):
    return np.repeat(np.array(luminances, np.float32)[:, None], 3, axis=1)


@pytest.mark.parametrize(
    ("exposure", "luminance"),
    # ISO 2720: L = 2^EV K / S with K = 12.5 cd s / m^2 at ISO 100; 4096 cd/m^2 is a sunlit day.
    [(0.0, 0.125), (3.0, 1.0), (15.0, 4096.0), (-2.0, 0.03125)],
)
def test_exposure_value_is_that_of_a_reflected_light_meter(exposure, luminance):
    assert middle_grey_luminance(exposure) == pytest.approx(luminance)
    assert exposure_value(luminance) == pytest.approx(exposure)


def test_the_log_average_of_two_greys_is_their_geometric_mean():
    # Shown one stop above middle grey.
    exposure = log_average_exposure(grey(2.0, 8.0), np.ones(2, np.float32))
    assert middle_grey_luminance(exposure + 1.0) == pytest.approx(4.0)


def test_exposure_ignores_background_dark_slits_and_lamps():
    room = np.full(100, 20.0)
    room[0], room[1] = 1e-6, 1e6
    picture = grey(*room, *np.zeros(300))
    coverage = np.repeat(np.array([1.0, 0.0], np.float32), [100, 300])
    exposure = log_average_exposure(picture, coverage)
    assert middle_grey_luminance(exposure + 1.0) == pytest.approx(20.0)


def test_a_half_covered_pixel_counts_as_bright_as_its_surface():
    exposure = log_average_exposure(grey(5.0, 10.0), np.array([0.5, 1.0], np.float32))
    assert middle_grey_luminance(exposure + 1.0) == pytest.approx(10.0)


def test_a_picture_without_light_has_an_exposure_all_the_same():
    assert log_average_exposure(grey(0.0), np.zeros(1, np.float32)) == 0.0


def test_middle_grey_is_shown_as_the_output_transform_defines_it():
    # ACES 2.0: scene-linear 0.18 is 10 nits on a display of 100, 0.1 of its white.
    srgb = 1.055 * 0.1 ** (1 / 2.4) - 0.055
    shown = display_colours(grey(50.0)[None], exposure_value(50.0))
    assert shown == pytest.approx(np.full((1, 1, 3), 255 * srgb), abs=1)


def test_brighter_is_shown_brighter_and_red_stays_red():
    steps = display_colours(grey(*np.geomspace(0.5, 500.0, 12))[None], exposure_value(20.0))[0]
    assert (np.diff(steps[:, 0].astype(int)) > 0).all()
    assert (np.ptp(steps, axis=1) <= 1).all()
    red, green, blue = display_colours(np.array([[[30.0, 2.0, 2.0]]]), exposure_value(20.0))[0, 0]
    assert red > 2 * max(green, blue)


def test_the_studios_own_configuration_is_used(tmp_path, monkeypatch):
    config = PyOpenColorIO.Config.CreateFromBuiltinConfig("cg-config-v2.1.0_aces-v1.3_ocio-v2.3")
    config.setActiveViews("Un-tone-mapped")
    studio = tmp_path / "config.ocio"
    studio.write_text(config.serialize())
    monkeypatch.setenv("OCIO", str(studio))
    srgb = 1.055 * 0.18 ** (1 / 2.4) - 0.055
    shown = display_colours(grey(50.0)[None], exposure_value(50.0))
    assert shown == pytest.approx(np.full((1, 1, 3), 255 * srgb), abs=1)


def test_a_configuration_that_is_none_is_named(tmp_path, monkeypatch):
    monkeypatch.setenv("OCIO", str(tmp_path / "missing.ocio"))
    with pytest.raises(SettingsError, match=r"OCIO.*missing\.ocio"):
        display_colours(grey(50.0)[None], 0.0)
