"""The error that a solution reports is the error that it has.

True errors are of the values at the vertices, against closed forms, or of the means
over buckets, against forty times as many other photons. Both are estimates from one run: they are
compared in the mean over a few seeds.
"""

import numpy as np
import pytest
from usd_scenes.furnace_sphere.generate import icosphere
from usd_scenes.shapes import box

from core_scenes import (
    luminaire,
    relative_rms,
    retrace,
    shadowed_floor,
    shadowed_floor_at_vertices,
    shadowed_floor_illuminance,
    surface,
    trace,
)
from validation.rows import STOCHASTIC

pytestmark = pytest.mark.validation(STOCHASTIC)


def reported_and_true(scene, photons, seeds, truth, component, **settings):
    """RMS over the seeds of each. component : "total" or "indirect" """
    squares = []
    for seed in seeds:
        traced = retrace(scene, photons, seed)
        filtered = traced.filtered(**settings)
        values = filtered["indirect"][:, 0].astype(float)
        reported = filtered["rms_error_indirect"]
        if component == "total":
            values, reported = values + filtered["direct"][:, 0], filtered["rms_error"]
        squares.append([reported**2, relative_rms(values, truth, traced.areas) ** 2])
    return np.sqrt(np.mean(squares, axis=0))


# What sets the mean over a bucket apart from its vertex is known from the buckets around it alone,
# and told rather too large than too small.
LEAST, MOST = 0.75, 1.5


@pytest.fixture(scope="module")
def shadow():
    floor = shadowed_floor(16)
    return floor, shadowed_floor_illuminance(floor)


@pytest.mark.parametrize(("photons", "seeds"), [(10_000, 60), (80_000, 12), (640_000, 4)])
@pytest.mark.parametrize("settings", [{}, {"sharing": 0.0}, {"paper": True}], ids=str)
def test_on_a_shadowed_floor(validation, shadow, photons, seeds, settings):
    """Bias at the shadow's edge and noise together: from 45 % down to 6 %."""
    floor, _ = shadow
    truth = shadowed_floor_at_vertices(floor)
    reported, true = reported_and_true(floor, photons, range(seeds), truth, "total", **settings)
    case = f"reported over true RMS error, shadowed floor, {photons:,} photons {settings or ''}"
    validation.bound(case.strip(), reported / true, at_least=LEAST, at_most=MOST)


@pytest.fixture(scope="module")
def room():
    """A lamp in a corner of a room: I cosθ / d², and the indirect light of 1,600,000 photons."""
    lamp = np.array([1.2, 1.0, 1.4])
    walls = surface(box((4, 4, 4), 0.25).flipped(), 0.6)
    traced = trace([walls], [luminaire(1000.0, lamp)], 1_600_000, seed=99)
    to_lamp = lamp - traced.scene.receiver_positions
    squared = (to_lamp**2).sum(axis=1)
    cosine = (to_lamp * traced.scene.vertex_normals).sum(axis=1) / np.sqrt(squared)
    direct = 1000 / (4 * np.pi) * cosine / squared
    return traced, np.stack([direct, traced.illuminance[:, 1]], axis=1)


@pytest.mark.parametrize(("photons", "seeds"), [(5_000, 30), (40_000, 5)])
@pytest.mark.parametrize("component", ["total", "indirect"])
def test_in_a_room_with_bounces(validation, room, photons, seeds, component):
    scene, illuminance = room
    truth = illuminance[:, 1] if component == "indirect" else illuminance.sum(axis=1)
    reported, true = reported_and_true(scene, photons, range(seeds), truth, component)
    # The noise of the indirect light that stands for the truth adds to the true error's square.
    noise = np.sqrt(
        np.average(illuminance[:, 1] * scene.photon_flux / scene.areas, weights=scene.areas)
    )
    noise /= np.average(truth, weights=scene.areas)
    assert noise < 0.5 * true
    case = f"reported over true RMS error, room with bounces, {photons:,} photons, {component}"
    true = np.sqrt(true**2 - noise**2)
    validation.bound(case, reported / true, at_least=LEAST, at_most=MOST)


def test_the_buckets_error_is_eq_5(shadow):
    """Of buckets of area A with n hits each: √(ΣA (n A⁻²)) against the truth's deviation."""
    floor, truth = shadow
    reported, true = [], []
    for seed in range(4):
        traced = retrace(floor, 40_000, seed)
        reported.append(traced.filtered()["bucket_rms_error"])
        true.append(relative_rms(traced.illuminance[:, 0], truth, traced.areas))
    # 1,700 buckets, four times: a relative standard deviation of 1/√(2·6,800), thus 1 %, times
    # 1.5 for their unequal shares.
    assert np.mean(reported) == pytest.approx(np.mean(true), rel=0.05)


def test_batches_agree_with_counts_where_each_photon_hits_once(shadow):
    floor, _ = shadow
    ratios = []
    for seed in range(4):
        filtered = retrace(floor, 80_000, seed).filtered()
        ratios.append(filtered["batch_rms_error"] / filtered["bucket_rms_error"])
    # Variances from 16 batches scatter by √(2/15); half of it for their root, over 6,800 buckets.
    assert np.mean(ratios) == pytest.approx(1, abs=4 * np.sqrt(2 / 15) / 2 / np.sqrt(6800) * 1.5)


def test_batches_see_what_counts_do_not_where_photons_hit_one_bucket_twice():
    """Each of a photon's K hits meets any of the sphere's V equal buckets, with p = 1 / V.

    The variance of a bucket's count is E[K] p + (Var K - E[K]) p², where Eq. 5 has E[K] p alone.
    """
    reflectance, seeds = 0.95, 40
    sphere = trace([surface(icosphere(1).flipped(), reflectance)], [luminaire()], 16)
    mean, variance = 1 / (1 - reflectance), reflectance / (1 - reflectance) ** 2
    squares = []
    for seed in range(seeds):
        filtered = retrace(sphere, 1_000, seed).filtered()
        squares.append([filtered["batch_rms_error"] ** 2, filtered["bucket_rms_error"] ** 2])
    batch, bucket = np.mean(squares, axis=0)
    excess = 1 + (variance / mean - 1) / len(sphere.areas)
    assert excess > 1.4
    sigma = np.std(np.array(squares)[:, 0], ddof=1) / np.sqrt(seeds) / bucket
    assert sigma < 0.06
    assert batch / bucket == pytest.approx(excess, abs=4 * sigma)
