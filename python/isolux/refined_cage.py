"""The adaptive mesh of a subdivision surface, as its cage sees it: triangles of the limit surface.

A primvar of the cage spreads twice: over the refined faces by the rules of subdivision, then
linearly over their triangles.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .mesh_topology import MeshTopology
from .refined_topology import RefinedTopology
from .subdivision import SubdivisionCage


class RefinedCageTopology:
    """What `RefinedTopology` tells, with the cage in place of the faces that the solver saw.

    topology : of the triangles over the refined faces; kept as `solved`
    cage : whose faces those are parts of
    """

    def __init__(self, topology: RefinedTopology, cage: SubdivisionCage) -> None:
        self.solved = topology
        self._surface = cage.refine()

    @property
    def authored(self) -> MeshTopology:
        return self._surface.cage.topology

    @property
    def indices(self) -> NDArray[np.int32]:
        return self.solved.indices

    @property
    def faces(self) -> NDArray[np.int32]:
        """(T,) int32, face of the cage of which each triangle is a part."""
        return self._surface.cage_faces[self.solved.faces]

    def interpolated(self, values: NDArray[Any], interpolation: str) -> NDArray[np.float64]:
        """As RefinedTopology: (n, K) values of the cage at the points or corners of triangles."""
        refined = self._surface.refine_primvar(values, interpolation)
        return self.solved.interpolated(refined, interpolation)

    def nearest(self, interpolation: str) -> NDArray[np.int64]:
        """Row of the cage's values that is nearest to each new one; exact for "uniform"."""
        return self._surface.nearest(interpolation)[self.solved.nearest(interpolation)]

    def subset(self, indices: NDArray[np.int32], interpolation: str) -> NDArray[np.int32]:
        """The faces ("uniform") or points ("vertex") that were parts of, or near, chosen ones."""
        return np.flatnonzero(np.isin(self.nearest(interpolation), indices)).astype(np.int32)
