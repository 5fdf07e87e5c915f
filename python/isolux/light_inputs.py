"""What lights of every kind have in common: their inputs' values, their brightness and colour."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom, UsdLux

from .errors import SceneError
from .reading_context import ReadingContext, triple


def light_kind(prim: Usd.Prim) -> str:
    """The light's type, or the API that makes a light of a surface."""
    if prim.IsA(UsdGeom.Gprim):
        applied = prim.GetPrimTypeInfo().GetAppliedAPISchemas()
        return next(
            (api for api in ("MeshLightAPI", "VolumeLightAPI") if api in applied), "LightAPI"
        )
    return str(prim.GetTypeName()) or "LightAPI"


def number(prim: Usd.Prim, name: str, default: float, context: ReadingContext) -> float:
    """A float input; raises SceneError where it is NaN or infinite."""
    value = float(context.value(prim, name, default))
    if not np.isfinite(value):
        raise SceneError(str(prim.GetPath()), f"{name} = {value}", "a finite number")
    return value


def channels(
    prim: Usd.Prim, name: str, default: tuple[float, float, float], context: ReadingContext
) -> NDArray[np.float64]:
    """(3,) float64, a colour input; raises SceneError where a channel is negative or no number."""
    colour = np.array(context.value(prim, name, default), float)
    if not np.isfinite(colour).all() or (colour < 0).any():
        raise SceneError(str(prim.GetPath()), f"{name} = {triple(colour)}", "channels of 0 or more")
    return colour


def read_colour(prim: Usd.Prim, context: ReadingContext) -> NDArray[np.float64]:
    """(3,) float64 colour × blackbody, linear Rec. 709, not normalised."""
    colour = channels(prim, "inputs:color", (1, 1, 1), context)
    if context.value(prim, "inputs:enableColorTemperature", False):
        temperature = number(prim, "inputs:colorTemperature", 6500.0, context)
        colour = colour * np.array(UsdLux.BlackbodyTemperatureAsRgb(temperature))
    return colour


def in_single_precision(
    prim: Usd.Prim, luminance: NDArray[np.float64], found: str
) -> NDArray[np.float32]:
    """A luminance as light is solved for; raises SceneError where it overflows there."""
    single = luminance.astype(np.float32)
    if not np.isfinite(single).all():
        raise SceneError(str(prim.GetPath()), found, "a luminance of at most 3.4e38 cd/m^2")
    return single


def read_luminance(
    prim: Usd.Prim, colour: NDArray[np.float64], context: ReadingContext
) -> NDArray[np.float64]:
    """(3,) float64, cd/m² by channel: intensity · 2^exposure · colour, before `normalize`.

    Raises SceneError where it overflows as light is solved for.
    """
    intensity = number(prim, "inputs:intensity", 1.0, context)
    exposure = number(prim, "inputs:exposure", 0.0, context)
    luminance = intensity * np.exp2(exposure) * colour
    in_single_precision(prim, luminance, f"intensity {intensity:g}, exposure {exposure:g}")
    return luminance
