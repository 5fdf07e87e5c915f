"""Reads one UsdLux light of a stage as a luminaire: shape, colour, luminous flux, directions.

A plain light follows UsdLux: its luminance in cd/m² is intensity · 2^exposure · colour ·
blackbody(colorTemperature), over its area in stage units where `normalize` is on; shaping scales
that luminance by direction. A light with IsoluxLuminaireAPI is absolute: candela as in its
goniometric diagram, and its shape says only where photons start.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, UsdLux

from .environment_map import read_texels
from .errors import DarkDiagramError, PhotometryError, SceneError
from .infinite_lights import DOMES, read_distant, read_dome, read_portal
from .light_axes import light_axes
from .light_inputs import channels, light_kind, number, read_colour, read_luminance
from .light_shaping import Shaping, mirrored, scaled_vertically, shaped_diagram, turned
from .photometry import LARGEST_FILE, inline_diagram, luminous_flux, read_photometric_bytes
from .reading_context import NO_TRANSFORM, ReadingContext, read_asset
from .scene_description import GoniometricDiagram, LuminaireDescription, LuminaireShape
from .solution import LUMINANCE_WEIGHTS

SHAPES: dict[str, LuminaireShape] = {
    "SphereLight": "sphere",
    "DiskLight": "disk",
    "RectLight": "rect",
    "CylinderLight": "cylinder",
}
# What reads the lights that shine from infinitely far.
INFINITE = {"DistantLight": read_distant} | dict.fromkeys(DOMES, read_dome)
NO_DIRECTION = "its transform flattens it to a line or a point, which faces nowhere"
# Scales of one light that differ by less are one scale.
UNEQUAL_SCALE = 1e-3
# C angle at which C0 of an absolute diagram lies, rad, by inputs:isolux:c0Axis.
C0_AXES = {"+X": 0.0, "+Y": np.pi / 2, "-X": np.pi, "-Y": 3 * np.pi / 2}
# Inputs without a part in the solution: what they are worth where they change nothing.
IGNORED_INPUTS = {
    "inputs:diffuse": (1.0, "a scale on diffuse response isn't physical"),
    "inputs:shadow:color": ((0, 0, 0), "a shadow has no colour of its own"),
    "inputs:shadow:distance": (-1.0, "shadows fall as far as light goes"),
}
# Hints that one of a light's sizes may be left out; its flux stays.
TREATED_AS_THIN = {"SphereLight": "treatAsPoint", "CylinderLight": "treatAsLine"}
# Inputs that absolute photometry leaves no part, with their fallbacks.
RELATIVE_INPUTS = {
    "inputs:intensity": 1.0,
    "inputs:exposure": 0.0,
    "inputs:shaping:cone:angle": 90.0,
    "inputs:shaping:focus": 0.0,
}


@dataclass(frozen=True, slots=True)
class Placement:
    """A light's shape in world space; see LuminaireDescription.

    area : luminous area, m^2
    is_mirrored : local +Y lies along −axes[1]
    faces : the transform says where to
    """

    shape: LuminaireShape
    origin: NDArray[np.float64]
    axes: NDArray[np.float64]
    size: NDArray[np.float64]
    area: float
    is_mirrored: bool
    faces: bool


def read_light(prim: Usd.Prim, context: ReadingContext) -> LuminaireDescription | None:
    """A light prim as a luminaire; None where it has no part, with a finding that says why.

    Raises SceneError where its inputs are no numbers, PhotometryError where its photometric
    file or inline diagram can't be used.
    """
    kind = prim.GetTypeName()
    if kind in INFINITE or kind == "PortalLight":
        _note_what_is_not_read(prim, context)
        return (
            read_portal(prim, context) if kind == "PortalLight" else INFINITE[kind](prim, context)
        )
    if prim.IsA(UsdGeom.Gprim) and light_kind(prim) != "VolumeLightAPI":
        _note_what_is_not_read(prim, context)
        return None  # with its surface, see mesh_lights
    if kind not in SHAPES:
        context.note(prim, light_kind(prim), "skipped", "this kind of light is not read")
        return None
    placement = _read_placement(prim, context)
    if placement is None:
        return None
    _note_what_is_not_read(prim, context)
    colour = read_colour(prim, context) * _texture_colour(prim, context)
    is_absolute = "IsoluxLuminaireAPI" in prim.GetPrimTypeInfo().GetAppliedAPISchemas()
    read_emission = _absolute_emission if is_absolute else _usdlux_emission
    try:
        emission = read_emission(prim, placement, colour, context)
    except DarkDiagramError as error:
        context.note(prim, light_kind(prim), "skipped", error.found)
        return None
    if emission is None:
        return None
    flux, diagram = emission
    if not np.isfinite(flux):
        raise SceneError(str(prim.GetPath()), f"a luminous flux of {flux:g} lm", "a finite one")
    if not placement.faces and (placement.shape != "sphere" or diagram is not None):
        context.note(prim, light_kind(prim), "skipped", NO_DIRECTION)
        return None
    if flux <= 0 or colour @ LUMINANCE_WEIGHTS <= 0:
        context.note(prim, light_kind(prim), "skipped", "its luminous flux is zero or negative")
        return None
    return LuminaireDescription(
        path=str(prim.GetPath()),
        shape=placement.shape,
        origin=placement.origin,
        axes=placement.axes,
        size=placement.size,
        colour=colour / (colour @ LUMINANCE_WEIGHTS),
        luminous_flux=flux,
        diagram=diagram,
    )


def _read_placement(prim: Usd.Prim, context: ReadingContext) -> Placement | None:
    """Where a light is; None, with a finding, where its transform doesn't tell."""
    to_world = context.world_matrix(prim, singular_too=True)
    kind = light_kind(prim)
    if to_world is None:
        context.note(prim, kind, "skipped", NO_TRANSFORM)
        return None
    local_x, local_y, _ = to_world[:3, :3]
    scale_x, scale_y, scale_z = np.linalg.norm(to_world[:3, :3], axis=1)
    breadth = np.linalg.norm(np.cross(local_x, local_y))
    found = light_axes(to_world[:3, :3])
    axes, is_mirrored = found or (np.eye(3), False)

    radius = number(prim, "inputs:radius", 0.5, context)
    shape = SHAPES[kind]
    if shape == "sphere":
        scales = [scale_x, scale_y, scale_z]
        size = np.array([radius * np.mean(scales), 0.0])
        area = 4 * np.pi * size[0] ** 2
    elif shape == "disk":
        scales = [scale_x, scale_y]
        size = np.array([radius * np.sqrt(breadth), 0.0])  # the area of the ellipse
        area = np.pi * size[0] ** 2
    elif shape == "rect":
        scales = []
        width = number(prim, "inputs:width", 1.0, context)
        height = number(prim, "inputs:height", 1.0, context)
        size = np.array([width * scale_x, height * (breadth / scale_x if scale_x else scale_y)])
        area = size[0] * size[1]
    else:
        scales = [scale_y, scale_z]
        length = number(prim, "inputs:length", 1.0, context)
        size = np.array([radius * np.mean(scales), length * scale_x])
        area = 2 * np.pi * size[0] * size[1]
    if (size < 0).any():
        raise SceneError(
            str(prim.GetPath()), f"size {size[0]:g}, {size[1]:g}", "sizes of 0 or more"
        )
    if scales and max(scales) > min(scales) * (1 + UNEQUAL_SCALE):
        reason = "scaled unevenly: read with its mean scale"
        context.note(prim, kind, "approximated", reason)
    if breadth < scale_x * scale_y * (1 - UNEQUAL_SCALE):
        context.note(prim, kind, "approximated", "sheared: read without its shear")
    if kind in TREATED_AS_THIN and context.value(prim, TREATED_AS_THIN[kind], False):
        size[0] = 0.0
    metres = context.meters_per_unit
    return Placement(
        shape,
        to_world[3, :3] * metres,
        axes,
        size * metres,
        float(area) * metres**2,
        is_mirrored,
        found is not None,
    )


def _note_what_is_not_read(prim: Usd.Prim, context: ReadingContext) -> None:
    for name, (neutral, reason) in IGNORED_INPUTS.items():
        if context.value(prim, name, neutral) != neutral:
            context.note(prim, name, "approximated", reason)
    light = UsdLux.LightAPI(prim)
    if light.GetFiltersRel().GetTargets():
        context.note(prim, "light:filters", "approximated", "its light filters are not read")
    inputs = [a for a in prim.GetAttributes() if a.GetName().startswith("inputs:")]
    context.note_animation(prim, inputs)


def _texture_colour(prim: Usd.Prim, context: ReadingContext) -> NDArray[np.float64]:
    """(3,) float64, the mean of a RectLight's texture; ones where it has none."""
    asset = context.value(prim, "inputs:texture:file", Sdf.AssetPath())
    if not asset.path:
        return np.ones(3)
    try:
        mean = read_texels(asset).mean(axis=(0, 1), dtype=np.float64)
        reason = "its texture's mean, one luminance all over"
    except SceneError as error:
        mean, reason = np.ones(3), f"{asset.path}, {error.found}: one luminance all over"
    context.note(prim, "inputs:texture:file", "approximated", reason)
    return mean


def _usdlux_emission(
    prim: Usd.Prim, placement: Placement, colour: NDArray[np.float64], context: ReadingContext
) -> tuple[float, GoniometricDiagram | None] | None:
    """Luminous flux (lm) and far field of a plain UsdLux light; None where it has no area."""
    luminance = float(read_luminance(prim, colour, context) @ LUMINANCE_WEIGHTS)
    normalised = context.value(prim, "inputs:normalize", False)
    if not normalised and placement.area == 0:
        reason = "no area to shine from: needs a size, normalize or IsoluxLuminaireAPI"
        context.note(prim, light_kind(prim), "skipped", reason)
        return None
    # Normalised, the luminance is over the area in stage units, which leaves m² per unit².
    area = context.meters_per_unit**2 if normalised else placement.area
    shaping = _read_shaping(prim, context)
    if shaping.is_plain or luminance <= 0:
        return np.pi * luminance * area, None
    diagram = shaped_diagram(placement.shape, luminance * area, shaping)
    if not np.isfinite(diagram.candela).all():
        return np.inf, None
    return _integrate(diagram), mirrored(diagram) if placement.is_mirrored else diagram


def _read_shaping(prim: Usd.Prim, context: ReadingContext) -> Shaping:
    """ShapingAPI's inputs as they stand, its schema's fallbacks included."""
    profile = None
    if prim.GetAttribute("inputs:shaping:ies:file").HasAuthoredValue():
        profile = _photometric_file(prim, "inputs:shaping:ies:file", context)
    if profile is not None:
        # UsdLux multiplies by the profile's power where its purpose, to keep the light's output,
        # needs a division: do what it is for, as renderers do.
        if context.value(prim, "inputs:shaping:ies:normalize", False):
            mean = _integrate(profile) / (4 * np.pi)
            candela = profile.candela / mean if mean > 0 else profile.candela
            profile = GoniometricDiagram(profile.gamma, profile.c_angles, candela)
        scale = number(prim, "inputs:shaping:ies:angleScale", 0.0, context)
        profile = scaled_vertically(profile, scale)
    cone = prim.GetAttribute("inputs:shaping:cone:angle")
    # The fallback of 90° would cut off a profile's uplight.
    has_cone = cone.HasAuthoredValue() or (profile is None and cone.HasValue())
    angle = np.radians(number(prim, "inputs:shaping:cone:angle", 90.0, context))
    tint = channels(prim, "inputs:shaping:focusTint", (0, 0, 0), context)
    focus = number(prim, "inputs:shaping:focus", 0.0, context)
    if focus > 0 and np.ptp(tint) > 0:
        reason = "tints by direction: taken by its luminance"
        context.note(prim, "shaping:focusTint", "approximated", reason)
    return Shaping(
        cone_angle=float(max(angle, 0.0)) if has_cone and angle < np.pi else None,
        cone_softness=float(
            np.clip(number(prim, "inputs:shaping:cone:softness", 0.0, context), 0, 1)
        ),
        focus=focus,
        focus_tint=float(tint @ LUMINANCE_WEIGHTS),
        profile=profile,
    )


def _absolute_emission(
    prim: Usd.Prim, placement: Placement, colour: NDArray[np.float64], context: ReadingContext
) -> tuple[float, GoniometricDiagram | None]:
    """Luminous flux (lm) and far field of a light with IsoluxLuminaireAPI."""
    for name, neutral in RELATIVE_INPUTS.items():
        if context.value(prim, name, neutral) != neutral:
            reason = "does not apply to absolute photometry; inputs:isolux:dimming does"
            context.note(prim, name, "noted", reason)
    path = str(prim.GetPath())
    declared = number(prim, "inputs:isolux:luminousFlux", 0.0, context)
    dimming = number(prim, "inputs:isolux:dimming", 1.0, context)
    for name, value in (("luminousFlux", declared), ("dimming", dimming)):
        if value < 0:
            raise SceneError(path, f"inputs:isolux:{name} = {value:g}", "0 or more")
    diagram = _absolute_diagram(prim, context)
    if diagram is None:
        if declared == 0:
            found = "IsoluxLuminaireAPI without a file, an inline diagram or a luminous flux"
            raise PhotometryError(path, found, "one of them")
        return declared * dimming, None
    axis = str(context.value(prim, "inputs:isolux:c0Axis", "+X"))
    if axis not in C0_AXES:
        raise SceneError(path, f'inputs:isolux:c0Axis = "{axis}"', "one of " + ", ".join(C0_AXES))
    diagram = turned(diagram, C0_AXES[axis])
    own_flux = _integrate(diagram)
    flux = (declared or own_flux) * dimming if own_flux > 0 else 0.0
    return flux, mirrored(diagram) if placement.is_mirrored else diagram


def _absolute_diagram(prim: Usd.Prim, context: ReadingContext) -> GoniometricDiagram | None:
    """The inline diagram, else that of the light's own file, else of its UsdLux profile."""
    gamma, c_angles, candela = (
        np.array(context.value(prim, f"inputs:isolux:{name}", []), dtype=np.float64)
        for name in ("gammaAngles", "cAngles", "candela")
    )
    if len(gamma) or len(c_angles) or len(candela):
        return inline_diagram(gamma, c_angles, candela, str(prim.GetPath()))
    diagram = _photometric_file(prim, "inputs:isolux:file", context)
    return diagram or _photometric_file(prim, "inputs:shaping:ies:file", context)


def _photometric_file(
    prim: Usd.Prim, name: str, context: ReadingContext
) -> GoniometricDiagram | None:
    """The diagram in the photometric file that an attribute names; None where it names none."""
    asset = context.value(prim, name, Sdf.AssetPath())
    if not asset.path:
        return None
    contents = read_asset(asset, LARGEST_FILE + 1)
    if contents is None:
        raise PhotometryError(str(prim.GetPath()), f"no file {asset.path}", "an IES or LDT file")
    photometric = read_photometric_bytes(contents, f"{prim.GetPath()} ({asset.path})")
    for warning in photometric.warnings:
        context.note(prim, name, "noted", warning)
    return photometric.diagram


def _integrate(diagram: GoniometricDiagram) -> float:
    """Luminous flux of a diagram, lm; 0 as well where shaping has left no directions."""
    if len(diagram.gamma) < 2 or not diagram.candela.any():
        return 0.0
    return float(luminous_flux(diagram))
