"""Reads the lights that shine from infinitely far: DistantLight, DomeLight and a dome's portals.

UsdLux: a light's luminance is intensity · 2^exposure · colour. `normalize` divides that of a
distant light by the projected solid angle of its cone, π sin² of half its angle, so that its
intensity is the illuminance across it; a dome ignores it. Without an angle, luminance has no
meaning, and the intensity is the illuminance in either case.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, UsdLux

from .environment_map import as_latlong, read_texels
from .errors import SceneError
from .light_inputs import in_single_precision, light_kind, number, read_colour, read_luminance
from .reading_context import ReadingContext
from .scene_description import GoniometricDiagram, LuminaireDescription
from .solution import LUMINANCE_WEIGHTS

DOMES: tuple[str, ...] = ("DomeLight", "DomeLight_1")
# Scales of one light that differ by less are one scale.
UNEQUAL_SCALE = 1e-3
# From the pole of a DomeLight_1, +Z, to that of a map, +Y: Z-up local axes for row vectors.
Z_POLE = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
# Angles between which the luminance through a portal is linear, rad.
PORTAL_GAMMA = np.radians(np.arange(0.0, 91.0))
PORTAL_C = np.radians(np.arange(0.0, 361.0, 2.0))


def read_distant(prim: Usd.Prim, context: ReadingContext) -> LuminaireDescription | None:
    """A DistantLight; None, with a finding, where it gives no light."""
    axes = _directions(prim, context)
    if axes is None:
        return None
    _note_shaping(prim, context)
    half_angle = np.radians(np.clip(number(prim, "inputs:angle", 0.53, context), 0.0, 360.0)) / 2
    luminance = read_luminance(prim, read_colour(prim, context), context)
    # The schema's sizeFactor, by which `normalize` divides, and the cone's solid angle.
    squared = np.sin(half_angle) ** 2
    size = np.pi * (squared if half_angle <= np.pi / 2 else 2 - squared)
    solid_angle = 4 * np.pi * np.sin(half_angle / 2) ** 2
    if half_angle == 0:
        size = solid_angle = 1.0
    if context.value(prim, "inputs:normalize", False):
        luminance = luminance / size
    return _luminaire(prim, "distant", axes, luminance * solid_angle, context, size=half_angle)


def read_dome(prim: Usd.Prim, context: ReadingContext) -> LuminaireDescription | None:
    """A DomeLight; None where it gives no light, or only through its portals."""
    if _portals(prim):
        return None
    axes = _dome_axes(prim, context)
    if axes is None:
        return None
    _note_shaping(prim, context)
    environment = _environment(prim, context)
    rows = len(environment)
    edges = np.sin(np.pi * (0.5 - np.arange(rows + 1) / rows))
    solid_angle = 2 * np.pi * (edges[:-1] - edges[1:])
    flux = solid_angle @ environment.mean(axis=1, dtype=np.float64)
    return _luminaire(prim, "dome", axes, flux, context, environment=environment)


def read_portal(prim: Usd.Prim, context: ReadingContext) -> LuminaireDescription | None:
    """A PortalLight as a rectangle that shines as its dome does behind it; None without a dome."""
    dome = _dome_of(prim)
    if dome is None:
        context.note(prim, "PortalLight", "skipped", "no dome light has it for a portal")
        return None
    to_world = context.world_matrix(prim)
    dome_axes = _dome_axes(dome, context)
    if to_world is None or dome_axes is None:
        context.note(prim, "PortalLight", "skipped", "a transform is singular or not finite")
        return None
    local_x, local_y, local_z = to_world[:3, :3]
    normal = np.cross(local_x, local_y)
    axis_z = normal / np.linalg.norm(normal) * np.sign(normal @ local_z)
    axis_x = local_x / np.linalg.norm(local_x)
    axes = np.array([axis_x, np.cross(axis_z, axis_x), axis_z])
    width = abs(number(prim, "inputs:width", 1.0, context)) * np.linalg.norm(local_x)
    height = abs(number(prim, "inputs:height", 1.0, context)) * np.linalg.norm(normal)
    size = np.array([width, height / np.linalg.norm(local_x)]) * context.meters_per_unit
    reason = "what lies outside of it hides nothing of its dome"
    context.note(prim, "PortalLight", "approximated", reason)
    environment = _environment(dome, context)
    diagram, exitance = None, np.pi * environment[0, 0].astype(float)
    if environment.shape[:2] != (1, 1):
        diagram, exitance = _through_portal(environment, axes @ dome_axes.T)
        if np.ptp(exitance) > 1e-6 * exitance.max():
            reason = "its dome's colours are mixed: one colour to all directions"
            context.note(prim, "PortalLight", "approximated", reason)
    return _luminaire(
        prim,
        "rect",
        axes,
        exitance * size.prod(),
        context,
        size=size,
        origin=to_world[3, :3] * context.meters_per_unit,
        diagram=diagram,
    )


def _luminaire(
    prim: Usd.Prim,
    shape: str,
    axes: NDArray[np.float64],
    flux: NDArray[np.float64],
    context: ReadingContext,
    *,
    size: NDArray[np.float64] | float = 0.0,
    origin: NDArray[np.float64] | None = None,
    diagram: GoniometricDiagram | None = None,
    environment: NDArray[np.float32] | None = None,
) -> LuminaireDescription | None:
    """flux : (3,) by channel"""
    luminous_flux = float(flux @ LUMINANCE_WEIGHTS)
    if not luminous_flux > 0:
        context.note(prim, light_kind(prim), "skipped", "its luminous flux is zero or negative")
        return None
    return LuminaireDescription(
        path=str(prim.GetPath()),
        shape=shape,  # type: ignore[arg-type]
        origin=np.zeros(3) if origin is None else origin,
        axes=axes,
        size=np.array([size, 0.0]) if np.ndim(size) == 0 else np.asarray(size),
        colour=flux / luminous_flux,
        luminous_flux=luminous_flux,
        diagram=diagram,
        environment=environment,
    )


def _directions(prim: Usd.Prim, context: ReadingContext) -> NDArray[np.float64] | None:
    """(3, 3) unit local axes in world space, maybe left-handed; None where singular."""
    to_world = context.world_matrix(prim)
    kind = light_kind(prim)
    if to_world is None:
        context.note(prim, kind, "skipped", "its transform is singular or not finite")
        return None
    left, scales, right = np.linalg.svd(to_world[:3, :3])
    if kind in DOMES and scales[0] > scales[-1] * (1 + UNEQUAL_SCALE):
        context.note(prim, kind, "approximated", "scaled unevenly: read without its scale")
    if kind in DOMES:
        return np.ascontiguousarray(left @ right)
    axis_z = to_world[2, :3] / np.linalg.norm(to_world[2, :3])
    axis_x = np.cross(to_world[1, :3], axis_z)
    axis_x /= np.linalg.norm(axis_x)
    return np.array([axis_x, np.cross(axis_z, axis_x), axis_z])


def _dome_axes(dome: Usd.Prim, context: ReadingContext) -> NDArray[np.float64] | None:
    """As _directions, of the dome's map: its pole is +Y, or as a DomeLight_1 says."""
    axes = _directions(dome, context)
    if axes is None or dome.GetTypeName() != "DomeLight_1":
        return axes
    pole = context.value(dome, "poleAxis", UsdLux.Tokens.scene)
    if pole == UsdLux.Tokens.scene:
        pole = UsdGeom.GetStageUpAxis(dome.GetStage())
    return np.ascontiguousarray(Z_POLE @ axes) if pole == UsdGeom.Tokens.z else axes


def _environment(dome: Usd.Prim, context: ReadingContext) -> NDArray[np.float32]:
    """(H, W, 3) float32, cd/m²; (1, 1, 3) where no texture can be had."""
    luminance = read_luminance(dome, read_colour(dome, context), context)
    asset = context.value(dome, "inputs:texture:file", Sdf.AssetPath())
    layout = str(context.value(dome, "inputs:texture:format", UsdLux.Tokens.automatic))
    texels = np.ones((1, 1, 3), np.float32)
    if asset.path:
        try:
            texels = read_texels(asset)
        except SceneError as error:
            reason = f"{asset.path}, {error.found}: one luminance all around"
            context.note(dome, "inputs:texture:file", "approximated", reason)
        else:
            texels = _laid_out(texels, layout, dome, context)
    return in_single_precision(dome, texels * luminance, "a texture too bright")


def _laid_out(
    texels: NDArray[np.float32], layout: str, dome: Usd.Prim, context: ReadingContext
) -> NDArray[np.float32]:
    name = "inputs:texture:format"
    if layout in ("angular", "mirroredBall"):
        reason = f"{layout}: its middle is taken for local +Z, its top for +Y"
        context.note(dome, name, "approximated", reason)
    elif layout not in ("latlong", "automatic"):
        reason = f"{layout} is not read: the texture's mean all around"
        context.note(dome, name, "approximated", reason)
        return texels.mean(axis=(0, 1), dtype=np.float64).astype(np.float32).reshape(1, 1, 3)
    return as_latlong(texels, layout)


def _portals(dome: Usd.Prim) -> list[Usd.Prim]:
    """The portals that a dome names, or that lie below it."""
    named = dome.GetRelationship("portals").GetTargets() if dome.HasRelationship("portals") else ()
    prims = [dome.GetStage().GetPrimAtPath(path) for path in named]
    return [
        prim
        for prim in (*prims, *Usd.PrimRange(dome))
        if prim and prim.GetTypeName() == "PortalLight" and prim.IsActive()
    ]


def _dome_of(portal: Usd.Prim) -> Usd.Prim | None:
    parent = portal.GetParent()
    while parent:
        if parent.GetTypeName() in DOMES:
            return parent
        parent = parent.GetParent()
    for prim in portal.GetStage().Traverse():
        if prim.GetTypeName() in DOMES and portal in _portals(prim):
            return prim
    return None


def _through_portal(
    environment: NDArray[np.float32], to_dome: NDArray[np.float64]
) -> tuple[GoniometricDiagram, NDArray[np.float64]]:
    """The far field of a portal of 1 m², and its exitance by channel, lm/m².

    to_dome : (3, 3) rows are the portal's local axes in those of the dome's map
    """
    gamma, c_angles = PORTAL_GAMMA[None], PORTAL_C[:, None]
    sine = np.sin(gamma)
    # Light goes to -Z: it comes from the opposite direction.
    outwards = -np.stack(
        np.broadcast_arrays(sine * np.cos(c_angles), sine * np.sin(c_angles), -np.cos(gamma)),
        axis=-1,
    )
    x, y, z = np.moveaxis(outwards @ to_dome, -1, 0)
    height, width = environment.shape[:2]
    # As fine as the diagram: what is smaller keeps its light.
    coarse = environment
    if height > 180:
        rows = np.arange(180) * height // 180
        columns = np.arange(360) * width // 360 if width > 360 else np.arange(width)
        coarse = np.add.reduceat(np.add.reduceat(environment, rows, 0), columns, 1)
        counts = np.diff(rows, append=height)[:, None] * np.diff(columns, append=width)
        coarse = coarse / counts[..., None]
        height, width = coarse.shape[:2]
    row = np.clip((0.5 - np.arcsin(np.clip(y, -1, 1)) / np.pi) * height, 0, height - 1)
    column = np.clip((0.5 - np.arctan2(x, z) / (2 * np.pi)) * width, 0, width - 1)
    luminance = coarse[row.astype(int), column.astype(int)].astype(np.float64)
    intensity = luminance * np.cos(gamma)[..., None]
    step = np.radians(1.0) * np.radians(2.0)
    exitance = (intensity[:-1] * sine[..., None]).sum(axis=(0, 1)) * step
    return GoniometricDiagram(PORTAL_GAMMA, PORTAL_C, intensity @ LUMINANCE_WEIGHTS), exitance


def _note_shaping(prim: Usd.Prim, context: ReadingContext) -> None:
    names = [
        ("shaping:cone:angle", context.value(prim, "inputs:shaping:cone:angle", 90.0) < 90.0),
        ("shaping:focus", context.value(prim, "inputs:shaping:focus", 0.0) > 0.0),
        ("shaping:ies:file", prim.GetAttribute("inputs:shaping:ies:file").HasAuthoredValue()),
        (
            "IsoluxLuminaireAPI",
            "IsoluxLuminaireAPI" in prim.GetPrimTypeInfo().GetAppliedAPISchemas(),
        ),
    ]
    for name, is_authored in names:
        if is_authored:
            reason = "has no part in light from infinitely far"
            context.note(prim, name, "approximated", reason)
