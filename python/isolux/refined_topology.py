"""The adaptive mesh of one prim: triangles over its authored faces, and what those carry over.

A new corner lies in a triangle of an authored face, so that any primvar has a value there: the one
that is linear over that triangle. Authored points keep their numbers; new ones follow.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .core_scene import mesh_triangles
from .mesh_topology import MeshTopology
from .scene_description import MeshDescription
from .solution import MeshLayout, RefinedMesh

# A weight that is rounding alone: edges are split into quarters, and quarters of quarters.
_NO_WEIGHT = 1e-9


@dataclass(frozen=True, slots=True)
class RefinedTopology:
    """T triangles, C = 3 T corners, Q new points beside the P authored ones.

    Holes and faces without area have no triangles.

    authored : the faces before
    indices : (C,) int32, point of each corner; triangles wind as the authored faces do
    faces : (T,) int32, authored face of which each triangle is a part
    corner_sources : (C, 3) int32, authored corners of the triangle in which each corner lies
    corner_weights : (C, 3) float64, their weights there
    point_corners : (Q,) int64, a corner at each new point
    front : (C,) int32, vertex of the solution
    back : the same of the back; None for a one-sided mesh
    """

    authored: MeshTopology
    indices: NDArray[np.int32]
    faces: NDArray[np.int32]
    corner_sources: NDArray[np.int32]
    corner_weights: NDArray[np.float64]
    point_corners: NDArray[np.int64]
    front: NDArray[np.int32]
    back: NDArray[np.int32] | None

    @property
    def point_count(self) -> int:
        """P + Q."""
        return self.authored.point_count + len(self.point_corners)

    def interpolated(self, values: NDArray[Any], interpolation: str) -> NDArray[np.float64]:
        """Values of the authored mesh, linear over the triangles of its faces.

        values : (n, K), as many as a "vertex", "varying" or "faceVarying" primvar has
        returns : (P + Q, K) or (C, K) float64
        """
        if interpolation == "faceVarying":
            return _blend(values, self.corner_sources, self.corner_weights)
        sources = self.authored.indices[self.corner_sources[self.point_corners]]
        new = _blend(values, sources, self.corner_weights[self.point_corners])
        return np.concatenate([values, new])

    def nearest(self, interpolation: str) -> NDArray[np.int64]:
        """Row of the authored values that is nearest to each new one; exact for "uniform"."""
        if interpolation == "uniform":
            return self.faces.astype(np.int64)
        weightiest = self.corner_weights.argmax(axis=1)
        corners = self.corner_sources[np.arange(len(weightiest)), weightiest].astype(np.int64)
        if interpolation == "faceVarying":
            return corners
        new = self.authored.indices[corners[self.point_corners]]
        return np.concatenate([np.arange(self.authored.point_count), new])

    def subset(self, indices: NDArray[np.int32], interpolation: str) -> NDArray[np.int32]:
        """The faces ("uniform") or points ("vertex") that were parts of, or near, chosen ones."""
        return np.flatnonzero(np.isin(self.nearest(interpolation), indices)).astype(np.int32)


def refined_topologies(
    meshes: Iterable[MeshDescription],
    layouts: Mapping[str, MeshLayout],
    refined: RefinedMesh,
    also: Collection[str] = (),
) -> dict[str, RefinedTopology]:
    """Topologies of the meshes that have a split, by path.

    meshes : all of the scene, in its order
    also : paths of meshes that are wanted as triangles even without a split
    """
    topologies = {}
    first_element = 0
    for mesh in meshes:
        corners, faces = mesh_triangles(mesh)
        begin, end = np.searchsorted(
            refined.element_parents, [first_element, first_element + len(faces)]
        )
        part = slice(int(begin), int(end))
        if mesh.path in also or (refined.elements[part] >= refined.vertex_count).any():
            parents = refined.element_parents[part] - first_element
            topologies[mesh.path] = _topology(
                mesh, layouts[mesh.path], refined, part, corners[parents], faces[parents]
            )
        first_element += len(faces)
    return topologies


def unsplit_mesh(
    meshes: Iterable[MeshDescription], layouts: Mapping[str, MeshLayout]
) -> RefinedMesh:
    """The scene's elements as an adaptive mesh without a split."""
    elements = [np.zeros((0, 3), np.int32)]
    for mesh in meshes:
        layout = layouts[mesh.path]
        corners, _ = mesh_triangles(mesh)
        elements.append(layout.corner_vertices[corners] + np.int32(layout.front.start))
    count = max((layout.back.stop for layout in layouts.values()), default=0)
    return RefinedMesh.unsplit(count, np.concatenate(elements))


def _topology(
    mesh: MeshDescription,
    layout: MeshLayout,
    refined: RefinedMesh,
    part: slice,
    parent_corners: NDArray[np.int32],
    parent_faces: NDArray[np.int32],
) -> RefinedTopology:
    """One mesh's part of the refined elements.

    parent_corners : (T, 3) int32, authored corners of the element of which each is a part
    parent_faces : (T,) int32, its face
    """
    authored = MeshTopology(mesh.face_vertex_counts, mesh.face_vertex_indices, len(mesh.points))
    winding = slice(None, None, -1 if mesh.flip_winding else 1)
    front = refined.elements[part, winding].ravel()
    weights = refined.barycentrics[part, winding].reshape(-1, 3)
    sources = np.repeat(parent_corners, 3, axis=0)

    is_new = front >= refined.vertex_count
    split = front[is_new] - refined.vertex_count
    indices = authored.indices[sources[np.arange(len(sources)), weights.argmax(axis=1)]]
    _, first, vertex = np.unique(split, return_index=True, return_inverse=True)
    corners = np.flatnonzero(is_new)[first]  # one at each split vertex
    # Unwelded edges are split at the same place, yet each has its own points.
    between = np.where(
        weights[corners] > _NO_WEIGHT, authored.indices[sources[corners]], np.int32(-1)
    )
    places = np.column_stack([refined.split_point[split[first]], np.sort(between, axis=1)])
    _, first, point = np.unique(places, axis=0, return_index=True, return_inverse=True)
    indices[is_new] = authored.point_count + point.ravel()[vertex]

    back = None
    if layout.back.stop > layout.back.start:
        back = front + np.int32(layout.back.start - layout.front.start)
        back[is_new] = refined.split_twin[split]
    return RefinedTopology(
        authored=authored,
        indices=indices,
        faces=parent_faces,
        corner_sources=sources,
        corner_weights=weights,
        point_corners=corners[first],
        front=front,
        back=back,
    )


def _blend(
    values: NDArray[Any], sources: NDArray[np.int32], weights: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(n, K) float64: sum over the columns of `sources` of weight times value."""
    out = np.zeros((len(sources), values.shape[1]))
    for column in range(sources.shape[1]):
        out += weights[:, column, None] * values[sources[:, column]]
    return out
