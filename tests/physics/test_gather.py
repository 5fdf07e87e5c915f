"""Gathered indirect light against what is known of it."""

from dataclasses import replace

import numpy as np
import pytest
from usd_scenes.furnace_sphere.generate import icosphere
from usd_scenes.shapes import box, rectangle

from core_scenes import Traced, distant, luminaire, retrace, surface, trace
from hand_built import scene_of
from isolux import _core
from isolux.core_scene import build_core_scene
from isolux.settings import SolverSettings
from validation.rows import GLOBAL

pytestmark = pytest.mark.validation(GLOBAL)

WEIGHTS = [0.2126, 0.7152, 0.0722]


def gathered(traced, illuminance, rays, seed=1):
    """indirect (V,) lx, and the rest. illuminance : (V,) lx that falls on each vertex"""
    cache = np.repeat(np.asarray(illuminance, np.float32)[:, None], 3, axis=1)
    found = _core.FinalGather(traced.scene, seed).advance(cache, rays, 2)
    return found["indirect"] @ WEIGHTS, found


@pytest.mark.parametrize("reflectance", [0.2, 0.6, 0.9])
def test_light_from_the_centre_of_a_closed_sphere_comes_back_evenly(validation, reflectance):
    """Furnace: every ray meets the same exitance, ρΦ / (A (1 - ρ)) comes back everywhere."""
    sphere = icosphere(4).flipped()
    traced = trace([surface(sphere, reflectance)], [luminaire(1000.0)], 1000)
    total = 1000 / (sphere.area() * (1 - reflectance))
    indirect, found = gathered(traced, np.full(len(traced.areas), total), 10_000)
    # The facets are up to 0.3 % nearer to the lamp than the mean.
    case = f"furnace, sphere of ρ {reflectance}, each point by gather"
    validation.check(case, reflectance * total, indirect, relative=0.01)
    assert found["indirect_rms"] < 0.01 * reflectance * total


@pytest.mark.parametrize("reflectance", [0.2, 0.5, 0.8, 0.95])
def test_mean_indirect_light_in_the_cube_of_cie_171_case_5_8(reflectance):
    """With photons as the cache; the mean of a closed room is exact, ρΦ / (S (1 - ρ))."""
    cube = surface(box((4, 4, 4), 0.125).flipped(), reflectance)
    photons = int(300_000 * (1 - reflectance))
    traced = trace([cube], [luminaire(10_000.0)], photons)
    indirect, found = gathered(traced, traced.illuminance.sum(axis=1), 150_000)
    expected = reflectance * 10_000 / (96 * (1 - reflectance))
    # The mean of the cache has the relative standard deviation √(ρ / N); that of the vertices may
    # be off by some of what each of them is.
    sigma = np.hypot(np.sqrt(reflectance / photons), 0.1 * found["indirect_rms"] / expected)
    assert np.average(indirect, weights=traced.areas) == pytest.approx(expected, rel=4 * sigma)


def test_light_from_a_ceiling_against_quadrature(validation):
    """A floor lit by a ceiling whose exitance is known, through the form factor's integral."""
    floor = surface(rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0), 0.25), 0.0)
    ceiling = surface(rectangle((-2, -2, 2), (0, 4, 0), (4, 0, 0), 0.0625), 0.5)
    traced = trace([floor, ceiling], [luminaire(at=(0, 0, 0.5))], 1000)
    position = traced.scene.receiver_positions
    at_ceiling, at_floor = traced.front(1), traced.front(0)
    light = np.zeros(len(position))
    light[at_ceiling] = 100 * (1 + position[at_ceiling, 0] / 2)
    found, _ = gathered(traced, light, 1_500_000)

    x = (np.arange(128) + 0.5) / 32 - 2
    a, b = (grid.ravel() for grid in np.meshgrid(x, x))
    flux = 50 * (1 + a / 2) / 32**2
    expected = np.array(
        [
            (flux * 4 / (np.pi * ((a - p) ** 2 + (b - q) ** 2 + 4) ** 2)).sum()
            for p, q, _ in position[at_floor]
        ]
    )
    off = found[at_floor] - expected
    rms = np.sqrt(np.average(off**2, weights=traced.areas[at_floor]))
    case = "ceiling of a known exitance, RMS error on a floor by gather"
    validation.bound(case, rms / expected.mean(), at_most=0.004)
    assert not found[at_ceiling].any()  # nothing that reflects faces it


def test_light_does_not_leak_through_a_thin_wall():
    """Two closed rooms a millimetre apart, their floors in one plane; one of them is lit."""
    rooms = [surface(box((2, 2, 2), 0.125).flipped().moved(x=x, z=1), 0.5) for x in (-1, 1.001)]
    traced = trace(rooms, [luminaire(1000.0, (-1, 0, 1))], 100_000)
    lit, dark = traced.front(0), traced.front(1)
    for rays in (3_000, 30_000, 150_000):
        found, _ = gathered(traced, traced.illuminance.sum(axis=1), rays)
        assert (found[dark] == 0).all()
        # To the edge of the wall: mean of a closed room.
        mean = np.average(found[lit], weights=traced.areas[lit])
        assert mean == pytest.approx(1000 / 24, rel=0.02)
        assert found[lit].min() > 0.4 * mean


def test_the_back_of_a_one_sided_mesh_is_black():
    floor = surface(rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0), 0.5), 0.5)
    for double_sided in (False, True):
        sheet = surface(
            rectangle((-2, -2, 1), (4, 0, 0), (0, 4, 0), 0.5), 0.5, double_sided=double_sided
        )
        traced = trace([floor, sheet], [luminaire(at=(0, 0, 0.5))], 1000)
        found, _ = gathered(traced, np.full(len(traced.areas), 100.0), 30_000)
        assert (found[traced.front(0)].max() > 0) == double_sided


@pytest.mark.parametrize("rays", [5_000, 40_000, 300_000])
def test_the_reported_error_is_the_true_one(rays):
    """A room with a box in it; the truth has a record of 512 rays at every vertex."""
    walls = surface(box((4, 4, 3), 0.25).flipped().moved(z=1.5), 0.5)
    block = surface(box((1, 1, 1), 0.125).moved(z=0.5), 0.5)
    traced = trace([walls, block], [luminaire(10_000.0, (1, 1, 2.5))], 200_000)
    light = traced.illuminance.sum(axis=1)
    truth, _ = gathered(traced, light, 512 * len(light), seed=99)
    errors, reported = [], []
    for seed in range(6):
        indirect, found = gathered(traced, light, rays, seed)
        errors.append(np.sqrt(np.average((indirect - truth) ** 2, weights=traced.areas)))
        reported.append(found["indirect_rms"])
    assert np.mean(reported) == pytest.approx(np.sqrt(np.mean(np.square(errors))), rel=0.4)


def gathered_from_photons(traced, direct, photons, rays, seed):
    """As a run does it. direct : (V, 3) lx, known; rays : a vertex"""
    left = retrace(traced, photons, seed)
    buckets = np.repeat(left.illuminance[:, :, None], 3, axis=2).astype(np.float32)
    return _core.FinalGather(traced.scene, seed).advance(
        buckets.sum(axis=1), rays * len(traced.areas), 2, np.ascontiguousarray(buckets[:, 1]),
        left.photon_flux, direct, left.buckets,
    )  # fmt: skip


def test_the_noise_of_the_photons_that_lit_a_room_is_told():
    """Furnace: direct light is known, rays all see the same; what is off, photons brought."""
    traced = trace([surface(icosphere(2).flipped(), 0.6)], [luminaire(1000.0)], 1000)
    direct = 1000 / traced.areas.sum()
    known = np.full((len(traced.areas), 3), direct, np.float32)
    squares, reported = [], []
    for seed in range(24):
        found = gathered_from_photons(traced, known, 10_000, 64, seed)
        off = found["indirect"] @ WEIGHTS - direct * 0.6 / 0.4
        squares.append(np.average(off**2, weights=traced.areas))
        reported.append(found["indirect_rms"])
    assert np.sqrt(np.mean(np.square(reported))) == pytest.approx(
        np.sqrt(np.mean(squares)), rel=0.2
    )


def test_buckets_that_few_photons_met_by_luck_make_a_room_no_brighter():
    """Furnace of some thousand buckets, where next to none gets a photon, or each gets several.

    What two photons leave in a bucket that expects a tenth of one is no light of its own.
    """
    traced = trace([surface(icosphere(4).flipped(), 0.6)], [luminaire(1000.0)], 1000)
    direct = 1000 / traced.areas.sum()
    known = np.full((len(traced.areas), 3), direct, np.float32)
    for photons in (100, 300, 1_000, 3_000, 10_000):
        runs = [gathered_from_photons(traced, known, photons, 8, seed) for seed in range(8)]
        indirect = np.stack([found["indirect"] @ WEIGHTS for found in runs]) / (direct * 1.5)
        assert np.sqrt(np.mean((indirect - 1) ** 2)) < 0.03  # 300 hits differ by 6 % by chance
        assert indirect.mean() == pytest.approx(1, abs=0.015)


def test_the_noise_of_single_buckets_is_told_where_many_rays_look_them_up():
    """A cube of so few buckets that each vertex sees the same ones again and again."""
    traced = trace([surface(box((4, 4, 4), 1.0).flipped(), 0.8)], [luminaire(1000.0)], 1_000_000)
    direct = np.repeat(traced.illuminance[:, :1], 3, axis=1).astype(np.float32)
    found = [gathered_from_photons(traced, direct, 2000, 256, seed) for seed in range(24)]
    variance = np.var([f["indirect"] @ WEIGHTS for f in found], axis=0, ddof=1)
    told = np.mean(np.square([f["standard_error"] for f in found]), axis=0)
    walls_met = (np.abs(traced.scene.receiver_positions) > 1.9).sum(axis=1)
    for count in (1, 2, 3):  # on a wall, at an edge, in a corner
        there = walls_met == count
        assert np.sqrt(told[there].mean() / variance[there].mean()) == pytest.approx(1, abs=0.25)


def test_a_floor_of_two_triangles_reflects_the_pool_of_light_on_it():
    """No bucket resolves the pool; the rays that hit near a receiver see it all the same."""
    floor = surface(rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0), 4.0), 0.5)
    wall = surface(rectangle((-0.5, 0.5, 0), (1, 0, 0), (0, 0, 1), 0.125), 0.0)
    lamp = luminaire(1000.0, (0, 0, 0.4))
    traced = trace([floor, wall], [lamp], 20_000)
    found, _ = gathered(traced, traced.illuminance.sum(axis=1), 400_000)

    x = (np.arange(800) + 0.5) / 200 - 2
    a, b = (grid.ravel() for grid in np.meshgrid(x, x))
    # By the lamp's 1000 / 4π cd, but in the shadow of the wall.
    exitance = 0.5 * 1000 / (4 * np.pi) * 0.4 / (a**2 + b**2 + 0.16) ** 1.5
    exitance[(b > 0.5) & (np.abs(a) < 0.5 * b / 0.5)] = 0.0
    front = np.flatnonzero(traced.scene.receiver_positions[:, 2] > 0.05)  # ten of the cells
    expected = []
    for p, q, r in traced.scene.receiver_positions[front]:
        squared = (a - p) ** 2 + (b - q) ** 2 + r**2
        facing = np.maximum(0.0, q - b) * r / squared**2
        expected.append((exitance * facing).sum() / np.pi / 200**2)
    off = found[front] - expected
    rms = np.sqrt(np.average(off**2, weights=traced.areas[front]))
    assert rms < 0.05 * np.mean(expected)


def gathered_from_direct(traced, light, rays, arrived=None):
    """As from photons without number; light : (V,) lx, that comes straight from the luminaires.

    arrived : the same as photons tell it, over all of a vertex' area
    """
    both = (light, light if arrived is None else arrived)
    direct, buckets = (np.repeat(np.asarray(e, np.float32)[:, None], 3, axis=1) for e in both)
    gather = _core.FinalGather(traced.scene, 1)
    found = gather.advance(buckets, rays, 2, np.zeros_like(direct), 1e-9, direct)
    return found["indirect"] @ WEIGHTS, found


def in_sunlight(meshes, shadow):
    """100 lx from straight above. shadow : path of the mesh that alone stands in it"""
    sun = replace(distant(100.0), shadow_meshes=frozenset({shadow}))
    scene = replace(scene_of(meshes), luminaires=(sun,))
    core = build_core_scene(scene, SolverSettings(), 2, divide=False)
    return Traced(core, _core.PhotonBuckets(core), meshes)


def form_factors(position, normal, points, facing, areas):
    """(n,) of points to each position, by their sum. position, normal : (3,); points : (n, 3)"""
    to = points - position
    squared = (to**2).sum(axis=1)
    cosines = np.maximum(0.0, to @ normal) * np.maximum(0.0, -(to @ facing))
    return (cosines / squared**2 * areas).sum() / np.pi


def test_the_summit_of_a_hill_of_light_is_not_worn_down(validation):
    """Below a panel light bends from vertex to vertex; the mean of runs shows the bias alone."""
    floor = surface(rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0), 0.25), 0.0)
    panel = surface(rectangle((-0.25, -0.25, 0.5), (0, 0.5, 0), (0.5, 0, 0), 0.25), 0.5)
    traced = trace([floor, panel], [luminaire(at=(0, 0, 0.1))], 100)
    light = np.zeros(len(traced.areas))
    light[traced.front(1)] = 100.0
    position = traced.scene.receiver_positions
    summit = np.flatnonzero((np.hypot(*position.T[:2]) < 0.4) & (position[:, 2] < 0.1))
    runs = [gathered(traced, light, 1024 * len(light), seed)[0][summit] for seed in range(8)]

    x = (np.arange(64) + 0.5) / 128 - 0.25
    points = np.array([(a, b, 0.5) for a in x for b in x])
    down, up = np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, 1.0])
    expected = [50 * form_factors(p, up, points, down, 1 / 128**2) for p in position[summit]]
    case = "summit of a hill of light, mean of 8 gathers"
    validation.check(case, np.mean(expected), np.mean(runs), relative=0.005)


def test_a_bright_spot_is_seen_by_few_rays():
    """A hundredth of a thousandth of the hemisphere: most vertices' rays miss it."""
    floor = surface(rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0), 0.25), 0.0)
    spot = surface(rectangle((-0.01, -0.01, 2), (0, 0.02, 0), (0.02, 0, 0), 0.005), 0.5)
    traced = trace([floor, spot], [luminaire(at=(0, 0, 0.5))], 1000)
    at_floor = traced.front(0)
    light = np.zeros(len(traced.areas))
    light[traced.front(1)] = 1e6
    found, reported = gathered_from_direct(traced, light, 16 * len(light))
    down, up = np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, 1.0])
    expected = [
        0.5e6 * form_factors(p, up, np.array([[0.0, 0.0, 2.0]]), down, 0.02**2)
        for p in traced.scene.receiver_positions[at_floor]
    ]
    assert found[at_floor] == pytest.approx(expected, rel=0.01)
    assert reported["indirect_rms"] < 0.01 * np.mean(expected)


def test_a_vertex_in_the_foot_of_a_column_does_not_darken_the_floor_around_it():
    floor = surface(rectangle((-1, -1, 0), (2, 0, 0), (0, 2, 0), 1.0), 0.5)
    foot = box((0.4, 0.4, 0.02), 0.4).moved(z=0.01)  # two-sided: light might be within
    foot = surface(foot, 0.0, double_sided=True, path="/Foot")
    ceiling = surface(rectangle((-1, -1, 1), (0, 2, 0), (2, 0, 0), 0.25), 0.0)
    traced = in_sunlight([floor, foot, ceiling], "/Foot")
    at_floor, at_ceiling = traced.front(0), traced.front(2)
    place = traced.scene.receiver_positions[at_floor]
    light = np.zeros(len(traced.areas))
    light[at_floor] = np.where(np.abs(place[:, :2]).max(axis=1) > 0.2, 100.0, 0.0)
    hidden = at_floor.start + np.flatnonzero(light[at_floor] == 0)
    assert len(hidden) == 1
    arrived = light.copy()
    arrived[hidden] = 100 - 100 * 0.4**2 / traced.areas[hidden]  # by what is nearest to it
    found, _ = gathered_from_direct(traced, light, 4_000 * len(light), arrived)
    x = (np.arange(200) + 0.5) / 100 - 1
    a, b = (grid.ravel() for grid in np.meshgrid(x, x))
    seen = np.maximum(np.abs(a), np.abs(b)) > 0.2
    points = np.stack([a, b, 0 * a], axis=1)[seen]
    up = np.array([0.0, 0.0, 1.0])
    expected = [
        50 * form_factors(p, -up, points, up, 0.01**2)
        for p in traced.scene.receiver_positions[at_ceiling]
    ]
    assert found[at_ceiling] == pytest.approx(expected, rel=0.03)


def test_the_dark_behind_a_picture_does_not_darken_the_wall_beside_it(validation):
    """The edge of the picture runs half-way between a vertex in the light and one in the dark."""
    wall = surface(rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0), 1.0), 0.5)
    picture = rectangle((-0.5, -2, 0.1), (2.5, 0, 0), (0, 4, 0), 0.5)
    opposite = surface(rectangle((-2, -2, 3), (0, 4, 0), (4, 0, 0), 0.25), 0.0)
    black = surface(picture, 0.0, double_sided=True, path="/Picture")
    traced = in_sunlight([wall, black, opposite], "/Picture")
    at_wall, at_opposite = traced.front(0), traced.front(2)
    light = np.ones(len(traced.areas))  # some gets behind the picture
    light[at_wall] = np.where(traced.scene.receiver_positions[at_wall, 0] < -0.5, 100.0, 1.0)
    found, _ = gathered_from_direct(traced, light, 300 * len(light))
    a, b = (grid.ravel() for grid in np.meshgrid(np.arange(-1.995, -0.5, 0.01),
                                                 np.arange(-1.995, 2.0, 0.01)))  # fmt: skip
    points, up = np.stack([a, b, 0 * a], axis=1), np.array([0.0, 0.0, 1.0])
    expected = []
    for p in traced.scene.receiver_positions[at_opposite]:
        past = a + 0.1 / 3 * (p[0] - a) < -0.5  # the picture's edge
        expected.append(50 * form_factors(p, -up, points[past], up, 0.01**2))
    weights = traced.areas[at_opposite]
    means = [np.average(values, weights=weights) for values in (expected, found[at_opposite])]
    case = "light from a wall beside a picture, mean by gather"
    # 9 % where light falls evenly from the vertex beside to the one behind.
    validation.check(case, means[0], np.array([means[1]]), relative=0.05)


def test_the_edge_of_a_shadow_is_seen_where_it_falls(validation):
    """A shelf close above a floor in the sun; the shadow of an awning ends between the floor's
    vertices, which are further from each other than from the shelf."""
    step, height, edge = 0.5, 0.6, 0.1
    floor = surface(rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0), step), 0.5)
    awning = surface(rectangle((edge, -2, 3), (0, 4, 0), (2, 0, 0), 1.0), path="/Awning")
    shelf = surface(rectangle((-0.5, -0.1, height), (0, 0.2, 0), (1, 0, 0), 0.1))
    traced = in_sunlight([floor, awning, shelf], "/Awning")
    at_floor, at_shelf = traced.front(0), traced.front(2)
    place = traced.scene.receiver_positions
    light, arrived = np.zeros((2, len(place)))
    light[at_floor] = np.where(place[at_floor, 0] < edge, 100.0, 0.0)
    sunny = np.clip((edge - place[at_floor, 0]) / step + 0.5, 0, 1)  # of what is nearest to it
    arrived[at_floor] = 100.0 * sunny
    found, _ = gathered_from_direct(traced, light, 4_000 * len(light), arrived)
    x = (np.arange(400) + 0.5) / 100 - 2
    a, b = (grid.ravel() for grid in np.meshgrid(x[x < edge], x))
    points, up = np.stack([a, b, 0 * a], axis=1), np.array([0.0, 0.0, 1.0])
    expected = [50 * form_factors(p, -up, points, up, 0.01**2) for p in place[at_shelf]]
    case = "light from a floor with the edge of a shadow, RMS error by gather"
    rms = np.sqrt(np.mean((found[at_shelf] / expected - 1) ** 2))
    # 8 % where light is linear from vertex to vertex.
    validation.bound(case, rms, at_most=0.01)


def test_what_covers_a_floor_between_its_vertices_takes_no_light_from_the_rest(validation):
    """A cube of 2 m; strips of wood cover half of its floor and ceiling, none of their vertices."""
    cube = box((2, 2, 2), 0.2).flipped()
    strips = [
        surface(box((1.98, 0.1, 0.004), 0.2).moved(y=0.2 * i - 0.9, z=z), 0.6)
        for i in range(10)
        for z in (-1, 1)
    ]
    traced = trace([surface(cube, 0.6), *strips], [luminaire(1000.0)], 1_000_000)
    to_lamp = -traced.scene.receiver_positions
    squared = (to_lamp**2).sum(axis=1)
    cosine = (to_lamp * traced.scene.vertex_normals).sum(axis=1) / np.sqrt(squared)
    inside = np.abs(to_lamp).max(axis=1) < 1 + 1e-9
    direct = np.where(inside, np.maximum(0.0, cosine), 0.0) * 1000 / (4 * np.pi) / squared
    colours = np.repeat(direct.astype(np.float32)[:, None], 3, axis=1)
    light = traced.buckets.illuminance(traced.scene)
    found = _core.FinalGather(traced.scene, 1).advance(
        np.ascontiguousarray(light.sum(axis=1)), 300_000, 2,
        np.ascontiguousarray(light[:, 1]), traced.photon_flux, colours,
    )  # fmt: skip
    room = traced.front(0)
    mean = np.average((found["indirect"] @ WEIGHTS)[room], weights=traced.areas[room])
    case = "closed cube, its floor half covered, mean by gather"
    validation.check(case, 0.6 * 1000 / 24 / (1 - 0.6), np.array([mean]), relative=0.015)
