"""Adaptive meshes made by hand: chosen edges of a scene's elements, split at a given fraction."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from isolux import _core
from isolux.core_scene import mesh_triangles
from isolux.scene_description import SceneDescription
from isolux.solution import MeshLayout, RefinedMesh

# By which of the edges 0-1, 1-2, 2-0 are split: triangles over the corners 0, 1, 2 and the split
# vertices 3, 4, 5 of those edges.
TEMPLATES = {
    (False, False, False): [(0, 1, 2)],
    (True, False, False): [(0, 3, 2), (3, 1, 2)],
    (False, True, False): [(0, 1, 4), (0, 4, 2)],
    (False, False, True): [(0, 1, 5), (1, 2, 5)],
    (True, True, False): [(3, 1, 4), (0, 3, 4), (0, 4, 2)],
    (False, True, True): [(4, 2, 5), (0, 1, 4), (0, 4, 5)],
    (True, False, True): [(0, 3, 5), (3, 1, 2), (3, 2, 5)],
    (True, True, True): [(0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)],
}


def layouts_of(scene: SceneDescription) -> dict[str, MeshLayout]:
    """The scene's illumination vertices, as the solver numbers them."""
    builder = _core.SceneBuilder(np.radians(40.0))
    for mesh in scene.meshes:
        builder.add_mesh(
            mesh.points,
            mesh.face_vertex_counts,
            mesh.face_vertex_indices,
            mesh.corner_normals,
            mesh.hole_faces,
            mesh.reflectance,
            mesh.double_sided,
            mesh.flip_winding,
        )
    lamp = np.zeros(3), np.eye(3), np.zeros(2), np.ones(3)  # a scene has light
    builder.add_luminaire("sphere", *lamp, 1.0, None)
    return {
        mesh.path: MeshLayout(slice(begin, middle), slice(middle, end), corners)
        for mesh, (begin, middle, end, corners) in zip(
            scene.meshes, builder.build(1).mesh_ranges, strict=True
        )
    }


class SplitMesh:
    """A scene's elements, and what became of them by splitting edges.

    Edges of a mesh between the same positions are one, welded or not.
    """

    def __init__(self, scene: SceneDescription, layouts: dict[str, MeshLayout]) -> None:
        elements, points, twins, first_point = [], [], [], 0
        for mesh in scene.meshes:
            layout = layouts[mesh.path]
            corners, _ = mesh_triangles(mesh)
            elements.append(layout.corner_vertices[corners] + layout.front.start)
            count = layout.front.stop - layout.front.start
            _, place = np.unique(mesh.points, axis=0, return_inverse=True)
            point = np.zeros(count, np.int64)
            on_surface = layout.corner_vertices >= 0
            point[layout.corner_vertices[on_surface]] = place.ravel()[
                mesh.face_vertex_indices[on_surface]
            ]
            back_count = layout.back.stop - layout.back.start
            points += [point + first_point, np.full(back_count, -1)]
            twins += [
                np.arange(count) + layout.back.start if back_count else np.full(count, -1),
                np.full(back_count, -1),
            ]
            first_point += len(mesh.points)
        self._point = np.concatenate(points)  # of each vertex
        self._twin = np.concatenate(twins)
        self._first_split_point = first_point
        self._split_points = 0
        elements = np.concatenate(elements).astype(np.int32)
        self.mesh = RefinedMesh.unsplit(len(self._point), elements)

    def split(self, choose: Callable[[int], np.ndarray], fraction: float = 0.5) -> RefinedMesh:
        """Split the edges where `choose` of their number is true; gives the mesh so far."""
        mesh = self.mesh
        ends = np.stack([mesh.elements, np.roll(mesh.elements, -1, axis=1)], axis=2).reshape(-1, 2)
        ends = np.take_along_axis(ends, self._point[ends].argsort(axis=1), axis=1)
        _, edge = np.unique(self._point[ends], axis=0, return_inverse=True)
        edge = edge.ravel()
        chosen = np.asarray(choose(edge.max() + 1), bool)
        number = np.cumsum(chosen) - 1 + self._split_points  # of each chosen edge's split point
        self._split_points += int(chosen.sum())

        marked = chosen[edge]
        parents, which = np.unique(ends[marked], axis=0, return_inverse=True)
        points = np.zeros(len(parents), np.int64)
        points[which.ravel()] = number[edge[marked]]
        two_sided = self._twin[parents[:, 0]] >= 0
        front = len(self._point) + np.arange(len(parents))
        back = front[-1:].max(initial=len(self._point) - 1) + np.cumsum(two_sided)
        twins = np.where(two_sided, back, -1)
        split_of_edge = np.full(len(ends), -1)
        split_of_edge[marked] = front[which.ravel()]

        new_parents = np.concatenate([parents, self._twin[parents[two_sided]]])
        new_points = np.concatenate([points, points[two_sided]])
        new_twins = np.concatenate([twins, np.full(two_sided.sum(), -1)])
        self._point = np.concatenate([self._point, self._first_split_point + new_points])
        self._twin = np.concatenate([self._twin, new_twins])

        elements, origin, weights = self._children(
            split_of_edge.reshape(-1, 3), ends.reshape(-1, 3, 2), fraction
        )
        self.mesh = RefinedMesh(
            vertex_count=mesh.vertex_count,
            split_parents=np.concatenate([mesh.split_parents, new_parents]).astype(np.int32),
            split_fraction=np.append(mesh.split_fraction, np.full(len(new_parents), fraction)),
            split_twin=np.append(mesh.split_twin, new_twins).astype(np.int32),
            split_point=np.append(mesh.split_point, new_points).astype(np.int32),
            elements=elements,
            element_parents=mesh.element_parents[origin],
            barycentrics=weights,
        )
        return self.mesh

    def _children(self, splits, ends, fraction):
        """Triangles by the templates: vertices, the element each is a part of, barycentrics."""
        mesh = self.mesh
        corners = np.concatenate([mesh.elements, splits], axis=1)
        at_second = np.where(ends[..., 0] == mesh.elements, fraction, 1 - fraction)[..., None]
        here, after = mesh.barycentrics, np.roll(mesh.barycentrics, -1, axis=1)
        places = np.concatenate([here, here * (1 - at_second) + after * at_second], axis=1)
        elements, origins, weights = [], [], []
        for marks, triangles in TEMPLATES.items():
            like_this = np.flatnonzero(((splits >= 0) == marks).all(axis=1))
            for triangle in triangles:
                elements.append(corners[like_this][:, triangle])
                origins.append(like_this)
                weights.append(places[like_this][:, triangle])
        origin = np.concatenate(origins)
        order = np.argsort(origin, kind="stable")
        return (
            np.concatenate(elements)[order].astype(np.int32),
            origin[order],
            np.concatenate(weights)[order],
        )


def every_edge(count: int) -> np.ndarray:
    return np.ones(count, bool)


def some_edges(seed: int) -> Callable[[int], np.ndarray]:
    """About half of them."""
    return lambda count: np.random.default_rng(seed).random(count) < 0.5
