"""What shader inputs hold: constants, textures and primvars, and what is computed from them.

A value's last axis is its channels: one for numbers, three for colours, four with alpha.
Textures laid out alike are combined texel by texel, when a mesh asks for them; all else that
isn't constant is combined by its means over the faces of a mesh.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

Function = Callable[..., NDArray[Any]]


@dataclass(frozen=True, slots=True)
class Constant:
    """value : (C,) float64"""

    value: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Coordinates:
    """Where a texture is looked up: an affine function of a primvar.

    primvar : its name; None: the coordinates are the same everywhere
    matrix : (2, 3) in rows, of (s, t, 1)
    fallback : (s, t) where a mesh has no such primvar; None: not given
    """

    primvar: str | None
    matrix: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    fallback: tuple[float, float] | None = None

    def then(self, linear: NDArray[np.float64], offset: NDArray[np.float64]) -> Coordinates:
        """These coordinates, transformed by `linear` (2, 2) and moved by `offset` (2,)."""
        matrix = linear @ np.reshape(self.matrix, (2, 3))
        matrix[:, 2] += offset
        return Coordinates(self.primvar, tuple(matrix.ravel()), self.fallback)

    def of(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """(..., 2) the transformed coordinates of (..., 2) values of the primvar."""
        matrix = np.reshape(self.matrix, (2, 3))
        return values @ matrix[:, :2].T + matrix[:, 2]


@dataclass(frozen=True, slots=True)
class TextureLayout:
    """coordinates : None where nothing says them
    wrap : across and down: repeat, mirror, clamp or black
    is_udim : tiles of 1 x 1 by their number, ten across, the first is 1001
    """

    coordinates: Coordinates | None
    wrap: tuple[str, str]
    is_udim: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Textured:
    """tiles : loaders of (H, W, C) float32 texels, by UDIM number, or alone by 0
    outside : (C,), where no picture is
    size : how many values went into it
    """

    tiles: Mapping[int, Callable[[], NDArray[np.float32]]]
    outside: NDArray[np.float64]
    layout: TextureLayout
    size: int = 1


@dataclass(frozen=True, slots=True)
class PrimvarValue:
    """fallback : (C,) float64, where a mesh has no such primvar"""

    name: str
    fallback: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Combined:
    """A function of values that only a mesh brings together; size as that of Textured."""

    function: Function
    operands: tuple[Value, ...]
    size: int


Value = Constant | Textured | PrimvarValue | Combined


def constant(value: object) -> Constant:
    return Constant(np.atleast_1d(np.asarray(value, np.float64)))


def is_constant(value: Value, number: float) -> bool:
    """Whether a value is this number, in every channel and everywhere."""
    return isinstance(value, Constant) and bool((value.value == number).all())


def size_of(value: Value) -> int:
    """How many values went into one."""
    return value.size if isinstance(value, (Textured, Combined)) else 1


def combine(function: Function, *operands: Value) -> Value:
    """The function of some values.

    function : of arrays (..., C), C made alike, with any leading axes; returns (..., C')
    """
    constants = [value.value for value in operands if isinstance(value, Constant)]
    if len(constants) == len(operands):
        return Constant(_evaluate(function, constants))
    size = sum(size_of(value) for value in operands)
    textures = [value for value in operands if isinstance(value, Textured)]
    alike = [texture for texture in textures if texture.layout == textures[0].layout]
    if len(constants) + len(alike) < len(operands):
        return Combined(function, operands, size)
    numbers = sorted({number for texture in textures for number in texture.tiles})
    tiles = {number: partial(_combined_texels, function, operands, number) for number in numbers}
    at_none = [_texels_or_value(value, None) for value in operands]
    return Textured(tiles, _evaluate(function, at_none), textures[0].layout, size)


def evaluate(value: Combined, operands: list[NDArray[np.floating]]) -> NDArray[np.floating]:
    """A combined value of (n, C) or (1, C) operands."""
    return _evaluate(value.function, operands)


def _combined_texels(
    function: Function, operands: tuple[Value, ...], number: int
) -> NDArray[np.float32]:
    arrays = [_texels_or_value(value, number) for value in operands]
    height, width = np.max([a.shape[:2] for a in arrays if a.ndim == 3], axis=0)
    for place, array in enumerate(arrays):
        if array.ndim == 3 and array.shape[:2] != (height, width):  # beside a finer one
            rows = np.arange(height) * array.shape[0] // height
            columns = np.arange(width) * array.shape[1] // width
            arrays[place] = array[rows[:, None], columns]
    return _evaluate(function, arrays).astype(np.float32, copy=False)


def _texels_or_value(value: Value, number: int | None) -> NDArray[Any]:
    """(H, W, C) texels of a tile, or (C,) where there are none."""
    if isinstance(value, Textured):
        load = None if number is None else value.tiles.get(number)
        return load() if load else value.outside
    assert isinstance(value, Constant)
    return value.value


def _evaluate(function: Function, arrays: list[NDArray[Any]]) -> NDArray[Any]:
    channels = min((a.shape[-1] for a in arrays if a.shape[-1] > 1), default=1)
    return function(*(a[..., :channels] for a in arrays))
