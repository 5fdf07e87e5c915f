"""Surfaces with a luminance on each side, and what of them a ray sees.

Backs of one-sided surfaces are not seen: one looks through them, so that a closed room can be
seen from outside.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ._core import RayCaster

# How many backs a ray may pass through before it is given up.
_MOST_BACKS = 32

# Step past a back, relative to the scene's extent: above the noise of float rays, below any gap
# between surfaces that a picture could show.
_STEP = 4e-6


@dataclass(frozen=True, slots=True)
class Surface:
    """Triangles of one mesh or lamp.

    points : (P, 3) float64, metres, world space
    triangles : (T, 3) int32 into points, counter-clockwise seen from the front
    front : (T, 3, 3) float32, cd/m² by channel, at each corner of each triangle
    back : the same on the back; None for one that isn't seen from there
    """

    points: NDArray[np.float64]
    triangles: NDArray[np.int32]
    front: NDArray[np.float32]
    back: NDArray[np.float32] | None = None


@dataclass(frozen=True, slots=True)
class Sight:
    """What each of n rays sees.

    side : (n,) int64, row of the luminance of the seen side; -1: nothing seen
    barycentrics : (n, 2) float32, weights of the triangle's second and third corner
    distance : (n,) float64, metres; infinite where nothing is seen
    """

    side: NDArray[np.int64]
    barycentrics: NDArray[np.float32]
    distance: NDArray[np.float64]


class VisibleSurfaces:
    """All surfaces of a scene, ready to be looked at.

    points : (P, 3) float64, metres; areas : (T,) float64, m²; middles : (T, 3) float64, metres
    low, high : (3,) float64, metres, bounds of all triangles that have an area
    """

    def __init__(self, surfaces: Sequence[Surface]) -> None:
        sizes = [len(surface.points) for surface in surfaces]
        first_points = np.cumsum(sizes) - sizes
        self.points = np.concatenate([surface.points for surface in surfaces])
        triangles = np.concatenate(
            [
                surface.triangles + first
                for surface, first in zip(surfaces, first_points, strict=True)
            ]
        ).astype(np.int32)
        counts = [len(surface.triangles) for surface in surfaces]
        backs = [surface.back for surface in surfaces]
        self._luminance = np.concatenate(
            [surface.front for surface in surfaces] + [back for back in backs if back is not None]
        )
        # Row of the back's luminance of each triangle, -1 for one-sided ones.
        self._back = np.full(len(triangles), -1, np.int64)
        two_sided = np.repeat([back is not None for back in backs], counts)
        self._back[two_sided] = len(triangles) + np.arange(np.count_nonzero(two_sided))

        a, b, c = (self.points[triangles[:, corner]] for corner in range(3))
        normals = np.cross(b - a, c - a)
        self.areas = np.linalg.norm(normals, axis=1) / 2
        self.middles = (a + b + c) / 3
        scale = np.where(self.areas > 0, 2 * self.areas, 1.0)
        self._normals = (normals / scale[:, None]).astype(np.float32)
        # Faces without area and points that no face uses can't be seen, however far they reach.
        seen = self.points[triangles[self.areas > 0]].reshape(-1, 3)
        seen = seen if len(seen) else self.points
        self.low, self.high = seen.min(axis=0), seen.max(axis=0)
        self._extent = float(np.ptp(self.points, axis=0).max())
        self._caster = RayCaster(self.points, triangles)

    def see(self, origins: NDArray[np.float64], directions: NDArray[np.float32]) -> Sight:
        """The nearest side that each ray sees.

        origins : (n, 3) float64, metres
        directions : (n, 3) float32, unit
        """
        side = np.full(len(origins), -1, np.int64)
        barycentrics = np.zeros((len(origins), 2), np.float32)
        distance = np.full(len(origins), np.inf)
        looking = np.arange(len(origins))
        travelled = np.zeros(len(origins))
        for _ in range(_MOST_BACKS):
            triangle, weights, length = self._caster.closest_hits(origins, directions)
            hit = np.flatnonzero(triangle >= 0)
            row, length = triangle[hit], length[hit]
            from_front = np.einsum("ij,ij->i", self._normals[row], directions[hit]) < 0
            seen = from_front | (self._back[row] >= 0)
            rays = looking[hit[seen]]
            side[rays] = np.where(from_front[seen], row[seen], self._back[row[seen]])
            barycentrics[rays] = weights[hit[seen]]
            distance[rays] = travelled[hit[seen]] + length[seen]

            through = hit[~seen]
            if len(through) == 0:
                break
            step = length[~seen] + _STEP * (self._extent + length[~seen])
            directions = directions[through]
            origins = origins[through] + step[:, None] * directions
            travelled = travelled[through] + step
            looking = looking[through]
        return Sight(side, barycentrics, distance)

    def luminance(self, sight: Sight) -> NDArray[np.float32]:
        """Luminance along each ray: (n, 3) float32, cd/m² by channel; 0 where nothing is seen."""
        seen = sight.side >= 0
        corners = self._luminance[sight.side[seen]]
        second, third = sight.barycentrics[seen].T
        weights = np.stack([1 - second - third, second, third], axis=1)
        luminance = np.zeros((len(seen), 3), np.float32)
        luminance[seen] = np.einsum("nk,nkc->nc", weights, corners)
        return luminance
