"""Diffuse reflectance, opacity and emitted luminance of surface shaders.

The solver is diffuse: a surface reflects the same share of the light that its shader reflects in
all, in all directions alike. For a dielectric that is its diffuse colour, for a metal its base
colour, whose Fresnel reflection is that colour at normal incidence
[UsdPreviewSurface: diffuseColor is the albedo in the metallic workflow]; so it is the base colour
whatever the metalness. The 4 % that a plain dielectric reflects from its polish counts as part of
the colour that was measured or painted. In the specular workflow, what specularColor reflects
beyond that 4 % is added to the diffuse colour, up to 1. Light that a surface transmits passes
straight through, as through a pane: its share lowers the opacity.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, UsdShade

from .reading_context import ReadingContext
from .shader_network import NetworkError, ShaderNetwork
from .shader_values import Combined, Constant, Value, combine, constant, is_constant
from .solution import LUMINANCE_WEIGHTS

# Reflection of a dielectric of index 1.5 at normal incidence, ((1.5 - 1) / (1.5 + 1))².
DIELECTRIC_REFLECTION = 0.04


@dataclass(frozen=True, slots=True)
class SurfaceModel:
    """Inputs of a shader, each with the value that it has where not authored.

    ignored : inputs that change the light if they aren't 0, and aren't read
    """

    colour: tuple[str, float]
    metallic: str
    opacity: str
    emission: tuple[str, float]
    weight: str | None = None
    emission_weight: str | None = None
    subsurface: tuple[str, str] | None = None
    transmission: tuple[str, str] | None = None
    ignored: tuple[str, ...] = ()


_PREVIEW = SurfaceModel(("diffuseColor", 0.18), "metallic", "opacity", ("emissiveColor", 0.0))
_STANDARD = SurfaceModel(
    ("base_color", 0.8),
    "metalness",
    "opacity",
    ("emission_color", 1.0),
    weight="base",
    emission_weight="emission",
    subsurface=("subsurface", "subsurface_color"),
    transmission=("transmission", "transmission_color"),
    ignored=("coat", "sheen"),
)
SURFACE_MODELS = {
    "UsdPreviewSurface": _PREVIEW,
    "ND_UsdPreviewSurface_surfaceshader": _PREVIEW,
    "ND_standard_surface_surfaceshader": _STANDARD,
    "arnold:standard_surface": _STANDARD,
    "ND_open_pbr_surface_surfaceshader": SurfaceModel(
        ("base_color", 0.8),
        "base_metalness",
        "geometry_opacity",
        ("emission_color", 1.0),
        weight="base_weight",
        emission_weight="emission_luminance",
        subsurface=("subsurface_weight", "subsurface_color"),
        transmission=("transmission_weight", "transmission_color"),
        ignored=("coat_weight", "fuzz_weight"),
    ),
}


@dataclass(frozen=True, slots=True)
class Surface:
    """What the solver needs of a material.

    path : of its shader
    reflected : share of the arriving light that is reflected, cut-outs included
    opacity : share of the arriving light that is stopped
    emission : luminance, cd/m² by channel; an emissiveColor of 1 is 1 cd/m², as UsdLux has it
    """

    path: Sdf.Path
    reflected: Value
    opacity: Value
    emission: Value


class SurfaceReader:
    """Reads surface shaders."""

    def __init__(self, context: ReadingContext, network: ShaderNetwork, instead: str) -> None:
        self._context = context
        self._network = network
        self._instead = instead

    def surface(self, shader: UsdShade.Shader) -> Surface | None:
        """None, with a finding, where the base colour can't be evaluated."""
        model = SURFACE_MODELS[shader.GetShaderId()]
        prim = shader.GetPrim()
        self._context.note_animation(prim, [held.GetAttr() for held in shader.GetInputs()])
        try:
            base = self._network.value(shader, *model.colour)
        except NetworkError as error:
            reason = f"{error}: {self._instead}"
            self._context.note(prim, model.colour[0], "approximated", reason)
            return None
        if model.weight:
            base = _product(self._value(shader, model.weight, 1.0), base)
        if model.subsurface:
            base = self._with_subsurface(shader, model.subsurface, base)
        if model is _PREVIEW and self._network.plain(shader, "useSpecularWorkflow", 0):
            base = self._with_specular(shader, base)
        elif self._is_used(shader, model.metallic):
            amount = self._network.plain(shader, model.metallic, None)
            metallic = f"metallic {amount:.3g}" if isinstance(amount, float) else "metallic"
            reason = f"{metallic}: its specular reflection is taken as diffuse"
            self._context.note(prim, model.metallic, "approximated", reason)
        for name in model.ignored:
            if self._is_used(shader, name):
                self._context.note(prim, name, "approximated", f"its {name} is not read")
        opacity, is_cut_out = self._opacity(shader, model)
        emission = self._value(shader, *model.emission)
        if model.emission_weight:
            emission = _product(self._value(shader, model.emission_weight, 0.0), emission)
        if is_cut_out:
            emission = _product(opacity, emission)
        reflected = _product(opacity, base)
        if model.transmission:
            reflected, opacity = self._with_transmission(
                shader, model.transmission, reflected, opacity
            )
        if any(isinstance(value, Combined) for value in (reflected, emission, opacity)):
            reason = "textures laid out differently are combined by their means over each face"
            self._context.note(prim, "UsdUVTexture", "approximated", reason)
        return Surface(shader.GetPath(), reflected, opacity, emission)

    def _value(self, shader: UsdShade.Shader, name: str, default: float) -> Value:
        """An input; its default, with a finding, where it can't be evaluated."""
        try:
            return self._network.value(shader, name, default)
        except NetworkError as error:
            reason = f"{error}: {default:g} instead"
            self._context.note(shader.GetPrim(), name, "approximated", reason)
            return constant(default)

    def _is_used(self, shader: UsdShade.Shader, name: str) -> bool:
        if self._network.is_computed(shader, name):
            return True
        value = np.asarray(self._network.plain(shader, name, 0.0))
        return value.dtype.kind in "biuf" and bool((value != 0).any())

    def _with_subsurface(
        self, shader: UsdShade.Shader, names: tuple[str, str], base: Value
    ) -> Value:
        """Light that comes out again below the surface has the subsurface colour."""
        weight = self._value(shader, names[0], 0.0)
        if is_constant(weight, 0.0):
            return base
        below = self._value(shader, names[1], 1.0 if names[0] == "subsurface" else 0.8)
        return combine(lambda b, s, w: b + (s - b) * w, base, below, weight)

    def _with_transmission(
        self, shader: UsdShade.Shader, names: tuple[str, str], reflected: Value, opacity: Value
    ) -> tuple[Value, Value]:
        """Reflected and stopped share of the light, less what passes straight through."""
        weight = self._value(shader, names[0], 0.0)
        if is_constant(weight, 0.0):
            return reflected, opacity
        reason = "what it transmits passes straight through, its colour by its luminance"
        self._context.note(shader.GetPrim(), names[0], "approximated", reason)
        weight = combine(_share, weight)
        passing = combine(_share, _product(weight, self._value(shader, names[1], 1.0)))
        return (
            combine(lambda r, w: r * (1 - w), reflected, weight),
            combine(lambda o, p: o * (1 - p), opacity, passing),
        )

    def _with_specular(self, shader: UsdShade.Shader, base: Value) -> Value:
        specular = self._value(shader, "specularColor", 0.0)
        if isinstance(specular, Constant) and (specular.value <= DIELECTRIC_REFLECTION).all():
            return base
        reason = "its specular reflection is taken as diffuse"
        self._context.note(shader.GetPrim(), "specularColor", "approximated", reason)
        return combine(_diffuse_and_specular, base, specular)

    def _opacity(self, shader: UsdShade.Shader, model: SurfaceModel) -> tuple[Value, bool]:
        """Opacity, and whether what is cut out doesn't shine either."""
        opacity = self._value(shader, model.opacity, 1.0)
        is_cut_out = True
        if model is _PREVIEW:
            threshold = self._value(shader, "opacityThreshold", 0.0)
            is_cut_out = self._network.plain(shader, "opacityMode", "transparent") == "presence"
            if not is_constant(threshold, 0.0):
                is_cut_out = True
                opacity = combine(_above_threshold, opacity, threshold)
        if isinstance(opacity, Constant) and not (abs(opacity.value - 0.5) <= 0.5).all():
            reason = "opacity outside of [0, 1] is clamped to it"
            self._context.note(shader.GetPrim(), model.opacity, "repaired", reason)
        return combine(_share, opacity), is_cut_out


def _product(factor: Value, value: Value) -> Value:
    return value if is_constant(factor, 1.0) else combine(np.multiply, value, factor)


def _share(value: NDArray[np.floating]) -> NDArray[np.floating]:
    """(..., 1) in [0, 1] of (..., C): of a colour, its luminance."""
    grey = (
        (value[..., :3] @ LUMINANCE_WEIGHTS)[..., None] if value.shape[-1] >= 3 else value[..., :1]
    )
    return np.clip(np.nan_to_num(grey), 0.0, 1.0)


def _above_threshold(
    opacity: NDArray[np.floating], threshold: NDArray[np.floating]
) -> NDArray[np.floating]:
    # UsdPreviewSurface: below the threshold the surface isn't there, else it is opaque.
    return np.where(
        (threshold > 0) & (opacity < threshold), 0.0, np.where(threshold > 0, 1.0, opacity)
    )


def _diffuse_and_specular(
    diffuse: NDArray[np.floating], specular: NDArray[np.floating]
) -> NDArray[np.floating]:
    beyond = np.maximum(specular - DIELECTRIC_REFLECTION, 0) / (1 - DIELECTRIC_REFLECTION)
    return np.maximum(np.minimum(diffuse + beyond, 1), diffuse)
