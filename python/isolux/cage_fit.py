"""Values of a control cage from those on its limit surface, by weighted least squares.

The values c of the cage are those whose limit values S c come nearest to the values v: (SᵀAS) c =
SᵀA v, S the limit stencils, A the weights.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

# Relative residual of the normal equations at which the iteration stops, and the most steps: the
# condition of the limit masks is below 100 but for unused points.
FIT_ACCURACY = 2e-6
MAX_FIT_STEPS = 200
# Relative step at which the bounded iteration stops.
BOUNDED_ACCURACY = 1e-4


class CageFit:
    """Least squares on one stencil matrix, for any number of columns of values.

    stencils : (n, m) weights of m values of the cage at n places
    weights : (n,) float64 >= 0
    """

    def __init__(self, stencils: csr_matrix, weights: NDArray[np.float64]) -> None:
        if not weights.any():
            weights = np.ones_like(weights)
        self.stencils = stencils
        self._weighted = stencils.multiply(weights[:, None]).tocsr().T.tocsr()
        self._normal = (self._weighted @ stencils).tocsr()
        diagonal = self._normal.diagonal()
        self._diagonal = diagonal[:, None]
        self._preconditioner = ratio(np.ones_like(diagonal), diagonal)[:, None]
        # Greatest row sum, which no eigenvalue of the preconditioned equations passes [Gershgorin].
        sums = self._normal @ np.ones(len(diagonal))
        self._stiffness = float((self._preconditioner[:, 0] * sums).max(initial=0.0)) or 1.0

    def solve(
        self,
        values: NDArray[np.floating],
        start: NDArray[np.float64] | None = None,
        most: float = np.inf,
    ) -> NDArray[np.float64]:
        """(m, K) float64 in [0, most] from (n, K).

        No light is negative: where free least squares asks for negative values on the cage, those
        in the range whose limit comes nearest take their place.

        start : a first guess, such as the values of the stage before
        """
        first, same = _distinct_columns(values)
        wanted = self._weighted @ values[:, first].astype(np.float64)
        found = np.zeros_like(wanted) if start is None else start[:, first]
        found = self._unbounded(wanted, found)
        outside = ((found < 0) | (found > most)).any(axis=0)
        if outside.any():
            found[:, outside] = self._bounded(wanted[:, outside], found[:, outside], most)
        return found[:, same]

    def _unbounded(
        self, wanted: NDArray[np.float64], found: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """By conjugate gradients; a column that is done takes no part in further steps."""
        done = np.empty_like(found)
        left = np.arange(found.shape[1])
        found = found.copy()
        residual = wanted - self._normal @ found
        enough = FIT_ACCURACY * _lengths(self._preconditioner * wanted)
        direction = step = self._preconditioner * residual
        size = _dots(residual, step)
        for _ in range(MAX_FIT_STEPS):
            close = _lengths(step) <= enough
            if close.any():
                done[:, left[close]] = found[:, close]
                left, enough, size = left[~close], enough[~close], size[~close]
                if len(left) == 0:
                    return done
                found, residual, direction = (m[:, ~close] for m in (found, residual, direction))
            image = self._normal @ direction
            length = ratio(size, _dots(direction, image))
            found += length * direction
            residual -= length * image
            step = self._preconditioner * residual
            size, before = _dots(residual, step), size
            direction = step + ratio(size, before) * direction
        done[:, left] = found
        return done

    def _bounded(
        self, wanted: NDArray[np.float64], start: NDArray[np.float64], most: float
    ) -> NDArray[np.float64]:
        """By accelerated projected gradients [Beck and Teboulle 2009], each column as above.

        Their pace starts anew where they turn back [O'Donoghue and Candès 2015].
        """
        done = np.empty_like(start)
        left = np.arange(start.shape[1])
        found = ahead = np.clip(start, 0.0, most)
        pace = np.ones(len(left))
        rate = self._preconditioner / self._stiffness
        for _ in range(MAX_FIT_STEPS):
            gradient = rate * (self._normal @ ahead - wanted)
            found, before = np.clip(ahead - gradient, 0.0, most), found
            moved = found - before
            pace[_dots(self._diagonal * (ahead - found), moved) > 0] = 1.0
            pace, last = (1 + np.sqrt(1 + 4 * pace**2)) / 2, pace
            ahead = found + (last - 1) / pace * moved
            close = _lengths(moved) <= BOUNDED_ACCURACY * _lengths(found)
            if close.any():
                done[:, left[close]] = found[:, close]
                left, pace = left[~close], pace[~close]
                if len(left) == 0:
                    return done
                found, ahead, wanted = (m[:, ~close] for m in (found, ahead, wanted))
        done[:, left] = found
        return done


def _distinct_columns(values: NDArray[np.floating]) -> tuple[list[int], list[int]]:
    """Columns that differ, and for each its place among them: grey light has one of three."""
    place_of: dict[bytes, int] = {}
    first: list[int] = []
    same: list[int] = []
    for column, row in enumerate(values.T):
        place = place_of.setdefault(row.tobytes(), len(first))
        if place == len(first):
            first.append(column)
        same.append(place)
    return first, same


def _dots(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.einsum("ij,ij->j", a, b)


def _lengths(columns: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.sqrt(_dots(columns, columns))


def ratio(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """a / b, 0 where b is."""
    return np.divide(a, b, out=np.zeros_like(a), where=b > 0)
