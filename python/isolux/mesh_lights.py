"""Meshes that shine: by their material's emission, as lights by MeshLightAPI, or both."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdLux, UsdShade

from .core_scene import mesh_triangles
from .light_inputs import in_single_precision, read_colour, read_luminance
from .reading_context import ReadingContext
from .scene_description import LuminaireDescription, MeshDescription
from .solution import LUMINANCE_WEIGHTS


def with_light(prim: Usd.Prim, mesh: MeshDescription, context: ReadingContext) -> MeshDescription:
    """A mesh whose prim is a light, shining as `light:materialSyncMode` says.

    materialGlowTintsLight: the light's luminance times the material's emission, or the light's
    alone where no material is bound. independent: the light's. noMaterialResponse: the light's,
    and nothing is reflected.
    """
    if not prim.HasAPI(UsdLux.LightAPI):
        return mesh
    luminance = read_luminance(prim, read_colour(prim, context), context)
    if context.value(prim, "inputs:normalize", False):
        area = _areas(mesh)[0].sum()  # in world space, to be in stage units
        luminance = luminance / (area / context.meters_per_unit**2) if area > 0 else luminance
    default = "materialGlowTintsLight" if prim.HasAPI(UsdLux.MeshLightAPI) else "noMaterialResponse"
    mode = str(context.value(prim, "light:materialSyncMode", default))
    emission = np.maximum(luminance, 0.0)[None]
    if mode == "materialGlowTintsLight":
        if mesh.emission is not None:
            emission = emission * mesh.emission
        elif UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0]:
            reason = "materialGlowTintsLight, and its material does not glow"
            context.note(prim, "MeshLightAPI", "skipped", reason)
            return mesh
    found = "a luminance beyond all numbers, normalised or as its material glows"
    shining = replace(mesh, emission=in_single_precision(prim, emission, found))
    if mode == "noMaterialResponse":
        shining = replace(shining, reflectance=np.zeros((1, 3), np.float32))
    return shining


def mesh_luminaires(meshes: Iterable[MeshDescription]) -> list[LuminaireDescription]:
    """A luminaire for each mesh that shines."""
    return [
        luminaire
        for mesh in meshes
        if mesh.emission is not None
        for luminaire in [_luminaire(mesh, mesh.emission)]
        if luminaire is not None
    ]


def _areas(mesh: MeshDescription) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Areas of the elements, m², and the face of each."""
    corners, faces = mesh_triangles(mesh)
    a, b, c = mesh.points[mesh.face_vertex_indices[corners]].transpose(1, 0, 2)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2, faces


def _luminaire(mesh: MeshDescription, emission: NDArray[np.float32]) -> LuminaireDescription | None:
    areas, faces = _areas(mesh)
    luminance = (emission if len(emission) == 1 else emission[faces]).astype(np.float64)
    sides = 2 if mesh.double_sided else 1
    flux = np.pi * sides * (luminance * areas[:, None]).sum(axis=0)
    luminous_flux = float(flux @ LUMINANCE_WEIGHTS)
    if not luminous_flux > 0:
        return None
    return LuminaireDescription(
        path=mesh.path,
        shape="mesh",
        origin=mesh.points.mean(axis=0),
        axes=np.eye(3),
        size=np.zeros(2),
        colour=flux / luminous_flux,
        luminous_flux=luminous_flux,
        diagram=None,
    )
