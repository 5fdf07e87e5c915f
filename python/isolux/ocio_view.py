"""A view of an OpenColorIO configuration, as the light that a display gives: linear Rec. 709.

The configuration is that of the environment variable OCIO, else OpenColorIO's built-in one (ACES).
"""

from __future__ import annotations

import os

import numpy as np
import PyOpenColorIO as Ocio
from numpy.typing import NDArray

from .colour import MIDDLE_GREY, adapted_exposure, middle_grey_luminance
from .errors import SettingsError
from .settings import TUMBLIN_RUSHMEIER

_LINEAR_REC709 = "lin_rec709"  # the built-in configuration's name of it
_SCENE_INTERCHANGE = "aces_interchange"
_DISPLAY_INTERCHANGE = "cie_xyz_d65_interchange"
_BUILTIN = "ocio://default"


class OcioView:
    """A view with the encoding of its display undone.

    name : "DISPLAY/VIEW"
    raises : SettingsError where the configuration has no such view or can't be used
    """

    def __init__(self, name: str) -> None:
        self._steps = [step.getDefaultCPUProcessor() for step in view_steps(name)]

    def colours(self, luminance: NDArray[np.float32], adaptation: float) -> NDArray[np.float32]:
        """Colours in [0, 1]; those beyond the display's white or gamut are clamped.

        The scene is exposed so that the luminance of adaptation, a log-average, comes out one stop
        above middle grey, as pictures of `isolux render` are.

        luminance : (n, 3) float32, cd/m^2 by channel
        adaptation : cd/m^2, > 0
        """
        scale = MIDDLE_GREY / middle_grey_luminance(adapted_exposure(adaptation))
        colours = np.multiply(luminance, np.float32(scale), dtype=np.float32, order="C")
        for step in self._steps:
            step.applyRGB(colours)
        return np.clip(colours, 0.0, 1.0, out=colours)


def view_steps(name: str) -> list[Ocio.Processor]:
    """Steps from scene-linear Rec. 709 to linear Rec. 709 of the display."""
    wanted = f"an OpenColorIO configuration with the role {_SCENE_INTERCHANGE}"
    try:
        builtin = Ocio.Config.CreateFromFile(_BUILTIN)
        chosen = os.environ.get("OCIO")
        config = Ocio.Config.CreateFromFile(chosen) if chosen else builtin
        views = {
            f"{display}/{view}": (display, view)
            for display in config.getDisplays()
            for view in config.getViews(display)
        }
        if name not in views:
            known = ", ".join(f'"{known}"' for known in (TUMBLIN_RUSHMEIER, *views))
            raise SettingsError("display_view", repr(name), f"one of {known}")
        display, view = views[name]
        return [
            builtin.getProcessor(_LINEAR_REC709, _SCENE_INTERCHANGE),
            config.getProcessor(_SCENE_INTERCHANGE, display, view, Ocio.TRANSFORM_DIR_FORWARD),
            *_light_of_display(config, display, view),
        ]
    except (Ocio.Exception, Ocio.ExceptionMissingFile) as error:
        raise SettingsError("OCIO", str(error), wanted) from error


def _light_of_display(config: Ocio.Config, display: str, view: str) -> list[Ocio.Processor]:
    """From the display's code values to its light.

    A view of older configurations, or of raw values, does not tell which display it is made for:
    then sRGB.
    """
    srgb = Ocio.BuiltinTransform("DISPLAY - CIE-XYZ-D65_to_sRGB")
    decoded = Ocio.GroupTransform()
    space_name = config.getDisplayViewColorSpaceName(display, view)
    space = config.getColorSpace(display if space_name == "<USE_DISPLAY_NAME>" else space_name)
    steps = []
    if space and space.getReferenceSpaceType() == Ocio.REFERENCE_SPACE_DISPLAY:
        steps.append(config.getProcessor(space.getName(), _DISPLAY_INTERCHANGE))
        decoded.appendTransform(srgb)
    # IEC 61966-2-1.
    decoded.appendTransform(
        Ocio.ExponentWithLinearTransform(
            gamma=[2.4, 2.4, 2.4, 1.0],
            offset=[0.055, 0.055, 0.055, 0.0],
            negativeStyle=Ocio.NEGATIVE_LINEAR,
        )
    )
    return [*steps, config.getProcessor(decoded)]
