"""Reported 95 % intervals hold the truth as often as they say, at vertices, over some seeds.

The truth is a closed form at the place where each vertex samples light. The long form of this, in
more scenes and over 200 seeds, is tools/coverage.py; its table is tests/validation/coverage.csv.
"""

import numpy as np
import pytest
from scipy.stats import norm
from usd_scenes.shapes import box

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


def covered(scene, truth, photons, **settings):
    """Share of the vertices whose interval holds the truth, of each seed."""
    shares = []
    for seed in range(SEEDS):
        filtered = retrace(scene, photons, seed).filtered(**settings)
        values = filtered["direct"][:, 0].astype(float)
        bound = Z95 * filtered["direct_standard_error"] + 1e-5 * truth
        shares.append((np.abs(values - truth) <= bound).mean())
    return np.array(shares)


def assert_covers(shares, least, most):
    """Vertices of one seed share photons: the margin is by how much the seeds differ."""
    margin = 3 * shares.std(ddof=1) / np.sqrt(SEEDS)
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


def floor_beside_a_shadow():
    floor = shadowed_floor(16)
    return floor, shadowed_floor_at_vertices(floor)


@pytest.mark.parametrize("photons", [300, 3_000, 30_000, 300_000])
def test_smooth_light(photons):
    """Noise, the filter's bias, and coarse buckets that hold what varies by half within them."""
    scene, truth = lamp_in_a_room()
    assert_covers(covered(scene, truth, photons), 0.92, 0.99)


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
