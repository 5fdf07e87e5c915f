"""The luminance to which an observer of a scene adapts: what brightness is judged by."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from ._core import adaptation_luminance
from .scene_description import MeshDescription
from .solution import LUMINANCE_WEIGHTS, MeshLayout


class SceneAdaptation:
    """To which luminance an observer of all lit surfaces adapts, stage after stage."""

    def __init__(
        self, meshes: Iterable[MeshDescription], layouts: Mapping[str, MeshLayout]
    ) -> None:
        self._sides = [
            (side, _vertex_reflectance(mesh, layout))
            for mesh in meshes
            for layout in (layouts[mesh.path],)
            for side in (layout.front, layout.back)
            if side.stop > side.start
        ]

    def luminance(self, illuminance: NDArray[np.float32], areas: NDArray[np.float64]) -> float:
        """cd/m^2; 0: nothing is lit.

        illuminance : (n, 3) float32, lx by channel, total, n >= V
        areas : (V,) float64, m^2; split vertices stand for no area of their own
        """
        luminance = np.zeros(len(areas))
        for side, reflectance in self._sides:
            luminance[side] = (illuminance[side] * reflectance) @ LUMINANCE_WEIGHTS / np.pi
        return adaptation_luminance(luminance, areas)


def _vertex_reflectance(mesh: MeshDescription, layout: MeshLayout) -> NDArray[np.float64]:
    """Mean over the corners at each illumination vertex, (V, 3), or (1, 3) where all are alike."""
    if len(mesh.reflectance) == 1:
        return mesh.reflectance.astype(np.float64)
    on_surface = layout.corner_vertices >= 0
    vertices = layout.corner_vertices[on_surface]
    faces = np.repeat(np.arange(len(mesh.face_vertex_counts)), mesh.face_vertex_counts)
    corners = mesh.reflectance[faces[on_surface]]
    size = layout.front.stop - layout.front.start
    sums = [np.bincount(vertices, corners[:, c], size) for c in range(3)]
    return np.stack(sums, axis=1) / np.maximum(np.bincount(vertices, minlength=size), 1)[:, None]
