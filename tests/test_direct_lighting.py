"""Direct light where something is in the way: shadows, many luminaires, the error that is told."""

import numpy as np
import pytest
from usd_scenes.hall.generate import luminaire_positions
from usd_scenes.shapes import box, rectangle

from core_scenes import (
    bucket_flux,
    build,
    luminaire,
    relative_rms,
    surface,
    trace,
)
from isolux import _core

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
DOWN = np.eye(3)  # local -Z is down
FLOOR = surface(rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0), 0.1))
BLOCKER = surface(rectangle((-0.5, -0.5, 1), (0.9, 0, 0), (0, 0.7, 0), 0.3), double_sided=True)
AREA_LAMP = luminaire(1000.0, (0, 0, 2), "rect", (0.6, 0.4), axes=DOWN)


def illuminate(scene, points=None, normals=None, *, seed=1, accuracy=0.01, indirect=(), threads=2):
    """Photometric; by default at the scene's own receivers."""
    if points is None:
        points, normals = scene.receiver_positions, scene.vertex_normals
    points = np.atleast_2d(np.asarray(points, float))
    normals = np.ascontiguousarray(np.broadcast_to(np.asarray(normals, np.float32), points.shape))
    found = _core.DirectLighting(scene, seed, accuracy).illuminate(
        points, normals, np.asarray(indirect, np.float32), threads
    )
    found["colour"] = found["illuminance"]
    found["illuminance"] = found["illuminance"].astype(float) @ LUMINANCE
    return found


def penumbra_illuminance(points, blocker=((-0.5, -0.5), (0.4, 0.2))):
    """Of AREA_LAMP past BLOCKER: the lamp less what the blocker hides of it, both rectangles.

    blocker : its low and its high corner
    """
    half = np.array([0.3, 0.2])
    # The blocker's corners on the lamp, seen from each point: it is at half of the lamp's height.
    hidden = np.clip(2 * np.array(blocker)[:, None] - points[:, :2], -half, half)

    def from_above(low, high):
        """Configuration factor of a parallel rectangle 2 m above, of four with a corner above."""

        def corner(x, y):
            a, b = x / 2, y / 2
            p, q = np.sqrt(1 + a * a), np.sqrt(1 + b * b)
            return (a / p * np.arctan(b / p) + b / q * np.arctan(a / q)) / (2 * np.pi)

        (x0, y0), (x1, y1) = (low - points[:, :2]).T, (high - points[:, :2]).T
        return corner(x1, y1) - corner(x0, y1) - corner(x1, y0) + corner(x0, y0)

    return 1000 / 0.24 * (from_above(-half, half) - from_above(*hidden))


@pytest.mark.parametrize("accuracy", [0.03, 0.01, 0.003])
def test_penumbra_of_an_area_light_and_its_told_error(accuracy):
    scene = build([FLOOR, BLOCKER], [AREA_LAMP])
    rng = np.random.default_rng(5)
    points = np.append(rng.uniform(-1.2, 1.2, (800, 2)), np.zeros((800, 1)), axis=1)
    truth = penumbra_illuminance(points)
    found = illuminate(scene, points, (0, 0, 1), accuracy=accuracy)
    error = found["illuminance"] - truth
    told = np.sqrt(np.mean(found["standard_error"].astype(float) ** 2))
    assert np.sqrt(np.mean((error / np.maximum(truth, truth.mean())) ** 2)) < accuracy
    assert 0.4 * told < np.sqrt(np.mean(error**2)) < 1.25 * told
    assert abs(error.mean()) < 0.2 * accuracy * truth.mean()  # no bias to either side


@pytest.mark.parametrize("accuracy", [0.03, 0.01])
def test_the_error_told_knows_of_cords_that_hide_from_all_shadow_rays(accuracy):
    """2 cm wide, before a lamp of 60: all rays of many points pass beside it."""
    cord = surface(rectangle((-0.01, -2, 1), (0.02, 0, 0), (0, 4, 0), 0.02), double_sided=True)
    scene = build([FLOOR, cord], [AREA_LAMP])
    rng = np.random.default_rng(6)
    points = np.append(rng.uniform(-1.2, 1.2, (20_000, 2)), np.zeros((20_000, 1)), axis=1)
    truth = penumbra_illuminance(points, ((-0.01, -2), (0.01, 2)))
    found = illuminate(scene, points, (0, 0, 1), accuracy=accuracy)
    told = np.sqrt(np.mean(found["standard_error"].astype(float) ** 2))
    true = np.sqrt(np.mean((found["illuminance"] - truth) ** 2))
    assert 0.8 * true < told < 1.4 * true


def test_light_from_elsewhere_saves_shadow_rays():
    scene = build([FLOOR, BLOCKER], [AREA_LAMP])
    alone = illuminate(scene)
    beside = illuminate(scene, indirect=np.full(len(alone["illuminance"]), 500.0))
    assert beside["shadow_rays"] < 0.6 * alone["shadow_rays"]


def test_a_point_of_light_needs_one_shadow_ray_a_receiver():
    scene = build([FLOOR, BLOCKER], [luminaire(1000.0, (0, 0, 2), size=(1e-5, 0.0))])
    found = illuminate(scene)
    facing = (scene.receiver_positions[:, 2] < 2) & (scene.vertex_normals[:, 2] > 0)
    assert found["shadow_rays"] == facing.sum()


def test_direct_photons_have_the_same_illuminance_in_the_mean():
    """DDL takes the place of DDEPT's direct light: both are the same quantity."""
    photons = 200_000
    gamma = np.radians(np.arange(0, 181, 5.0))
    both_sides = _core.CandelaDistribution(gamma, np.zeros(1), (1.2 + np.cos(3 * gamma))[None])
    for diagram in (None, both_sides):
        for shape, size in {"rect": (0.6, 0.4), "sphere": (0.2, 0), "disk": (0.3, 0),
                            "cylinder": (0.1, 0.8)}.items():  # fmt: skip
            tilt = np.array([(1, 0, 0), (0, 0.8, -0.6), (0, 0.6, 0.8)])
            lamp = luminaire(1000.0, (0.1, 0.2, 1.6), shape, size, axes=tilt)
            traced = trace([FLOOR, BLOCKER], [lamp], photons, diagram=diagram)

            def at(points, normals, scene=traced.scene):
                return illuminate(scene, points, normals, accuracy=0.02)["illuminance"]

            expected = bucket_flux(traced, at, divisions=3) / traced.photon_flux
            counts = traced.hits[traced.front(), 0]
            # Buckets of 16 at a time, so that each holds many photons.
            order = np.lexsort(traced.scene.vertex_positions[traced.front(), :2].T.round(0))
            expected, counts = (np.add.reduceat(a[order], range(0, len(a), 16))
                                for a in (expected, counts))  # fmt: skip
            kept = expected > 20
            chi = ((counts - expected)[kept] ** 2 / expected[kept]).mean()
            assert chi == pytest.approx(1.0, abs=0.5), (shape, diagram)
            four_sigma = 4 * np.sqrt(expected.sum())
            assert counts.sum() == pytest.approx(expected.sum(), abs=four_sigma), (shape, diagram)


def test_superposition_of_luminaires():
    red = luminaire(700.0, (1, 0, 2), "disk", (0.2, 0.0), axes=DOWN, colour=(4.0, 0.2, 0.1))
    scenes = [build([FLOOR], lamps) for lamps in ([AREA_LAMP, red], [AREA_LAMP], [red])]
    both, first, second = (illuminate(scene)["colour"] for scene in scenes)
    assert both == pytest.approx(first + second, rel=1e-5)


def hall_like(count):
    """Columns under a ceiling full of luminaires of one total flux."""
    columns = [
        surface(box((0.4, 0.4, 3), 0.5).moved(x, y, 1.5)) for x in (5, 15, 25, 35) for y in (6, 18)
    ]
    floor = surface(rectangle((0, 0, 0), (40, 0, 0), (0, 24, 0), 1.5))
    at = luminaire_positions(count)
    lamps = [
        luminaire(
            260_000.0 / count,
            (x, z, 3.2 + 0.2 * y),
            "disk",
            (0.06, 0.0),
            axes=DOWN,
            colour=(1.2, 0.95, 0.9) if i % 3 else (0.8, 1.05, 1.1),
        )
        for i, (x, y, z) in enumerate(at)
    ]
    return [floor, *columns], lamps


def test_many_luminaires_by_the_tree_as_one_by_one():
    meshes, lamps = hall_like(600)
    scene = build(meshes, lamps)
    lit = np.random.default_rng(2).choice(len(scene.vertex_areas), 400, replace=False)
    points, normals = scene.receiver_positions[lit], scene.vertex_normals[lit]
    parts = [
        illuminate(build(meshes, lamps[i : i + 30]), points, normals, accuracy=2e-3, seed=i)
        for i in range(0, len(lamps), 30)  # too few for a tree
    ]
    truth = sum(part["illuminance"] for part in parts)
    colour = sum(part["colour"].astype(float) for part in parts)
    found = illuminate(scene, points, normals, accuracy=0.01)
    error = found["illuminance"] - truth
    told = np.sqrt(np.mean(found["standard_error"].astype(float) ** 2))
    assert 0.4 * told < np.sqrt(np.mean(error**2)) < 1.5 * told
    assert relative_rms(found["illuminance"], truth, np.ones(len(lit))) < 0.02
    assert found["shadow_rays"] < 0.3 * sum(part["shadow_rays"] for part in parts)
    # No bias, in no channel.
    assert found["colour"].mean(axis=0) == pytest.approx(colour.mean(axis=0), rel=3e-3)


def test_as_many_bits_on_one_and_two_threads():
    for meshes, lamps in (([FLOOR, BLOCKER], [AREA_LAMP]), hall_like(200)):
        scene = build(meshes, lamps)
        one, two = (illuminate(scene, threads=threads) for threads in (1, 2))
        assert one["colour"].tobytes() == two["colour"].tobytes()
        assert one["standard_error"].tobytes() == two["standard_error"].tobytes()
        assert one["shadow_rays"] == two["shadow_rays"]


def test_a_receiver_depends_on_nothing_but_itself():
    scene = build([FLOOR, BLOCKER], [AREA_LAMP])
    whole = illuminate(scene)["colour"]
    back = illuminate(scene, scene.receiver_positions[::-1], scene.vertex_normals[::-1])["colour"]
    assert np.array_equal(whole, back[::-1])


def test_a_luminaire_flush_with_a_ceiling_lights_all_below_and_nothing_on_it():
    """Far from the origin, too, where coordinates are coarse."""
    for origin in (np.zeros(3), np.array([3e4, -2e4, 1e4])):
        room = surface(box((4, 4, 3), 0.5).moved(*origin).flipped())
        lamp = luminaire(1000.0, origin + np.array([0, 0, 1.5]), "rect", (1.0, 1.0))
        scene = build([room], [lamp])
        found = illuminate(scene)["illuminance"]
        on_ceiling = scene.vertex_normals[:, 2] < -0.5
        assert not found[on_ceiling].any()
        flux = found[~on_ceiling] @ scene.vertex_areas[~on_ceiling]
        assert flux == pytest.approx(1000.0, rel=0.02)  # of vertices for their buckets


def test_hard_places():
    scene = build([FLOOR], [luminaire(1000.0, (0, 0, 1), "rect", (1.0, 1.0))])
    in_its_plane, on_it, on_its_edge = (3, 0, 1), (0.2, 0.1, 1), (0.5, 0, 1)
    found = illuminate(scene, [in_its_plane, on_it, on_its_edge], (0, 0, 1))
    assert not found["illuminance"].any()
    touching = illuminate(scene, (0.2, 0.1, 1 - 1e-7), (0, 0, 1))["illuminance"]
    assert touching == pytest.approx(1000.0, rel=1e-3)  # all it sees is the luminaire
    assert not illuminate(scene, (0, 0, 0), (0, 0, 0))["illuminance"].any()  # no normal

    gamma = np.radians([0.0, 180.0])
    even = _core.CandelaDistribution(gamma, np.zeros(1), np.ones((1, 2)))
    for size in ((0.0, 0.0), (0.3, 0.0)):
        scene = build([FLOOR], [luminaire(1000.0, (0, 0, 1), "disk", size)], even)
        points = [(0, 0, 1), (0.1, 0, 1 - 1e-9), (0.1, 0, 1 - 1e-3), (0, 0, 0)]
        found = illuminate(scene, points, (0, 0, 1))["illuminance"]
        assert np.isfinite(found).all()
    assert found[-1] == pytest.approx(1000 / (4 * np.pi) * 2 * (1 - 1.09**-0.5) / 0.09, rel=1e-3)
