"""CIE 171:2006, cases 5.6 and 5.7: light that a surface of 4 m reflects, in a room 4 x 4 x 3 m.

What shines is a floor (5.6), or the wall at y = 4 behind a black box (5.7). The values are those
of the exact analytical solutions, in % of its exitance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from usd_scenes.shapes import box

from core_scenes import Array, surface

OBSTACLE_OF_CASE_5_7 = surface(box((4, 0.2, 1), 1.0).moved(2, 2.6, 0.5))


@dataclass(frozen=True, slots=True)
class Receiver:
    """A line of points on a surface.

    at : (N,) where along the line
    axis : what that counts
    points : (N, 3) m
    normal : of the surface there
    expected : (N,) %
    """

    at: Array
    axis: str
    points: Array
    normal: tuple[int, int, int]
    expected: list[float]


def _along(
    axis: str,
    at: Array,
    through: tuple[int, int, int],
    normal: tuple[int, int, int],
    expected: list[float],
) -> Receiver:
    """Points where the line through a point along "x", "y" or "z" has these coordinates, m."""
    points = np.tile(np.array(through, float), (len(at), 1))
    points[:, "xyz".index(axis)] = at
    return Receiver(at, f"{axis}, m", points, normal, expected)


CASE_5_6 = {
    "wall": _along(
        "z", np.arange(0.75, 3, 0.5), (4, 2, 0), (-1, 0, 0),
        [35.901, 27.992, 21.639, 16.716, 12.967],
    ),
    "ceiling": _along(
        "x", np.arange(0.25, 2, 0.5), (0, 2, 3), (0, 0, -1), [26.795, 30.939, 33.976, 35.567]
    ),
}  # fmt: skip
CASE_5_7 = {
    "wall": _along(
        "z", np.arange(2.75, 0, -0.5), (2, 0, 0), (0, 1, 0),
        [16.070, 16.333, 15.392, 13.320, 10.317, 7.079],
    ),
    "floor": _along(
        "y", np.arange(0.25, 2.5, 0.5), (2, 0, 0), (0, 0, 1), [3.380, 3.628, 3.013, 0, 0]
    ),
}  # fmt: skip
