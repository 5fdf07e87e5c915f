"""Reported 95 % intervals hold the truth as often as they say, at vertices, over some seeds.

The truth is a closed form at the place where each vertex samples light. The long form of this, in
more scenes and over 200 seeds, is tools/coverage.py; its table is tests/validation/coverage.csv.
"""

import numpy as np
import pytest
from scipy.stats import norm
from usd_scenes.shapes import box, rectangle

from core_scenes import (
    luminaire,
    retrace,
    shadowed_floor,
    shadowed_floor_at_vertices,
    surface,
    trace,
)

Z95 = norm.ppf(0.975)
SEEDS = 10


def covered(scene, truth, photons, part="direct", at=slice(None), seeds=SEEDS, **settings):
    """Share of the vertices whose interval holds the truth, of each seed."""
    shares = []
    for seed in range(seeds):
        filtered = retrace(scene, photons, seed).filtered(**settings)
        values = filtered[part][at, 0].astype(float)
        bound = Z95 * filtered[part + "_standard_error"][at] + 1e-5 * truth[at]
        shares.append((np.abs(values - truth[at]) <= bound).mean())
    return np.array(shares)


def assert_covers(shares, least, most):
    """Vertices of one seed share photons: the margin is by how much the seeds differ."""
    margin = 3 * shares.std(ddof=1) / np.sqrt(len(shares))
    assert margin < 0.06
    assert least - margin <= shares.mean() <= most + margin


def lamp_in_a_room():
    lamp = np.array([1.2, 1.0, 1.4])
    walls = surface(box((4, 4, 4), 0.5).flipped())
    traced = trace([walls], [luminaire(1000.0, lamp)], 16)
    to_lamp = lamp - traced.scene.receiver_positions
    squared = (to_lamp**2).sum(axis=1)
    cosine = (to_lamp * traced.scene.vertex_normals).sum(axis=1) / np.sqrt(squared)
    return traced, 1000 / (4 * np.pi) * cosine / squared


def floor_before_a_wall():
    """A lamp lights a wall of 0.8, the wall a black floor: E = ∫ ρ E_wall z y / (π r⁴) dA."""
    flux, reflectance, lamp = 1000.0, 0.8, np.array([0, 0, 2])
    floor = surface(rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0), 0.5))
    wall = surface(rectangle((-2, 2, 0), (4, 0, 0), (0, 0, 4), 0.5), reflectance)
    traced = trace([floor, wall], [luminaire(flux, lamp)], 16)
    heights = np.concatenate([[0.0], np.geomspace(1e-3, 4.0, 160)])
    x, z = np.meshgrid(np.arange(-1.9975, 2.0, 0.005), (heights[1:] + heights[:-1]) / 2)
    areas = 0.005 * np.diff(heights)[:, None]
    squared = x**2 + 2.0**2 + (z - 2.0) ** 2
    exitance = reflectance * flux / (4 * np.pi) * 2.0 / squared**1.5
    truth = np.zeros(len(traced.areas))
    for vertex in range(*traced.front().indices(len(truth))):
        at = traced.scene.receiver_positions[vertex]
        depth = 2.0 - at[1]
        r2 = (x - at[0]) ** 2 + depth**2 + (z - at[2]) ** 2
        truth[vertex] = (exitance * (z - at[2]) * depth / (np.pi * r2**2) * areas).sum()
    return traced, truth


def floor_beside_a_shadow():
    floor = shadowed_floor(16)
    return floor, shadowed_floor_at_vertices(floor)


@pytest.mark.parametrize("photons", [300, 3_000, 30_000, 300_000])
def test_smooth_light(photons):
    """Noise, the filter's bias, and coarse buckets that hold what varies by half within them."""
    scene, truth = lamp_in_a_room()
    assert_covers(covered(scene, truth, photons), 0.92, 0.99)


def test_light_where_walls_meet():
    """Buckets and supports lie on one side of such vertices: their bias is the slope's."""
    scene, truth = lamp_in_a_room()
    at_edge = (np.abs(scene.scene.vertex_positions) == 2).sum(axis=1) >= 2
    assert_covers(covered(scene, truth, 30_000, at=at_edge), 0.95, 0.99)


def test_what_a_wall_reflects_to_the_floor_before_it():
    """It falls to the line where both meet with a slope that has no bound."""
    scene, truth = floor_before_a_wall()
    at_wall = (scene.scene.vertex_positions[:, 1] == 2) & (truth > 0)
    shares = covered(scene, truth, 30_000, "indirect", at=at_wall, seeds=100)
    assert_covers(shares, 0.93, 0.99)


@pytest.mark.parametrize(("photons", "least"), [(3_000, 0.90), (30_000, 0.93)])
def test_a_hard_shadow(photons, least):
    """Its border lies between vertices, and few photons don't tell where."""
    scene, truth = floor_beside_a_shadow()
    assert_covers(covered(scene, truth, photons), least, 0.99)


@pytest.mark.parametrize("photons", [3_000, 300_000])
def test_without_filter(photons):
    """Few photons a bucket, or none: the interval of a count."""
    scene, truth = lamp_in_a_room()
    assert_covers(covered(scene, truth, photons, accuracy=1.0, sharing=0.0), 0.93, 0.99)
