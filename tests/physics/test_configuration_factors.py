"""Means over a receiver of direct light, against factors from one area to another; polygons.

The factor from surface 1 to surface 2 is the share of 1's flux that arrives at 2.
"""

from dataclasses import replace

import numpy as np
import pytest
from test_direct_illuminance import direct
from usd_scenes.shapes import Shape

from core_scenes import build, luminaire, shining
from isolux import _core
from isolux.solution import LUMINANCE_WEIGHTS
from validation.rows import DIRECT

pytestmark = pytest.mark.validation(DIRECT)

FLUX = 1000.0  # lm
# Of the unit cube; the adjacent one is defined by the others: all six faces together see 1.
PARALLEL, ADJACENT = 0.19982490, 0.20004378
COAXIAL_DISKS = 0.38196601  # of radius and distance alike: (3 - √5) / 2


def quadrature(n):
    """Gauss nodes and weights in [0, 1]."""
    nodes, weights = np.polynomial.legendre.leggauss(n)
    return (nodes + 1) / 2, weights / 2


def over_square(corner, side, other):
    """Points (n, 3) and weights of a parallelogram."""
    nodes, weights = quadrature(48)
    # Dense towards all edges, where an adjacent face's light changes without a limit.
    at = nodes**2 * (3 - 2 * nodes)
    weights = weights * 6 * nodes * (1 - nodes)
    u, v = (grid.ravel() for grid in np.meshgrid(at, at))
    points = np.asarray(corner) + np.outer(u, side) + np.outer(v, other)
    return points, np.outer(weights, weights).ravel()


def test_faces_of_a_cube(validation):
    assert pytest.approx(1.0, abs=1e-7) == PARALLEL + 4 * ADJACENT
    lamp = luminaire(FLUX, (0.5, 0.5, 1.0), "rect", (1.0, 1.0))
    opposite, weights = over_square((0, 0, 0), (1, 0, 0), (0, 1, 0))
    found = direct([lamp], opposite, (0, 0, 1))["illuminance"] @ weights
    validation.check("9 unit cube, parallel faces", PARALLEL, found / FLUX, relative=1e-4, unit="")
    wall, weights = over_square((0, 0, 0), (0, 1, 0), (0, 0, 1))
    found = direct([lamp], wall, (1, 0, 0))["illuminance"] @ weights
    validation.check("9 unit cube, adjacent faces", ADJACENT, found / FLUX, relative=1e-4, unit="")


def test_coaxial_disks(validation):
    lamp = luminaire(FLUX, (0, 0, 1), "disk", (1.0, 0.0))
    nodes, weights = quadrature(40)
    points = np.stack([nodes, 0 * nodes, 0 * nodes], axis=1)
    found = direct([lamp], points, (0, 0, 1))["illuminance"] @ (2 * np.pi * nodes * weights)
    validation.check("10 coaxial disks", COAXIAL_DISKS, found / FLUX, relative=1e-4, unit="")


POLYGONS = {
    "triangle": [(-0.5, 0, 1), (0.1, 0.8, 1.4), (0.7, -0.4, 1.2)],
    "hexagon": [(np.cos(a), np.sin(a), 1 + 0.5 * np.cos(a)) for a in np.arange(6) * np.pi / 3],
    "arrow": [(0, 0.8, 1), (0.7, -0.6, 1), (0, -0.2, 1), (-0.7, -0.6, 1)],  # not convex
    "half below the horizon": [(1, -1, -1), (1, 1, -1), (1, 1, 1), (1, -1, 1)],
}


@pytest.mark.parametrize("name", POLYGONS)
def test_polygon(validation, name):
    """Lambert: E = L/2 Σ Γ·n over the edges of what is above the receiver's horizon."""
    corners = np.array(POLYGONS[name], float)
    luminance = 1000.0
    order = np.arange(len(corners))
    shape = Shape(corners, np.array([len(order)]), order)
    normal_to_us = np.cross(corners[1] - corners[0], corners[-1] - corners[0]) @ corners[0] < 0
    lamp = shining(shape if normal_to_us else shape.flipped(), luminance)
    scene = build([lamp], [replace(luminaire(shape="mesh"), path=lamp.path)])
    found = (
        _core.DirectLighting(scene, 1, 0.01).illuminate(
            np.zeros((1, 3)), np.array([(0, 0, 1)], np.float32), np.zeros(0, np.float32), 1
        )["illuminance"]
        @ LUMINANCE_WEIGHTS
    )
    validation.check(f"7 polygon, {name}", lambert(corners, luminance), found, relative=1e-4)


def lambert(corners, luminance):
    """lx at the origin, facing +Z."""
    above = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if a[2] >= 0:
            above.append(a)
        if a[2] * b[2] < 0:
            above.append(a + (b - a) * a[2] / (a[2] - b[2]))
    total = 0.0
    for a, b in zip(above, np.roll(above, -1, axis=0), strict=True):
        cross = np.cross(a, b)
        sine = np.linalg.norm(cross)
        if sine > 0:
            total += np.arctan2(sine, a @ b) * cross[2] / sine
    return abs(luminance / 2 * total)
