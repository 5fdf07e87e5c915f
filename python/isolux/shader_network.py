"""Evaluates the inputs of shaders: constants, USD's own nodes, and MaterialX nodes of arithmetic.

Nodes as UsdPreviewSurface's specification and the MaterialX standard library define them. Colours
are converted from the space that their attribute names to linear Rec. 709.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdShade

from .attribute_colours import attribute_colours
from .reading_context import ReadingContext
from .shader_values import (
    Constant,
    Coordinates,
    Function,
    PrimvarValue,
    Textured,
    TextureLayout,
    Value,
    combine,
    constant,
    size_of,
)
from .texture_reader import TextureReader

# Nodes one behind the other; more come from no artist.
MAX_DEPTH = 100
# Values that go into one: nodes count as often as others use them.
MAX_SIZE = 1000
# What MaterialX takes for luminance where a node says nothing [stdlib: luminance, saturate].
_LUMA = np.array([0.2722287, 0.6740818, 0.0536895])
# Stands for coordinates that aren't there: no texture lies so far away.
_NOT_GIVEN = (-1e30, -1e30)
_CHANNELS = {"r": 0, "g": 1, "b": 2, "a": 3, "x": 0, "y": 1, "z": 2, "w": 3}


class NetworkError(ValueError):
    """Why an input can't be evaluated, in words."""


def _divide(over: NDArray, under: NDArray) -> NDArray:
    return np.where(under == 0, 0.0, over / np.where(under == 0, 1.0, under))


def _power(base: NDArray, exponent: NDArray) -> NDArray:
    return np.maximum(base, 0.0) ** exponent


def _mix(front: NDArray, back: NDArray, share: NDArray) -> NDArray:
    return front * share + back * (1 - share)


def _remap(v: NDArray, low: NDArray, high: NDArray, to_low: NDArray, to_high: NDArray) -> NDArray:
    return to_low + _divide(v - low, high - low) * (to_high - to_low)


def _luminance(colour: NDArray) -> NDArray:
    return np.repeat(colour[..., :3] @ _LUMA[: colour.shape[-1]], 3).reshape(*colour.shape[:-1], 3)


def _saturate(colour: NDArray, amount: NDArray) -> NDArray:
    return _mix(colour[..., :3], _luminance(colour), amount[..., :3])


# Inputs with their defaults, and what a node makes of them.
_ARITHMETIC: dict[str, tuple[dict[str, float], Function]] = {
    "constant": ({"value": 0.0}, lambda v: v),
    "convert": ({"in": 0.0}, lambda v: v),
    "dot": ({"in": 0.0}, lambda v: v),
    "add": ({"in1": 0.0, "in2": 0.0}, np.add),
    "subtract": ({"in1": 0.0, "in2": 0.0}, np.subtract),
    "multiply": ({"in1": 0.0, "in2": 1.0}, np.multiply),
    "divide": ({"in1": 0.0, "in2": 1.0}, _divide),
    "power": ({"in1": 0.0, "in2": 1.0}, _power),
    "min": ({"in1": 0.0, "in2": 0.0}, np.minimum),
    "max": ({"in1": 0.0, "in2": 0.0}, np.maximum),
    "absval": ({"in": 0.0}, np.abs),
    "invert": ({"amount": 1.0, "in": 0.0}, np.subtract),
    "mix": ({"fg": 0.0, "bg": 0.0, "mix": 0.0}, _mix),
    "clamp": ({"in": 0.0, "low": 0.0, "high": 1.0}, np.clip),
    "remap": (
        {"in": 0.0, "inlow": 0.0, "inhigh": 1.0, "outlow": 0.0, "outhigh": 1.0},
        _remap,
    ),
    "luminance": ({"in": 0.0}, _luminance),
    "saturate": ({"in": 0.0, "amount": 1.0}, _saturate),
}


class ShaderNetwork:
    """Evaluates inputs; each output of a node once."""

    def __init__(self, context: ReadingContext) -> None:
        self._context = context
        self._textures = TextureReader(context)
        self._outputs: dict[Sdf.Path, Value | NetworkError] = {}
        self._open: set[Sdf.Path] = set()

    def value(self, shader: UsdShade.Shader, name: str, default: Any) -> Value:
        """What an input holds. Raises NetworkError where a node that isn't known computes it."""
        source = self._source(shader, name)
        if source is None:
            return constant(default)
        if UsdShade.Utils.GetType(source.GetName()) == UsdShade.AttributeType.Output:
            return self._output(source)
        held = source.Get(self._context.time)
        if held is None:
            return constant(default)
        value = np.atleast_1d(np.asarray(held))
        if value.dtype.kind not in "biuf" or value.ndim != 1 or not 1 <= len(value) <= 4:
            raise NetworkError(f"a {source.GetTypeName()} is no colour and no number")
        value = value.astype(np.float64)
        if len(value) >= 3:
            value[:3] = attribute_colours(source, value[None, :3], self._context)[0]
        return Constant(value)

    def plain(self, shader: UsdShade.Shader, name: str, default: Any) -> Any:
        """What an input holds as authored; `default` where it has nothing or a node computes it."""
        source = self._source(shader, name)
        if source is None:
            return default
        if UsdShade.Utils.GetType(source.GetName()) == UsdShade.AttributeType.Output:
            return default
        value = source.Get(self._context.time)
        return default if value is None else value

    def is_computed(self, shader: UsdShade.Shader, name: str) -> bool:
        """Whether a node computes an input."""
        source = self._source(shader, name)
        return source is not None and (
            UsdShade.Utils.GetType(source.GetName()) == UsdShade.AttributeType.Output
        )

    def _source(self, shader: UsdShade.Shader, name: str) -> Usd.Attribute | None:
        """The attribute that gives an input its value: an input, or the output of a node."""
        shader_input = shader.GetInput(name)
        if not shader_input:
            return None
        sources = shader_input.GetValueProducingAttributes()
        if sources:
            return sources[0]
        if shader_input.HasConnectedSource() and shader_input.Get(self._context.time) is not None:
            return shader_input.GetAttr()
        return None

    def _output(self, output: Usd.Attribute) -> Value:
        path = output.GetPath()
        if path in self._open:
            raise NetworkError(f"{path} depends on itself")
        if len(self._open) >= MAX_DEPTH:
            raise NetworkError(f"more than {MAX_DEPTH} nodes one behind the other")
        if path not in self._outputs:
            self._open.add(path)
            try:
                found = self._node(UsdShade.Shader(output.GetPrim()), output)
                if size_of(found) > MAX_SIZE:
                    raise NetworkError(f"more than {MAX_SIZE} values go into it")
                self._outputs[path] = found
            except NetworkError as error:
                self._outputs[path] = error
            finally:
                self._open.discard(path)
        known = self._outputs[path]
        if isinstance(known, NetworkError):
            raise known
        return known

    def _node(self, node: UsdShade.Shader, output: Usd.Attribute) -> Value:
        kind = str(node.GetShaderId() or "") if node else ""
        name = output.GetName().split(":")[-1]
        bare = kind.removeprefix("ND_")
        operation = bare.split("_")[0]
        if operation == "UsdUVTexture":
            return self._uv_texture(node, name)
        if operation == "UsdPrimvarReader":
            fallback = self._fallback(node, "fallback")
            return PrimvarValue(str(self.plain(node, "varname", "")), fallback)
        if kind == bare:  # no node of MaterialX
            raise NetworkError(f"its value from {kind or 'a shader without id'} is not read")
        if operation in ("image", "tiledimage"):
            return self._image(node, operation)
        if operation == "geompropvalue":
            fallback = self._fallback(node, "default")
            return PrimvarValue(str(self.plain(node, "geomprop", "")), fallback)
        if operation == "geomcolor":
            return PrimvarValue("displayColor", np.zeros(3))
        if operation in ("combine2", "combine3", "combine4"):
            parts = [f"in{i + 1}" for i in range(int(operation[-1]))]
            return combine(_joined, *(self.value(node, part, 0.0) for part in parts))
        if operation == "extract":
            index = int(self._vector(node, "index", (0.0,))[0])
            return _channel(self.value(node, "in", 0.0), max(index, 0))
        if operation.startswith("separate") and name[-1:] in _CHANNELS:
            return _channel(self.value(node, "in", 0.0), _CHANNELS[name[-1]])
        if operation not in _ARITHMETIC:
            raise NetworkError(f"its value from {kind} is not read")
        inputs, function = _ARITHMETIC[operation]
        operands = [self.value(node, key, default) for key, default in inputs.items()]
        return combine(function, *operands)

    def _fallback(self, node: UsdShade.Shader, name: str) -> NDArray[np.float64]:
        held = self.value(node, name, 0.0)
        return held.value if isinstance(held, Constant) else np.zeros(1)

    def _uv_texture(self, node: UsdShade.Shader, output: str) -> Value:
        layout = TextureLayout(
            self.coordinates(node, "st", None),
            (str(self.plain(node, "wrapS", "")), str(self.plain(node, "wrapT", ""))),
        )
        space = str(self.plain(node, "sourceColorSpace", "auto"))
        is_authored = self.plain(node, "fallback", None) is not None
        fallback = self._vector(node, "fallback", (0.0, 0.0, 0.0, 1.0))
        read = self._read(node, space, layout, fallback if is_authored else None)
        scale = self._vector(node, "scale", (1.0, 1.0, 1.0, 1.0))
        bias = self._vector(node, "bias", (0.0, 0.0, 0.0, 0.0))
        if isinstance(read, Textured) and not ((scale == 1).all() and (bias == 0).all()):
            read = combine(lambda t, s, b: t * s + b, read, Constant(scale), Constant(bias))
        return _channel(read, _CHANNELS[output]) if output in _CHANNELS else _colour(read)

    def _vector(
        self, node: UsdShade.Shader, name: str, default: tuple[float, ...]
    ) -> NDArray[np.float64]:
        """(n,) numbers as authored; `default` where they are others or not finite."""
        value = np.atleast_1d(np.asarray(self.plain(node, name, default)))
        if value.dtype.kind not in "biuf" or value.shape != np.shape(default):
            return np.asarray(default)
        value = value.astype(np.float64)
        return value if np.isfinite(value).all() else np.asarray(default)

    def _image(self, node: UsdShade.Shader, operation: str) -> Value:
        coordinates = self.coordinates(node, "texcoord", Coordinates("st"))
        if operation == "tiledimage" and coordinates:
            one = (1.0, 1.0)
            tile, size = (self._vector(node, f"realworld{n}size", one) for n in ("tile", "image"))
            stretch = _divide(tile, size)
            offset = -self._vector(node, "uvoffset", (0.0, 0.0)) * stretch
            tiling = np.diag(self._vector(node, "uvtiling", one) * stretch)
            coordinates = coordinates.then(tiling, offset)
        default = None
        if self._source(node, "default") is not None:
            value = self._fallback(node, "default")
            default = np.resize(value, 4) if len(value) >= 3 else np.repeat(value[:1], 4)
        modes = {"periodic": "repeat", "clamp": "clamp", "mirror": "mirror", "constant": "black"}
        wrap = [str(self.plain(node, f"{a}addressmode", "periodic")) for a in "uv"]
        if operation == "tiledimage":
            wrap = ["periodic", "periodic"]
        across, down = (modes.get(mode, "repeat") for mode in wrap)
        layout = TextureLayout(coordinates, (across, down))
        kind = str(node.GetShaderId()).split("_")[2:]
        # Renderers take pictures of colours without a named space as UsdUVTexture does.
        space = "auto" if kind[:1] in (["color3"], ["color4"]) else "raw"
        found = self._read(node, space, layout, default)
        if kind[:1] == ["float"]:
            return _channel(found, 0)
        return _colour(found) if kind[:1] == ["color3"] else found

    def _read(
        self,
        node: UsdShade.Shader,
        space: str,
        layout: TextureLayout,
        fallback: NDArray[np.float64] | None,
    ) -> Value:
        """A texture, else its fallback; raises NetworkError where it has none."""
        asset = self.plain(node, "file", None)
        asset = asset if isinstance(asset, Sdf.AssetPath) else Sdf.AssetPath()
        source = self._source(node, "file")
        if source is not None and space == "auto":
            space = source.GetColorSpace() or space
        read = self._textures.texture(node.GetPrim(), asset, source, space, layout, fallback)
        if read is not None:
            return read
        if fallback is None:
            raise NetworkError("its texture can't be read")
        return Constant(fallback)

    def coordinates(
        self, node: UsdShade.Shader, name: str, default: Coordinates | None, depth: int = 0
    ) -> Coordinates | None:
        """Where a texture node looks its texture up; `default` where it doesn't say.

        Raises NetworkError where the coordinates are no affine function of a primvar.
        """
        if depth > MAX_DEPTH:
            raise NetworkError("its coordinates depend on too many nodes")
        if not self.is_computed(node, name):
            s, t = self._vector(node, name, _NOT_GIVEN)
            if s == _NOT_GIVEN[0]:
                return default
            return Coordinates(None, (0.0, 0.0, s, 0.0, 0.0, t))
        source = self._source(node, name)
        assert source is not None
        inner = UsdShade.Shader(source.GetPrim())
        kind = str(inner.GetShaderId() or "")
        operation = kind.removeprefix("ND_").split("_")[0]

        def behind(input_name: str, rest: Coordinates | None = default) -> Coordinates:
            found = self.coordinates(inner, input_name, rest, depth + 1)
            return found or Coordinates(None, (0.0,) * 6)

        if operation == "UsdPrimvarReader":
            fallback = self._vector(inner, "fallback", _NOT_GIVEN)
            given = (
                None if fallback[0] == _NOT_GIVEN[0] else (float(fallback[0]), float(fallback[1]))
            )
            return Coordinates(str(self.plain(inner, "varname", "")), fallback=given)
        if operation == "geompropvalue":
            return Coordinates(_primvar_of(str(self.plain(inner, "geomprop", "UV0"))))
        if operation == "texcoord":
            index = int(self._vector(inner, "index", (0.0,))[0])
            return Coordinates(f"st{index}" if index else "st")
        if operation == "UsdTransform2d":
            turn = _rotation(self._vector(inner, "rotation", (0.0,))[0])
            scale = np.diag(self._vector(inner, "scale", (1.0, 1.0)))
            moved = self._vector(inner, "translation", (0.0, 0.0))
            return behind("in").then(turn @ scale, moved)
        if operation == "place2d":
            turn = _rotation(-self._vector(inner, "rotate", (0.0,))[0])
            pivot, offset = (self._vector(inner, n, (0.0, 0.0)) for n in ("pivot", "offset"))
            linear = turn @ np.diag(_divide(np.ones(2), self._vector(inner, "scale", (1.0, 1.0))))
            return behind("texcoord", Coordinates("st")).then(
                linear, pivot - offset - linear @ pivot
            )
        if operation in ("multiply", "divide", "add", "subtract") and not self.is_computed(
            inner, "in2"
        ):
            neutral = 1.0 if operation in ("multiply", "divide") else 0.0
            number = self._vector(inner, "in2", (neutral,))  # vector2FA takes one for both
            other = self._vector(inner, "in2", (number[0], number[0]))
            if operation in ("multiply", "divide"):
                by = other if operation == "multiply" else _divide(np.ones(2), other)
                return behind("in1").then(np.diag(by), np.zeros(2))
            return behind("in1").then(np.eye(2), other if operation == "add" else -other)
        if operation == "constant":
            return behind("value")
        raise NetworkError(f"its coordinates from {kind or 'a shader without id'} are not read")


def _joined(*parts: NDArray[np.floating]) -> NDArray[np.floating]:
    return np.concatenate(np.broadcast_arrays(*(part[..., :1] for part in parts)), axis=-1)


def _channel(value: Value, index: int) -> Value:
    pick: Callable = lambda v: v[..., min(index, v.shape[-1] - 1), None]  # noqa: E731
    return combine(pick, value)


def _colour(value: Value) -> Value:
    return combine(lambda v: v[..., :3], value)


def _primvar_of(geomprop: str) -> str:
    """USD's name of a MaterialX coordinate set."""
    return "st" if geomprop in ("UV0", "UV") else geomprop


def _rotation(degrees: float) -> NDArray[np.float64]:
    angle = np.radians(degrees)
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
