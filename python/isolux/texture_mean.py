"""The mean of a texture over each face of a mesh, exact for square texels.

A texture is constant within each of its texels. Its integral over a triangle is, by Green's
theorem, the integral of F dy around the triangle, with F(x, y) the sum along the row of y up to x:
an effort that grows with the texels along the outline, not with those inside.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# Texel borders that one edge of a triangle may cross before it is sampled at that many points.
MAX_CROSSINGS = 1 << 14
# Crossings worked on at a time: tens of megabytes.
CHUNK_CROSSINGS = 1 << 19
CHUNK_TRIANGLES = 1 << 16
# A triangle thinner than this (area over outline, texels) is sampled: rounding would drown its sum.
THIN = 1e-6
# Places in a triangle without area, barycentric: the centres of its 16 equal parts.
_SIXTEENTHS = (
    np.array(
        [
            (i + a, j + a, 4 - i - j - 2 * a)
            for a in (1 / 3, 2 / 3)
            for i in range(4)
            for j in range(4)
            if i + j + 2 * a < 4
        ]
    )
    / 4
)
_GOLDEN = (np.sqrt(5) - 1) / 2


class TexelSums:
    """Sums of texels along their rows.

    texels : (H, W, C), the first row is the top of the picture
    wrap : across and down: "repeat", "mirror", "clamp" or "black"
    outside : (C,), value beyond the picture where it is "black"
    limits : (C,) the least and the greatest that a mean can be
    """

    def __init__(
        self, texels: NDArray[np.floating], wrap: tuple[str, str], outside: NDArray[np.floating]
    ) -> None:
        height, width, channels = texels.shape
        self._size = np.array([width, height])
        self._wrap = wrap
        self._outside = np.asarray(outside, np.float64)
        flat = texels.reshape(-1, channels)
        self.limits = flat.min(axis=0), flat.max(axis=0)
        if "black" in wrap:
            self.limits = (
                np.minimum(self.limits[0], outside),
                np.maximum(self.limits[1], outside),
            )
        self._sums = np.zeros((height, width + 1, channels))
        np.subtract(texels[::-1], self._outside, out=self._sums[:, 1:])
        np.cumsum(self._sums, axis=1, out=self._sums)

    @property
    def nbytes(self) -> int:
        return self._sums.nbytes

    def triangle_means(self, coordinates: NDArray[np.float64]) -> NDArray[np.float64]:
        """(T, C) float64 mean over each triangle.

        coordinates : (T, 3, 2) finite, (0, 0) is the lower left corner of the picture, (1, 1) the
            upper right one
        """
        means = np.empty((len(coordinates), self._sums.shape[2]))
        for first in range(0, len(coordinates), CHUNK_TRIANGLES):
            chunk = slice(first, first + CHUNK_TRIANGLES)
            means[chunk] = self._means(coordinates[chunk])
        return np.clip(means + self._outside, *self.limits)

    def _means(self, coordinates: NDArray[np.float64]) -> NDArray[np.float64]:
        corners = coordinates * self._size
        for axis, mode in enumerate(self._wrap):  # near the origin, where sums stay small
            period = self._size[axis] * {"repeat": 1, "mirror": 2}.get(mode, 0)
            if period:
                lowest = corners[..., axis].min(axis=1, keepdims=True)
                corners[..., axis] -= np.floor(lowest / period) * period
        steps = np.roll(corners, -1, axis=1) - corners
        area = 0.5 * (steps[:, 0, 0] * steps[:, 1, 1] - steps[:, 0, 1] * steps[:, 1, 0])
        outline = np.hypot(steps[..., 0], steps[..., 1]).sum(axis=1)
        means = np.empty((len(corners), self._sums.shape[2]))
        cells = np.floor(corners)
        single = (cells == cells[:, :1]).all(axis=(1, 2))  # within one texel
        means[single] = self._looked_up(corners[single, 0])
        thin = ~single & (np.abs(area) <= THIN * outline)
        means[thin] = self._sampled(corners[thin])
        wide = np.flatnonzero(~single & ~thin)
        means[wide] = self._integrated(corners[wide], steps[wide]) / area[wide, None]
        return means

    def _sampled(self, corners: NDArray[np.float64]) -> NDArray[np.float64]:
        points = np.einsum("sk,tkc->tsc", _SIXTEENTHS, corners)
        found = self._looked_up(points.reshape(-1, 2))
        return found.reshape(len(corners), len(_SIXTEENTHS), self._sums.shape[2]).mean(axis=1)

    def _looked_up(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, C) texel at each point."""
        column, inside_x = self._cell(points[:, 0], 0)
        row, inside_y = self._cell(points[:, 1], 1)
        found = self._sums[row, column + 1] - self._sums[row, column]
        return found * (inside_x & inside_y)[:, None]

    def _integrated(
        self, corners: NDArray[np.float64], steps: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """(T, C) integral of F dy around each triangle, texels²."""
        starts, steps = corners.reshape(-1, 2), steps.reshape(-1, 2)
        ends = starts + steps
        low, high = np.minimum(starts, ends), np.maximum(starts, ends)
        first = np.floor(low) + 1  # texel borders strictly between the ends of each edge
        counts = np.maximum(np.ceil(high) - first, 0)
        counts[steps == 0] = 0
        counts[steps[:, 1] == 0] = 0  # adds nothing to the integral
        many = counts.sum(axis=1) > MAX_CROSSINGS
        counts[many] = 0
        counts = counts.astype(np.int64)
        totals = np.zeros((len(starts), self._sums.shape[2]))
        pieces = counts.sum(axis=1) + 1
        chunks = np.searchsorted(
            np.cumsum(pieces), np.arange(CHUNK_CROSSINGS, pieces.sum(), CHUNK_CROSSINGS)
        )
        for edges in np.split(np.arange(len(starts)), np.unique(chunks)):
            if len(edges):
                totals[edges] = self._along(
                    starts[edges], steps[edges], first[edges], counts[edges]
                )
        for edge in np.flatnonzero(many):
            totals[edge] = self._at_strata(starts[edge], steps[edge])
        return totals.reshape(len(corners), 3, totals.shape[1]).sum(axis=1)

    def _along(
        self,
        starts: NDArray[np.float64],
        steps: NDArray[np.float64],
        first: NDArray[np.float64],
        counts: NDArray[np.int64],
    ) -> NDArray[np.float64]:
        """(E, C) integral of F dy along edges: F is linear between two texel borders."""
        edges = np.arange(len(starts))
        edge, place = [edges], [np.ones(len(starts))]
        for axis in (0, 1):
            number = counts[:, axis]
            owner = np.repeat(edges, number)
            nth = np.arange(len(owner)) - np.repeat(np.cumsum(number) - number, number)
            edge.append(owner)
            border = first[owner, axis] + nth
            place.append((border - starts[owner, axis]) / steps[owner, axis])
        owner, until = np.concatenate(edge), np.concatenate(place)
        order = np.lexsort((until, owner))
        owner, until = owner[order], until[order]
        since = np.zeros_like(until)
        since[1:] = np.where(owner[1:] == owner[:-1], until[:-1], 0.0)
        middle = starts[owner] + (0.5 * (since + until))[:, None] * steps[owner]
        weight = (until - since) * steps[owner, 1]
        values = self._row_sum(middle) * weight[:, None]
        return np.add.reduceat(values, np.searchsorted(owner, edges), axis=0)

    def _at_strata(
        self, start: NDArray[np.float64], step: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """(C,) the same along one edge of very many texels."""
        index = np.arange(MAX_CROSSINGS)
        # By the golden ratio within its stratum, or the places could fall in step with the rows.
        place = (index + (index * _GOLDEN) % 1.0) / MAX_CROSSINGS
        return self._row_sum(start + place[:, None] * step).mean(axis=0) * step[1]

    def _row_sum(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, C) F: sum of the row through each point, from x = 0 to the point."""
        row, inside = self._cell(points[:, 1], 1)
        x, width, mode = points[:, 0], int(self._size[0]), self._wrap[0]
        if mode in ("repeat", "mirror"):
            period = width if mode == "repeat" else 2 * width
            turns = np.floor(x / period)
            rest = x - turns * period
            returning = rest > width
            folded = np.where(returning, 2 * width - rest, rest)
            total = self._sums[row, width]
            sums = self._up_to(row, folded)
            sums = np.where(returning[:, None], 2 * total - sums, sums)
            sums += (turns * (period // width))[:, None] * total
        else:
            within = np.clip(x, 0, width)
            sums = self._up_to(row, within)
            if mode == "clamp":
                last = np.where(x < 0, 0, width - 1)
                edge = self._sums[row, last + 1] - self._sums[row, last]
                sums = sums + (x - within)[:, None] * edge
        return sums * inside[:, None]

    def _up_to(self, row: NDArray[np.int64], x: NDArray[np.float64]) -> NDArray[np.float64]:
        column = np.clip(x.astype(np.int64), 0, self._size[0] - 1)
        before, after = self._sums[row, column], self._sums[row, column + 1]
        return before + (x - column)[:, None] * (after - before)

    def _cell(
        self, place: NDArray[np.float64], axis: int
    ) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Which texel along an axis holds each place, and whether the picture reaches there."""
        size, mode = int(self._size[axis]), self._wrap[axis]
        cell = np.floor(np.clip(place, -1e15, 1e15)).astype(np.int64)
        if mode == "repeat":
            return cell % size, np.ones(cell.shape, bool)
        if mode == "mirror":
            folded = cell % (2 * size)
            return np.minimum(folded, 2 * size - 1 - folded), np.ones(cell.shape, bool)
        inside = (cell >= 0) & (cell < size)
        return np.clip(cell, 0, size - 1), inside | (mode == "clamp")
