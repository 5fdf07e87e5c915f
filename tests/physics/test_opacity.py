"""Surfaces that stop a part of the light: like a sieve of so much opaque area, too fine to see."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binomtest
from usd_scenes.shapes import Shape, box, rectangle

from core_scenes import bucket_flux, build, luminaire, surface, trace
from hand_built import scene_of
from isolux import _core
from isolux.core_scene import build_core_scene, mesh_triangles
from isolux.settings import SolverSettings
from isolux.solution import LUMINANCE_WEIGHTS
from validation.rows import INVARIANCE

pytestmark = pytest.mark.validation(INVARIANCE)

NONE = np.zeros(0, np.float32)
OPACITY = 0.3
PHOTONS = 400_000
FLOOR = rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0), 0.25)
SCREEN = rectangle((-2, -2, 1), (4, 0, 0), (0, 4, 0), 0.25)
LAMPS = {
    "a point": luminaire(1000.0, (0, 0, 2), size=(1e-5, 0.0)),
    "a rectangle": luminaire(1000.0, (0, 0, 2), "rect", (0.8, 0.4)),
    "forty": [luminaire(25.0, (x, y, 2)) for x in (-1, 0, 1, 1.5) for y in np.linspace(-1, 1, 10)],
}


def screened(opacity, reflectance=0.0):
    return [surface(FLOOR), surface(SCREEN, reflectance, double_sided=True, opacity=opacity)]


def direct_light(scene):
    """(V,) lx by DDL, and its shadow rays."""
    lighting = _core.DirectLighting(scene, 1, 0.01)
    found = lighting.illuminate(scene.receiver_positions, scene.vertex_normals, NONE, 2)
    return found["illuminance"] @ LUMINANCE_WEIGHTS, found


def layers(opacities):
    """A caster through one rectangle above the other."""
    points, triangles, of_triangle = [], [], []
    for i, a in enumerate(opacities):
        points += [(x, y, i) for y in (0, 1) for x in (0, 1)]
        triangles += [np.array(t) + 4 * i for t in ((0, 1, 3), (0, 3, 2))]
        of_triangle += [a, a]
    return _core.RayCaster(
        np.array(points, float), np.array(triangles, np.int32), 1, np.array(of_triangle, np.float32)
    )


def through(count, layer_count, seed=1):
    """Steep rays from below the layers to above them."""
    rng = np.random.default_rng(seed)
    start = np.concatenate([rng.uniform(0.3, 0.7, (count, 2)), np.full((count, 1), -1.0)], axis=1)
    return start, start + [0.1, 0.05, layer_count + 1.0] * rng.uniform(0.9, 1, (count, 3))


@pytest.mark.parametrize("count", [1, 3, 4, 9])
def test_shadow_rays_pass_what_each_layer_leaves_alone_and_in_packets(count):
    start, end = through(count, 3)
    passed = layers([0.5, 0.2, 0.9]).transmitted(start, end)
    assert passed == pytest.approx(np.full(count, 0.5 * 0.8 * 0.1), rel=1e-6)
    assert not layers([0.5, 1.0, 0.9]).transmitted(start, end).any()
    assert (layers([1.0, 1.0]).transmitted(start - 5, end - 5) == 1).all()


def test_a_ray_meets_a_layer_as_often_as_it_is_opaque_whatever_it_met_before():
    opacities = [0.5, 0.2, 0.9]
    start, end = through(20_000, 3)
    caster = layers(opacities)
    directions = (end - start).astype(np.float32)
    triangle, _, _ = caster.closest_hits(start, directions)
    left = 1.0
    for layer, a in enumerate(opacities):
        met = int((triangle // 2 == layer).sum())
        assert binomtest(met, len(start), left * a).pvalue > 1e-3
        left *= 1 - a
    again, _, _ = caster.closest_hits(start, directions)
    assert np.array_equal(triangle, again)


@pytest.mark.parametrize("lamps", LAMPS.values(), ids=LAMPS)
def test_direct_light_behind_a_screen_is_what_it_leaves_and_on_it_all(lamps):
    """A point of light casts no noise: a shadow ray carries the share that passes."""
    lamps = lamps if isinstance(lamps, list) else [lamps]
    (open_floor, _), (behind, found) = (
        direct_light(build(meshes, lamps)) for meshes in ([surface(FLOOR)], screened(OPACITY))
    )
    on_opaque, _ = direct_light(build(screened(1.0), lamps))
    count = len(open_floor)
    rel = 1e-5 if len(lamps) == 1 else 0.05  # of forty lamps some stand for others
    assert behind[:count] == pytest.approx((1 - OPACITY) * open_floor, rel=rel)
    assert behind[count:] == pytest.approx(on_opaque[count:], rel=rel)
    # Nothing to look for where all samples of a lamp pass the same share.
    assert found["shadow_rays"] <= 40 * len(behind)


def test_photons_leave_the_illuminance_of_the_whole_surface_and_the_rest_behind():
    def unhindered(points, normals):
        """A sphere of 1000 lm at a height of 2 m."""
        to = [0, 0, 2] - points
        square = (to**2).sum(axis=1)
        return 1000 / (4 * np.pi) * (to * normals).sum(axis=1) / square**1.5

    traced = trace(screened(OPACITY), [LAMPS["a point"]], PHOTONS)
    ends = traced.buckets.ends
    assert ends["emitted"] == ends["absorbed"] + ends["back_absorbed"] + ends["escaped"]
    for mesh, share in ((0, 1 - OPACITY), (1, OPACITY)):
        expected = share * bucket_flux(traced, unhindered, mesh) / traced.photon_flux
        counts = traced.hits[traced.front(mesh), 0]
        chi = (counts - expected) ** 2 / expected
        assert chi.mean() == pytest.approx(1.0, abs=4 * np.sqrt(2 / len(chi)))
    at_screen = traced.illuminance[traced.front(1), 0]
    on_surface = bucket_flux(traced, unhindered, 1) / (traced.areas[traced.front(1)] / OPACITY)
    assert at_screen.mean() == pytest.approx(on_surface.mean(), rel=0.02)


# The same screen as it would be built: of four small squares three are holes.
SIEVE_OPACITY = 0.25
FINE = rectangle((-1, -1, 0), (2, 0, 0), (0, 2, 0), 2 / 64)
KEPT = np.flatnonzero((FINE.points[FINE.indices[::4], :2] * 32 % 2 < 1).all(axis=1))
SIEVE = Shape(FINE.points, FINE.counts[KEPT], FINE.indices.reshape(-1, 4)[KEPT].ravel())
ROOM = surface(box((2, 2, 2), 0.25).flipped(), 0.6)
LAMP = luminaire(1000.0, (0.1, 0.2, 0.7), size=(0.05, 0.0))
COARSE = rectangle((-1, -1, 0), (2, 0, 0), (0, 2, 0), 0.25)


@pytest.fixture(scope="module")
def room():
    """A room halved by a screen, and the truth of it: the screen built as a sieve."""
    meshes = [ROOM, surface(COARSE, 0.5, double_sided=True, opacity=SIEVE_OPACITY)]
    explicit = [ROOM, surface(SIEVE, 0.5, double_sided=True)]
    return trace(meshes, [LAMP], PHOTONS), trace(explicit, [LAMP], PHOTONS)


def means(traced, lux):
    """Of the walls well above and below the screen, of the screen's top and bottom, lx."""
    z, up = traced.scene.receiver_positions[:, 2], traced.scene.vertex_normals[:, 2] > 0
    of_screen = np.arange(len(z)) >= traced.front(1).start
    parts = [~of_screen & (z > 0.2), ~of_screen & (z < -0.2), of_screen & up, of_screen & ~up]
    return np.array([np.average(lux[p], weights=traced.areas[p]) for p in parts])


def test_a_screen_lets_light_to_and_fro_like_the_sieve_that_it_stands_for(room):
    one, explicit = room
    for path in (0, 1):
        assert means(one, one.illuminance[:, path]) == pytest.approx(
            means(explicit, explicit.illuminance[:, path]), rel=0.03
        )


def test_radiosity_and_gather_agree_with_photons_behind_a_screen(room):
    traced, _ = room
    scene = traced.scene
    truth = means(traced, traced.illuminance[:, 1])
    radiosity = _core.ProgressiveRadiosity(scene, 1, 0.05)
    positions, normals = radiosity.receivers()
    lighting = _core.DirectLighting(scene, 1, 0.01)
    radiosity.begin(lighting.illuminate(positions, normals, NONE, 2)["illuminance"])
    progress = radiosity.advance(10**10, 2)
    assert progress["received_flux"] == pytest.approx(progress["shot_flux"], rel=0.01)
    found = radiosity.indirect(scene.receiver_positions, scene.vertex_normals, 2)
    assert means(traced, found["illuminance"] @ LUMINANCE_WEIGHTS) == pytest.approx(truth, rel=0.03)

    total = np.ascontiguousarray(traced.buckets.illuminance(scene).sum(axis=1))
    gathered = _core.FinalGather(scene, 1).advance(total, 1_000_000, 2)
    assert means(traced, gathered["indirect"] @ LUMINANCE_WEIGHTS) == pytest.approx(truth, rel=0.03)


def test_faces_of_no_opacity_are_holes_and_the_others_of_a_mesh_keep_their_own():
    opacity = np.where(np.arange(len(SCREEN.counts)) % 2, 0.0, 0.4)
    clear = surface(SCREEN, double_sided=True, opacity=opacity)
    holes = np.flatnonzero(opacity == 0).astype(np.int32)
    as_holes = replace(
        clear, hole_faces=holes, opacity=np.full(len(opacity), 0.4, np.float32), path="/Holes"
    )
    lit = []
    for mesh in (clear, as_holes):
        scene = replace(scene_of([surface(FLOOR), mesh]), luminaires=(LAMPS["a point"],))
        lit.append(direct_light(build_core_scene(scene, SolverSettings(), 1))[0])
        assert not np.isin(mesh_triangles(mesh)[1], holes).any()
    assert np.array_equal(*lit)
    nothing = surface(SCREEN, opacity=0.0)
    scene = replace(scene_of([surface(FLOOR), nothing]), luminaires=(LAMPS["a point"],))
    alone, _ = direct_light(build([surface(FLOOR)], [LAMPS["a point"]]))
    assert np.array_equal(direct_light(build_core_scene(scene, SolverSettings(), 1))[0], alone)
