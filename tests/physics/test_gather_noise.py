"""The noise that a gather tells: that by which its light differs from one seed to the next."""

import numpy as np
from usd_scenes.shapes import box

from core_scenes import luminaire, surface, trace
from isolux import _core
from isolux.solution import LUMINANCE_WEIGHTS


def test_light_of_other_rays_differs_as_told_also_where_surfaces_meet():
    """Rays that bounce on there do so by chance: a sequence gains little."""
    walls = surface(box((4, 4, 3), 0.25).flipped().moved(z=1.5), 0.5)
    block = surface(box((1, 1, 1), 0.125).moved(z=0.5), (0.7, 0.4, 0.2))
    known = trace([walls, block], [luminaire(10_000.0, (1, 1, 2.5))], 2_000_000)
    lit = np.ascontiguousarray(known.buckets.illuminance(known.scene).sum(axis=1))
    scene = known.scene
    found = [
        _core.FinalGather(scene, seed).advance(lit, 256 * scene.vertex_count, 2)
        for seed in range(8)
    ]
    light = np.array([one["indirect"] @ LUMINANCE_WEIGHTS for one in found])
    share = light.var(axis=0, ddof=1) / np.mean([one["standard_error"] ** 2 for one in found], 0)
    planes = np.array([[-2, 2], [-2, 2], [0, 3]])
    distances = np.abs(np.asarray(scene.receiver_positions)[:, :, None] - planes).min(axis=2)
    corners = (distances < 0.05).sum(axis=1) >= 2
    assert corners.sum() > 300
    assert 0.5 < share[corners].mean() < 1.4  # 1.7 by one share for all records
    assert 0.5 < share[~corners].mean() < 1.4
