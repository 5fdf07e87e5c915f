"""displayColor: luminances as a display is to show them, linear Rec. 709 in [0, 1].

USD takes displayColor to be linear. A stock Hydra encodes it for an sRGB display and does nothing
else to it, so what is stored is the display's light: through the Tumblin-Rushmeier operator
[Volevich 2000, §6], or through a view of the OpenColorIO configuration with the encoding of its
display undone. A viewer that lays a view of its own over that shows it twice: choose none there.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ._core import tone_map
from .settings import TUMBLIN_RUSHMEIER, SolverSettings

if TYPE_CHECKING:
    from .ocio_view import OcioView

# (n, 3) float32 luminance, cd/m² by channel, to (n, 3) float32 displayColor.
Display = Callable[[NDArray[np.float32]], NDArray[np.float32]]


class DisplayView:
    """A view, for every state of adaptation.

    name : "tumblin-rushmeier", or "DISPLAY/VIEW" of the OpenColorIO configuration in the
        environment variable OCIO, else of OpenColorIO's built-in one (ACES)
    adaptation : luminance to which the viewer is adapted, cd/m^2; 0: what `adapted_to` is given
    hold : the first that `adapted_to` is given, so that a lamp which is dimmed over the frames of a
        shot looks dimmer
    raises : SettingsError for a name that is none of these, or a configuration that can't be used
    """

    def __init__(
        self, name: str = TUMBLIN_RUSHMEIER, adaptation: float = 0.0, hold: bool = False
    ) -> None:
        self._adaptation = adaptation
        self._hold = hold
        self._ocio: OcioView | None = None
        if name != TUMBLIN_RUSHMEIER:
            from .ocio_view import OcioView  # it takes 0.1 s to load

            self._ocio = OcioView(name)

    @classmethod
    def of(cls, settings: SolverSettings, hold: bool = False) -> DisplayView:
        return cls(settings.display_view, settings.display_adaptation, hold)

    def adapted_to(self, log_average: float) -> Display:
        """The view for a scene whose lit surfaces have this log-average luminance, cd/m^2."""
        adaptation = self._adaptation or log_average
        if self._hold:
            self._adaptation = adaptation
        ocio = self._ocio
        if ocio is None:
            return lambda luminance: tone_map(luminance, adaptation)
        if adaptation == 0.0:  # nothing is lit
            return np.zeros_like
        return lambda luminance: ocio.colours(luminance, adaptation)
