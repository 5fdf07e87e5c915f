"""Colours of named spaces in the working space, linear Rec. 709.

A name is looked up in the OpenColorIO configuration of the environment variable OCIO, else in the
built-in ACES one, which knows USD's own names (lin_ap1_scene, srgb_p3d65_scene, ...).
"""

from __future__ import annotations

import os
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import PyOpenColorIO

CLIPPED = "colours outside of Rec. 709 are clipped to it"
WORKING_SPACE = "lin_rec709_scene"
_LINEAR = ("", WORKING_SPACE, "lin_rec709", "lin_srgb", "auto")
_SRGB = ("srgb", "srgb_texture", "srgb_rec709_scene")
# What a matrix there and back may be off by.
_ROUNDING = 1e-3
# Numbers that are no colours [UsdColorSpaceAPI: data, raw, identity, unknown].
_NO_COLOUR = ("raw", "data", "identity", "unknown", "none")


class UnknownColourSpaceError(ValueError):
    """A name that no configuration knows."""


def to_linear_rec709(values: NDArray[np.floating], space: str) -> tuple[NDArray[np.floating], bool]:
    """Colours of the space that `space` names, as linear Rec. 709.

    values : (..., 3), in [0, 1] where `space` is encoded for displays
    returns : the same shape, and whether some were colours outside of Rec. 709: those are
        clipped to it
    Raises UnknownColourSpaceError.
    """
    name = space.lower()
    if name in _LINEAR or name in _NO_COLOUR:
        return values, False
    if name in _SRGB:
        return srgb_to_linear(values), False
    processor = _processor(space, os.environ.get("OCIO", ""))
    if isinstance(processor, str):
        raise UnknownColourSpaceError(processor)
    colours = np.array(values, np.float32, order="C")
    processor.applyRGB(colours.reshape(-1, 3))
    # Light may be brighter than 1, a reflectance of the gamut's edge may not become so.
    highest = np.where(values.max(axis=-1, keepdims=True) <= 1, np.float32(1), np.float32(np.inf))
    clipped = np.clip(colours, 0, highest)
    return clipped, bool((np.abs(clipped - colours) > _ROUNDING).any())


def colour_space_fault(space: str) -> str | None:
    """Why a name can't be used; None where it can."""
    try:
        to_linear_rec709(np.zeros((1, 3), np.float32), space)
    except UnknownColourSpaceError as error:
        return str(error)
    return None


def is_by_channel(space: str) -> bool:
    """Whether each channel is converted by itself, whatever the others are."""
    return space.lower() in (*_LINEAR, *_NO_COLOUR, *_SRGB)


def srgb_to_linear(encoded: NDArray[np.floating]) -> NDArray[np.floating]:
    """IEC 61966-2-1."""
    return np.where(
        encoded <= 0.04045,
        encoded / 12.92,
        ((np.maximum(encoded, 0.04045) + 0.055) / 1.055) ** 2.4,
    )


@cache
def _processor(space: str, chosen: str) -> PyOpenColorIO.CPUProcessor | str:
    """What converts from a space, or why there is none."""
    import PyOpenColorIO  # few stages need it, and it takes a while

    try:
        builtin = PyOpenColorIO.Config.CreateFromFile("ocio://default")
        config = PyOpenColorIO.Config.CreateFromFile(chosen) if chosen else builtin
        if config.getColorSpace(space):
            processor = PyOpenColorIO.Config.GetProcessorFromConfigs(
                config, space, builtin, WORKING_SPACE
            )
        else:
            processor = builtin.getProcessor(space, WORKING_SPACE)
        return processor.getDefaultCPUProcessor()
    except (PyOpenColorIO.Exception, PyOpenColorIO.ExceptionMissingFile) as error:
        return str(error)
