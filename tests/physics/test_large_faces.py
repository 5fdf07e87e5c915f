"""Walls of one quad reflect the light that falls on them, not what their corners know."""

from itertools import pairwise

import numpy as np
import pytest
from usd_scenes.shapes import merge, rectangle

from core_scenes import build, luminaire, surface
from solved_scenes import photometric, solved
from validation.rows import GLOBAL

SIDE, ABOVE = 4.0, 2.0  # m
LAMP = np.array([0.6, -0.4, 0.5])
FLUX, REFLECTANCE = 10_000.0, 0.8


def floor(cuts):
    """From (-2, -2) to (2, 2), in as many strips as the cuts part, front upwards."""
    ends = np.array([-SIDE / 2, *cuts, SIDE / 2])
    strips = [
        rectangle((-SIDE / 2, y, 0), (SIDE, 0, 0), (0, z - y, 0), 2 * SIDE)
        for y, z in pairwise(ends)
    ]
    return merge(*strips)


def triangle_floor():
    quad = floor([])
    a, b, c, d = quad.indices
    return type(quad)(quad.points, np.array([3, 3]), np.array([a, b, c, a, c, d]))


FLOORS = {
    "one quad": floor([]),
    "two triangles": triangle_floor(),
    "two strips of 0.1 and 3.9 m": floor([-1.9]),
    "a fine mesh": rectangle((-2, -2, 0), (SIDE, 0, 0), (0, SIDE, 0), 0.125),
}


def light_by_way_of_the_floor(points):
    """lx on a ceiling, by quadrature: the lamp's E = I h / d³ on the floor, reflected once."""
    x = (np.arange(400) + 0.5) * SIDE / 400 - SIDE / 2
    a, b = (grid.ravel() for grid in np.meshgrid(x, x))
    square = (a - LAMP[0]) ** 2 + (b - LAMP[1]) ** 2 + LAMP[2] ** 2
    exitance = REFLECTANCE * FLUX / (4 * np.pi) * LAMP[2] / square**1.5
    kernel = ABOVE**2 / np.pi * (SIDE / 400) ** 2
    return np.array(
        [
            (exitance * kernel / ((a - p) ** 2 + (b - q) ** 2 + ABOVE**2) ** 2).sum()
            for p, q, _ in points
        ]
    )


@pytest.mark.validation(GLOBAL)
@pytest.mark.parametrize("step", [0.5, 2 * SIDE])  # m
@pytest.mark.parametrize("name", FLOORS)
def test_a_ceiling_gets_the_light_of_a_lamp_close_above_a_floor(name, step, validation):
    ceiling = rectangle((-2, -2, ABOVE), (0, SIDE, 0), (SIDE, 0, 0), step)
    meshes = [
        surface(FLOORS[name], REFLECTANCE, double_sided=True, path="/Floor"),
        surface(ceiling, path="/Ceiling"),
    ]
    lamp = luminaire(FLUX, LAMP)
    solution = solved(meshes, [lamp], method="composite", photons=400_000)
    at = solution.layout("/Ceiling").front
    found, weights = photometric(solution, "indirect")[at], solution.vertex_areas[at]
    expected = light_by_way_of_the_floor(build(meshes, [lamp]).receiver_positions[at])
    rms = np.sqrt(np.average((found - expected) ** 2, weights=weights))
    case = f"light by way of {name} on a ceiling every {step:g} m, RMS error"
    validation.bound(case, rms / np.average(expected, weights=weights), at_most=0.02)
