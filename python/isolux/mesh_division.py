"""The mesh that is solved on, where large elements of the scene were divided.

Solutions tell the light at the scene's own vertices, those of an undivided mesh, in their order. To
an adaptive mesh the added vertices are splits like its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from . import _core
from .solution import MeshLayout, RefinedMesh


@dataclass(frozen=True, slots=True)
class MeshDivision:
    """How the scene's mesh lies in the divided one, of V vertices before and N now.

    vertices : (V,) int32, where each of the scene's vertices is now
    added : (A,) int32, vertices in the middle between two others of the same side
    between : (A, 2) int32, those two
    twins : (A,) int32, of an added front vertex that of the back; else -1
    elements : (T, 3) int32, of the divided mesh
    parts : (P,) int32, rising, elements that are parts of one of the scene's
    parents : (P,) int32, that element
    barycentrics : (P, 3, 3) float64, place of each corner in it
    positions : (N, 3) float64, m
    """

    vertices: NDArray[np.int32]
    added: NDArray[np.int32]
    between: NDArray[np.int32]
    twins: NDArray[np.int32]
    elements: NDArray[np.int32]
    parts: NDArray[np.int32]
    parents: NDArray[np.int32]
    barycentrics: NDArray[np.float64]
    positions: NDArray[np.float64]

    @classmethod
    def of(cls, core_scene: _core.Scene) -> MeshDivision | None:
        """None: nothing was divided."""
        arrays = core_scene.division
        return arrays and cls(**arrays, positions=core_scene.vertex_positions)

    def unsplit(self) -> RefinedMesh:
        """The divided mesh as an adaptive one without a split."""
        return RefinedMesh.unsplit(len(self.vertices) + len(self.added), self.elements)

    def order(self, refined: RefinedMesh | None) -> NDArray[np.int64]:
        """Where each vertex of a solution is in the arrays of the solver.

        refined : adaptive mesh over the divided one
        """
        if refined is None:
            return self.vertices.astype(np.int64)
        splits = refined.vertex_count + np.arange(len(refined.split_parents))
        return np.concatenate([self.vertices, self.added, splits])

    def over_scene(self, refined: RefinedMesh) -> RefinedMesh:
        """An adaptive mesh over the divided one as one over the scene's own elements."""
        order = self.order(refined)
        number = np.empty(len(order), np.int32)
        number[order] = np.arange(len(order), dtype=np.int32)
        twins = np.concatenate([self.twins, refined.split_twin])
        _, places = np.unique(self.positions[self.added], axis=0, return_inverse=True)
        place_count = places.max(initial=-1) + 1
        part_of = np.full(len(self.elements), -1)
        part_of[self.parts] = np.arange(len(self.parts))
        is_first = np.ones(len(self.elements), bool)
        is_first[self.parts[1:]] = self.parents[1:] != self.parents[:-1]
        parent = np.cumsum(is_first, dtype=np.int32) - np.int32(1)
        part = part_of[refined.element_parents]
        barycentrics = refined.barycentrics.copy()
        barycentrics[part >= 0] = barycentrics[part >= 0] @ self.barycentrics[part[part >= 0]]
        return RefinedMesh(
            vertex_count=len(self.vertices),
            split_parents=number[np.concatenate([self.between, refined.split_parents])],
            split_fraction=np.concatenate([np.full(len(self.added), 0.5), refined.split_fraction]),
            split_twin=np.where(twins < 0, np.int32(-1), number[twins]),
            split_point=np.concatenate(
                [places.ravel(), place_count + refined.split_point], dtype=np.int32
            ),
            elements=number[refined.elements],
            element_parents=parent[refined.element_parents],
            barycentrics=barycentrics,
        )


def scene_layouts(layouts: Mapping[str, MeshLayout]) -> dict[str, MeshLayout]:
    """Layouts of the scene's own vertices, from those of a divided mesh."""
    out, begin = {}, 0
    for path, layout in layouts.items():
        count = int(layout.corner_vertices.max(initial=-1)) + 1
        middle = begin + count
        end = middle + (count if layout.back.stop > layout.back.start else 0)
        out[path] = MeshLayout(slice(begin, middle), slice(middle, end), layout.corner_vertices)
        begin = end
    return out
