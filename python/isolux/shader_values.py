"""What shader inputs hold: constants, textures and primvars, and what is computed from them.

A value's last axis is its channels: one for numbers, three for colours, four with alpha.
Computing with constants and with textures laid out alike is done once, texel by texel; what
differs by mesh waits for the mesh.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
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
    """tiles : (H, W, C) float32 by UDIM number, or alone by 0
    outside : (C,), where no picture is
    """

    tiles: dict[int, NDArray[np.float32]]
    outside: NDArray[np.float64]
    layout: TextureLayout


@dataclass(frozen=True, slots=True)
class PrimvarValue:
    """channels : of its elements, as far as the reader says; fallback : (C,) float64"""

    name: str
    fallback: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Combined:
    """A function of values that only a mesh brings together."""

    function: Function
    operands: tuple[Value, ...]


Value = Constant | Textured | PrimvarValue | Combined


def constant(value: object) -> Constant:
    return Constant(np.atleast_1d(np.asarray(value, np.float64)))


def is_constant(value: Value, number: float) -> bool:
    """Whether a value is this number, in every channel and everywhere."""
    return isinstance(value, Constant) and bool((value.value == number).all())


def combine(function: Function, *operands: Value) -> Value:
    """The function of some values.

    function : of arrays (..., C), C made alike, with any leading axes; returns (..., C')
    """
    textures = [value for value in operands if isinstance(value, Textured)]
    rest = [value for value in operands if not isinstance(value, (Constant, Textured))]
    constants = [value.value for value in operands if isinstance(value, Constant)]
    if len(constants) == len(operands):
        return Constant(_evaluate(function, constants))
    if rest or any(texture.layout != textures[0].layout for texture in textures):
        return Combined(function, operands)
    numbers = sorted({number for texture in textures for number in texture.tiles})
    tiles = {}
    for number in numbers:
        found = [texture.tiles[number].shape for texture in textures if number in texture.tiles]
        height, width = max(shape[0] for shape in found), max(shape[1] for shape in found)
        arrays = [
            value.value if isinstance(value, Constant) else _resized(value, number, height, width)
            for value in operands
            if isinstance(value, (Constant, Textured))
        ]
        result = _evaluate(function, arrays)
        tiles[number] = np.broadcast_to(result, (height, width, result.shape[-1])).astype(
            np.float32
        )
    outside = [v.value if isinstance(v, Constant) else v.outside for v in operands]  # type: ignore[union-attr]
    return Textured(tiles, _evaluate(function, outside), textures[0].layout)


def evaluate(value: Combined, operands: list[NDArray[np.floating]]) -> NDArray[np.floating]:
    """A combined value of (n, C) or (1, C) operands."""
    return _evaluate(value.function, operands)


def _evaluate(function: Function, arrays: list[NDArray[Any]]) -> NDArray[Any]:
    channels = min((a.shape[-1] for a in arrays if a.shape[-1] > 1), default=1)
    with np.errstate(all="ignore"):  # what isn't finite is reported where it is used
        return function(*(a[..., :channels] for a in arrays))


def _resized(value: Textured, number: int, height: int, width: int) -> NDArray[np.floating]:
    """Texels of one tile as many times over as a finer texture beside it needs."""
    texels = value.tiles.get(number)
    if texels is None:
        return value.outside
    rows = np.arange(height) * texels.shape[0] // height
    columns = np.arange(width) * texels.shape[1] // width
    if texels.shape[:2] == (height, width):
        return texels
    return texels[rows[:, None], columns]
