"""displayColor: luminances as a display is to show them, linear Rec. 709 in [0, 1].

USD takes displayColor to be linear. A stock Hydra encodes it for an sRGB display and does nothing
else to it, so what is stored is the display's light: through the Tumblin-Rushmeier operator
[Volevich 2000, §6], or through a view of the OpenColorIO configuration with the encoding of its
display undone. A viewer that lays a view of its own over that shows it twice: choose none there.
"""

from __future__ import annotations

import os
from collections.abc import Callable

import numpy as np
import PyOpenColorIO as Ocio
from numpy.typing import NDArray

from ._core import tone_map
from .colour import MIDDLE_GREY, adapted_exposure, middle_grey_luminance
from .errors import SettingsError
from .settings import TUMBLIN_RUSHMEIER, SolverSettings

# (n, 3) float32 luminance, cd/m² by channel, to (n, 3) float32 displayColor.
Display = Callable[[NDArray[np.float32]], NDArray[np.float32]]

_LINEAR_REC709 = "lin_rec709"  # the built-in configuration's name of it
_SCENE_INTERCHANGE = "aces_interchange"
_DISPLAY_INTERCHANGE = "cie_xyz_d65_interchange"
_BUILTIN = "ocio://default"


class DisplayView:
    """A view, for every state of adaptation.

    name : "tumblin-rushmeier", or "DISPLAY/VIEW" of the OpenColorIO configuration in the
        environment variable OCIO, else of OpenColorIO's built-in one (ACES)
    adaptation : luminance to which the viewer is adapted, cd/m^2; 0: what `adapted_to` is given
    raises : SettingsError for a name that is none of these, or a configuration that can't be used
    """

    def __init__(self, name: str = TUMBLIN_RUSHMEIER, adaptation: float = 0.0) -> None:
        self._adaptation = adaptation
        self._to_display = None
        if name != TUMBLIN_RUSHMEIER:
            self._to_display = [step.getDefaultCPUProcessor() for step in _ocio_view(name)]

    @classmethod
    def of(cls, settings: SolverSettings) -> DisplayView:
        return cls(settings.display_view, settings.display_adaptation)

    def adapted_to(self, log_average: float) -> Display:
        """The view for a scene whose lit surfaces have this log-average luminance, cd/m^2.

        An OpenColorIO view gets the scene at the exposure that shows the luminance of adaptation
        one stop above middle grey, as pictures of `isolux render` are exposed.
        """
        adaptation = self._adaptation or log_average
        if self._to_display is None:
            return lambda luminance: tone_map(luminance, adaptation)
        if adaptation == 0.0:  # nothing is lit
            return np.zeros_like
        scale = np.float32(MIDDLE_GREY / middle_grey_luminance(adapted_exposure(adaptation)))
        to_display = self._to_display

        def display(luminance: NDArray[np.float32]) -> NDArray[np.float32]:
            colours = np.ascontiguousarray(luminance * scale, np.float32)
            for step in to_display:
                step.applyRGB(colours)
            return np.clip(colours, 0.0, 1.0, out=colours)

        return display


def require_view(name: str) -> None:
    """Raise SettingsError where `DisplayView` would."""
    if name != TUMBLIN_RUSHMEIER:
        _ocio_view(name)


def _ocio_view(name: str) -> list[Ocio.Processor]:
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
