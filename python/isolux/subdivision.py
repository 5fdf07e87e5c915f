"""Subdivision surfaces: the control cage, and what is given on it evaluated on the limit surface.

The solver sees the refined faces with their points on the limit surface. Results go back to the
cage, whose own rules spread them again: see `cage_results`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from . import _core
from .mesh_topology import MeshTopology

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

Scheme = Literal["catmullClark", "loop", "bilinear"]


@dataclass(frozen=True, slots=True)
class SubdivisionCage:
    """The control cage of a subdivision surface, its rules, and how often it was refined.

    topology : of the cage, all its faces
    faces, corners : of the cage, that take part, see `sound_faces`; None: all corners
    hole_faces : (H,) int32
    sharp_edges : (E, 2) int32, points; edge_sharpness : (E,) float32, from 10 on infinite
    sharp_points : (N,) int32; point_sharpness : (N,) float32
    scheme, boundary, face_varying : tokens of UsdGeomMesh
    smooth_triangles : triangleSubdivisionRule is smooth
    level : 0: the cage's own faces
    """

    topology: MeshTopology
    faces: NDArray[np.int32]
    corners: NDArray[np.int64] | None
    hole_faces: NDArray[np.int32]
    sharp_edges: NDArray[np.int32]
    edge_sharpness: NDArray[np.float32]
    sharp_points: NDArray[np.int32]
    point_sharpness: NDArray[np.float32]
    scheme: Scheme
    boundary: str
    face_varying: str
    smooth_triangles: bool
    level: int

    @property
    def sound(self) -> MeshTopology:
        """The faces that take part, of the corners that do."""
        if self.corners is None:
            return self.topology
        owners = np.repeat(np.arange(len(self.topology.counts)), self.topology.counts)
        counts = np.bincount(owners[self.corners], minlength=len(self.topology.counts))
        return MeshTopology(
            counts[self.faces].astype(np.int32),
            self.topology.indices[self.corners],
            self.topology.point_count,
        )

    def refine(self, value_indices: NDArray[np.int32] | None = None) -> RefinedSurface:
        """The refined faces, by OpenSubdiv.

        value_indices : (C,) int32, face-varying value of each corner of the cage; None: none
        raises : ValueError where OpenSubdiv refuses the cage
        """
        return RefinedSurface(self, value_indices)


def sound_faces(topology: MeshTopology) -> tuple[NDArray[np.int32], NDArray[np.int64] | None]:
    """Faces and corners that a surface can be made of; None for the corners: all.

    Of equal points next to each other one is left; what has fewer than three corners then, or one
    point twice, bounds no face.
    """
    faces = np.arange(len(topology.counts), dtype=np.int32)
    if topology.survey(1).degenerate_faces == 0:
        return faces, None
    owners = np.repeat(faces, topology.counts)
    before = np.arange(-1, len(owners) - 1)
    first = topology.starts[topology.counts > 0]
    before[first] = first + topology.counts[topology.counts > 0] - 1
    kept = topology.indices != topology.indices[before]
    counts = np.bincount(owners[kept], minlength=len(faces))
    points = owners.astype(np.int64) * topology.point_count + topology.indices
    distinct = np.bincount(np.unique(points[kept]) // topology.point_count, minlength=len(faces))
    sound = (counts >= 3) & (distinct == counts)
    return faces[sound], np.flatnonzero(kept & sound[owners])


class RefinedSurface:
    """A cage refined: faces, points on the limit surface, and values of the cage spread over them.

    Holds OpenSubdiv's topology of all levels, some 400 bytes a face: made anew where it is needed.
    """

    def __init__(self, cage: SubdivisionCage, value_indices: NDArray[np.int32] | None) -> None:
        self.cage = cage
        sound = cage.sound
        corners = slice(None) if cage.corners is None else cage.corners
        values = np.zeros(0, np.int32)
        if value_indices is not None:
            # OpenSubdiv counts the used values alone.
            self._used_values, used = np.unique(value_indices[corners], return_inverse=True)
            values = used.ravel().astype(np.int32)
            self._value_count = int(value_indices.max(initial=-1)) + 1
        is_hole = np.zeros(len(cage.topology.counts), bool)
        is_hole[cage.hole_faces] = True
        self._surface = _core.SubdividedSurface(
            cage.topology.point_count,
            sound.counts,
            sound.indices,
            np.flatnonzero(is_hole[cage.faces]).astype(np.int32),
            cage.sharp_edges,
            cage.edge_sharpness,
            cage.sharp_points,
            cage.point_sharpness,
            values,
            cage.scheme,
            cage.boundary,
            cage.face_varying,
            cage.smooth_triangles,
            cage.level,
        )

    @cached_property
    def topology(self) -> MeshTopology:
        surface = self._surface
        return MeshTopology(
            surface.face_vertex_counts(), surface.face_vertex_indices(), surface.point_count
        )

    @cached_property
    def cage_faces(self) -> NDArray[np.int32]:
        """(F,) int32, face of the cage of which each refined face is a part."""
        return self.cage.faces[self._surface.cage_faces()]

    @cached_property
    def corners_of_cage(self) -> NDArray[np.int32]:
        """(C,) int32, refined corner at each corner of the cage; -1 where that takes no part."""
        found = self._surface.corners_of_cage()
        if self.cage.corners is None:
            return found
        corners = np.full(len(self.cage.topology.indices), -1, np.int32)
        corners[self.cage.corners] = found
        return corners

    @property
    def hole_faces(self) -> NDArray[np.int32]:
        """Refined faces that are no surface, by holes or by the boundary rule."""
        return self._surface.hole_faces()

    def limit_points(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(V, 3) float64 on the limit surface, from the cage's (P, 3) points."""
        return self._surface.limit_points(np.ascontiguousarray(points, np.float64))

    def limit_normals(self, points: NDArray[np.float64]) -> NDArray[np.float32] | None:
        """(C, 3) float32 unit normals by the corner order, apart on the sides of sharp edges.

        None: the faces of a bilinear surface meet at any angle, as those of a polygon mesh do
        """
        if self.cage.scheme == "bilinear":
            return None
        return self._surface.limit_normals(np.ascontiguousarray(points, np.float64))

    def chord_error(self, points: NDArray[np.float64]) -> float:
        """Greatest distance of the last level's new points from the faces before it."""
        return self._surface.chord_error(np.ascontiguousarray(points, np.float64))

    @cached_property
    def limit_stencils(self) -> csr_matrix:
        """(V, P) weights of the cage's points at each refined point, on the limit surface."""
        return self._rows(self._surface.limit_stencils(), self.cage.topology.point_count)

    @cached_property
    def varying_stencils(self) -> csr_matrix:
        """(V, P) weights, linear over the cage's faces."""
        return self._rows(self._surface.varying_stencils(), self.cage.topology.point_count)

    def face_varying_stencils(self) -> tuple[csr_matrix, NDArray[np.int32]]:
        """(N, M) weights of the cage's M face-varying values; row of each refined corner, (C,)."""
        begin, columns, weights = self._surface.face_varying_stencils()
        rows = (begin, self._used_values[columns], weights)
        return self._rows(rows, self._value_count), self._surface.face_varying_indices()

    def refine_primvar(
        self,
        values: NDArray[Any],
        interpolation: str,
        indices: NDArray[np.int32] | None = None,
    ) -> NDArray[Any]:
        """A primvar of the cage on the refined faces, of the same interpolation.

        values : (n, K), as many as the interpolation wants; face-varying ones with `indices`, or
            one a corner: then equal values at a point are one
        indices : (C,) int32 of face-varying values
        returns : (1, K), (F, K), (V, K) or, face-varying, one a refined corner
        """
        if interpolation == "constant":
            return values
        if interpolation == "uniform":
            return values[self.cage_faces]
        if interpolation == "varying":
            return self.varying_stencils @ values
        if interpolation == "vertex":
            return self.limit_stencils @ values
        if indices is None:
            keys = np.column_stack([self.cage.topology.indices, values])
            _, first, same = np.unique(keys, axis=0, return_index=True, return_inverse=True)
            values, indices = values[first], same.ravel().astype(np.int32)
        stencils, corner_rows = self.cage.refine(indices).face_varying_stencils()
        return (stencils @ values[: stencils.shape[1]])[corner_rows]

    def nearest(self, interpolation: str) -> NDArray[np.int64]:
        """Row of the cage's values that is nearest to each refined one; exact for "uniform"."""
        if interpolation == "uniform":
            return self.cage_faces.astype(np.int64)
        if interpolation in ("vertex", "varying"):
            return _heaviest(self.varying_stencils)
        corners = np.arange(len(self.cage.topology.indices), dtype=np.int32)
        stencils, corner_rows = self.cage.refine(corners).face_varying_stencils()
        return _heaviest(stencils)[corner_rows]

    @staticmethod
    def _rows(rows: tuple[Any, Any, Any], columns: int) -> csr_matrix:
        from scipy.sparse import csr_matrix  # 0.2 s that only subdivided meshes pay

        begin, indices, weights = rows
        return csr_matrix((weights, indices, begin), shape=(len(begin) - 1, columns))


def _heaviest(stencils: csr_matrix) -> NDArray[np.int64]:
    """Column of the greatest weight of each row."""
    rows = np.repeat(np.arange(stencils.shape[0]), np.diff(stencils.indptr))
    order = np.lexsort((-stencils.data, rows))
    return stencils.indices[order[stencils.indptr[:-1]]].astype(np.int64)
