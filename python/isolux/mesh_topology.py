"""Faces and corners of a polygon mesh, and values spread over them by primvar interpolation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _core


@dataclass(frozen=True, slots=True)
class MeshTopology:
    """Which points each face joins.

    counts : (F,) int32, corners of each face
    indices : (C,) int32, point of each corner
    point_count : P
    """

    counts: NDArray[np.int32]
    indices: NDArray[np.int32]
    point_count: int

    def survey(self, threads: int) -> _core.TopologySurvey:
        """Extremes of counts and indices, and the degenerate faces, in one pass."""
        return _core.survey_topology(self.counts, self.indices, threads)

    def fault(self, survey: _core.TopologySurvey) -> str | None:
        """What makes the topology unreadable, in words; None where it is sound."""
        if len(self.counts) == 0:
            return "no faces"
        if survey.least_count < 0:
            return f"a face of {survey.least_count} corners"
        if survey.corners != len(self.indices):
            return (
                f"{survey.corners} corners by faceVertexCounts, "
                f"{len(self.indices)} faceVertexIndices"
            )
        if survey.corners == 0:
            return "faces without corners"
        low, high = survey.least_index, survey.greatest_index
        if low < 0 or high >= self.point_count:
            wrong = low if low < 0 else high
            return f"a corner at point {wrong} of {self.point_count} points"
        return None

    @property
    def starts(self) -> NDArray[np.int64]:
        """(F,) int64, first corner of each face."""
        return np.cumsum(self.counts, dtype=np.int64) - self.counts

    def first_corners(self, faces: NDArray[np.int64]) -> NDArray[np.int64]:
        """(n,) int64, first corner of each of the faces (n,)."""
        size = self.counts[0]
        return faces * size if (self.counts == size).all() else self.starts[faces]

    def value_count(self, interpolation: str) -> int | None:
        """How many values a primvar of this interpolation has; None: no such interpolation."""
        return {
            "constant": 1,
            "uniform": len(self.counts),
            "vertex": self.point_count,
            "varying": self.point_count,
            "faceVarying": len(self.indices),
        }.get(interpolation)

    def has_values(self, values: NDArray[Any], interpolation: str) -> bool:
        """Whether (n, K) values are as many as the interpolation wants."""
        return len(values) == self.value_count(interpolation)

    def values_of_corners(self, interpolation: str) -> NDArray[np.int32] | None:
        """(C,) int32, which of a primvar's values each corner has; None: each its own."""
        if interpolation == "faceVarying":
            return None
        if interpolation == "constant":
            return np.zeros(len(self.indices), np.int32)
        if interpolation == "uniform":
            return np.repeat(np.arange(len(self.counts), dtype=np.int32), self.counts)
        return self.indices

    def to_corners(self, values: NDArray[Any], interpolation: str) -> NDArray[Any]:
        """(n, K) values spread to (C, K); n as `value_count` says."""
        if interpolation == "constant":
            return np.broadcast_to(values, (len(self.indices), values.shape[1]))
        if interpolation == "uniform":
            return np.repeat(values, self.counts, axis=0)
        return values if interpolation == "faceVarying" else values[self.indices]

    def to_faces(self, values: NDArray[Any], interpolation: str) -> NDArray[Any]:
        """(n, K) values as (1, K) or (F, K): a face takes the mean of its corners."""
        if interpolation in ("constant", "uniform"):
            return values
        corners = self.to_corners(values, interpolation)
        totals = np.zeros((len(self.counts), values.shape[1]))
        filled = self.counts > 0
        if filled.any():
            # Face by face: what is infinite or huge in one is nothing to the others.
            totals[filled] = np.add.reduceat(corners, self.starts[filled], axis=0, dtype=np.float64)
        return totals / np.maximum(self.counts, 1)[:, None]

    def face_normals(
        self, points: NDArray[np.float64], faces: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """Area vectors by the corner order, twice the area long (Newell's rule).

        points : (P, 3) float64
        faces : (n,) int64, which faces; none without corners
        returns : (n, 3) float64
        """
        starts = self.first_corners(faces)
        return _core.area_vectors(points, self.indices, starts, self.counts[faces])
