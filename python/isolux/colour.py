"""From luminance to what a display shows: exposure, then an OpenColorIO display transform.

The transform is the default view of the default display of the OpenColorIO configuration in the
environment variable OCIO, else of OpenColorIO's built-in one (sRGB, ACES output transform).
"""

from __future__ import annotations

import os

import numpy as np
import PyOpenColorIO
from numpy.typing import NDArray

from .errors import SettingsError
from .solution import LUMINANCE_WEIGHTS

# Scene-linear value of middle grey: what the exposure maps its luminance to.
MIDDLE_GREY = 0.18

# Luminance that a meter calls EV 0 at ISO 100, cd/m^2 (ISO 2720, K = 12.5 cd s / m^2).
_EV0_LUMINANCE = 0.125

# How far the average of a lit room stands above middle grey, EV: white walls and ceilings make it
# brighter than the average that a meter assumes.
_ROOM_ABOVE_GREY = 1.0

# Share of the pixels left out of the log-average at each end: visible lamps, dark slits.
_TRIMMED = 0.02

# The built-in configuration's name of the primaries in which Isolux computes.
_LINEAR_REC709 = "lin_rec709"
_INTERCHANGE = "aces_interchange"


def exposure_value(luminance: float) -> float:
    """EV at ISO 100 at which `luminance` (cd/m²) becomes middle grey."""
    return float(np.log2(luminance / _EV0_LUMINANCE))


def middle_grey_luminance(exposure: float) -> float:
    """Luminance that becomes middle grey at the EV `exposure`, cd/m²."""
    return float(_EV0_LUMINANCE * 2.0**exposure)


def log_average_exposure(rgb: NDArray[np.float32], coverage: NDArray[np.float32]) -> float:
    """EV that shows the log-average luminance of the lit pixels one stop above middle grey.

    rgb : (..., 3) float32, cd/m² by channel, weighted by coverage
    coverage : (...) float32, share of each pixel that shows a surface
    returns : EV; 0 for a picture without any light
    """
    luminance = rgb.reshape(-1, 3) @ LUMINANCE_WEIGHTS
    lit = luminance > 0
    if not lit.any():
        return 0.0
    logarithms = np.sort(np.log(luminance[lit] / coverage.reshape(-1)[lit]))
    trimmed = int(_TRIMMED * len(logarithms))
    middle = logarithms[trimmed : len(logarithms) - trimmed]
    return adapted_exposure(float(np.exp(middle.mean())))


def adapted_exposure(log_average: float) -> float:
    """EV that shows a room's log-average luminance (cd/m²) one stop above middle grey."""
    return exposure_value(log_average) - _ROOM_ABOVE_GREY


def display_colours(rgb: NDArray[np.float32], exposure: float) -> NDArray[np.uint8]:
    """Colours for the display.

    rgb : (H, W, 3) float32, cd/m² by channel, linear Rec. 709
    exposure : EV at ISO 100
    returns : (H, W, 3) uint8, encoded for the display
    raises : SettingsError where the configuration in OCIO can't be used
    """
    scene_linear = np.ascontiguousarray(rgb, np.float32) * np.float32(
        MIDDLE_GREY / middle_grey_luminance(exposure)
    )
    try:
        builtin = PyOpenColorIO.Config.CreateFromFile("ocio://default")
        to_aces = builtin.getProcessor(_LINEAR_REC709, _INTERCHANGE)
        to_aces.getDefaultCPUProcessor().applyRGB(scene_linear)
        _aces_to_display(builtin).getDefaultCPUProcessor().applyRGB(scene_linear)
    except (PyOpenColorIO.Exception, PyOpenColorIO.ExceptionMissingFile) as error:
        wanted = "an OpenColorIO configuration with the role aces_interchange and a display"
        raise SettingsError("OCIO", str(error), wanted) from error
    return np.rint(255 * np.clip(scene_linear, 0.0, 1.0)).astype(np.uint8)


def _aces_to_display(builtin: PyOpenColorIO.Config) -> PyOpenColorIO.Processor:
    chosen = os.environ.get("OCIO")
    config = PyOpenColorIO.Config.CreateFromFile(chosen) if chosen else builtin
    display = config.getDefaultDisplay()
    view = config.getDefaultView(display)
    return config.getProcessor(_INTERCHANGE, display, view, PyOpenColorIO.TRANSFORM_DIR_FORWARD)
