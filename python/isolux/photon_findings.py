"""What photons find out about a stage that reading it can't tell."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from . import _core
from .scene_description import Finding, MeshDescription, SceneDescription
from .solution import MeshLayout

# A one-sided mesh is taken to be turned inside out where so many photons met it, mostly its back.
INSIDE_OUT_PHOTONS = 100
# Direct light at the points of a mesh may differ from what photons bring to it by this share, and
# by so many standard deviations of the photons.
COARSE_SHARE, COARSE_DEVIATIONS = 0.25, 4.0


def inside_out_meshes(
    meshes: Sequence[MeshDescription],
    layouts: Mapping[str, MeshLayout],
    hits: NDArray[np.uint64],
    back_hits: Sequence[int],
) -> Iterator[Finding]:
    """Meshes whose absorbing backs most photons met.

    hits : (V, 2), photons that met each vertex, direct and indirect
    back_hits : of each mesh
    """
    for mesh, back in zip(meshes, back_hits, strict=True):
        front = int(hits[layouts[mesh.path].front].sum())
        if back > front and back + front >= INSIDE_OUT_PHOTONS:
            yield Finding(
                mesh.path,
                "orientation",
                "noted",
                f"{back / (back + front):.0%} of the photons that met the mesh met its "
                "back, which absorbs them: check orientation, or set doubleSided",
            )


def enclosed_luminaires(scene: SceneDescription, core_scene: _core.Scene) -> Iterator[Finding]:
    """Luminaires whose light stays in a closed fixture, while there are other meshes."""
    for position, size, mesh in _core.enclosed_lights(core_scene):
        reason = (
            f"none of its light gets out of the {' × '.join(f'{x:.2g}' for x in size)} m around "
            f"it: {scene.meshes[mesh].path} encloses it"
        )
        for luminaire in scene.luminaires:
            if tuple(luminaire.origin.tolist()) == position:
                yield Finding(luminaire.path, "enclosed light", "noted", reason)


def coarse_meshes(
    meshes: Sequence[MeshDescription],
    layouts: Mapping[str, MeshLayout],
    direct_hits: NDArray[np.uint64],
    photon_flux: float,
    direct_flux: NDArray[np.float64],
) -> Iterator[Finding]:
    """Meshes whose points miss much of the direct light that falls between them, or add to it.

    direct_hits : (V,) photons that came straight from a luminaire, each of photon_flux lm
    direct_flux : (V,) lm, by the direct illuminance at each vertex
    """
    for mesh in meshes:
        layout = layouts[mesh.path]
        both = slice(layout.front.start, max(layout.front.stop, layout.back.stop))
        hits = float(direct_hits[both].sum())
        found, flux = float(direct_flux[both].sum()), hits * photon_flux
        noise = COARSE_DEVIATIONS * math.sqrt(hits) * photon_flux
        if abs(found - flux) > COARSE_SHARE * flux + noise:
            yield Finding(
                mesh.path,
                "tessellation",
                "noted",
                f"direct light at the mesh's points stands for {found:.3g} lm where {flux:.3g} "
                "lm fall on it: shadows or beams are finer than the mesh",
            )
