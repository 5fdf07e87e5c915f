"""Meshes that shine: the light of the luminaires that have their form, and of closed furnaces."""

from dataclasses import replace

import numpy as np
import pytest
from usd_scenes.furnace_sphere.generate import icosphere
from usd_scenes.shapes import box, rectangle

from core_scenes import build, luminaire, shining, surface, trace
from isolux import _core
from validation.rows import DIRECT, GLOBAL

pytestmark = pytest.mark.validation(DIRECT)

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
FLOOR = surface(rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0), 0.25))
BLOCKER = surface(rectangle((-0.5, -0.5, 1), (0.9, 0, 0), (0, 0.7, 0), 0.3), double_sided=True)
PHOTONS = 200_000


def of(mesh):
    """The luminaire that a shining mesh is."""
    return replace(luminaire(shape="mesh"), path=mesh.path)


def illuminate(scene, part, seed=1, accuracy=0.01):
    """Photometric, at the receivers of a mesh, and what is told of their error."""
    begin, end, _, _ = scene.mesh_ranges[part]
    found = _core.DirectLighting(scene, seed, accuracy).illuminate(
        scene.receiver_positions[begin:end],
        scene.vertex_normals[begin:end],
        np.zeros(0, np.float32),
        2,
    )
    return found["illuminance"].astype(float) @ LUMINANCE, found["standard_error"].astype(float)


def test_a_shining_quad_is_a_rectangular_luminaire():
    """In the open and in the penumbra of a blocker, over its own surface too."""
    quad = shining(rectangle((-0.3, -0.2, 2), (0, 0.4, 0), (0.6, 0, 0), 1.0), 500.0)
    rect = luminaire(np.pi * 500 * 0.24, (0, 0, 2), "rect", (0.6, 0.4))
    assert quad.points[:, 2] == pytest.approx(2)
    lit, _ = illuminate(build([FLOOR, quad], [of(quad)]), 0)
    expected, _ = illuminate(build([FLOOR], [rect]), 0)
    assert lit == pytest.approx(expected, rel=1e-3)
    lit, error = illuminate(build([FLOOR, BLOCKER, quad], [of(quad)]), 0, accuracy=1e-3)
    expected, other = illuminate(build([FLOOR, BLOCKER], [rect]), 0, accuracy=1e-3)
    assert np.sqrt(np.mean((lit - expected) ** 2)) < 1.5 * np.sqrt(np.mean(error**2 + other**2))


def test_both_sides_of_a_double_sided_mesh_shine():
    quad = shining(rectangle((-0.3, -0.2, 1), (0, 0.4, 0), (0.6, 0, 0), 1.0), 500.0)
    ceiling = surface(rectangle((-2, -2, 2), (0, 4, 0), (4, 0, 0), 0.25))
    both = replace(quad, double_sided=True)
    below, above = (illuminate(build([FLOOR, ceiling, both], [of(both)]), i)[0] for i in (0, 1))
    assert np.sort(below) == pytest.approx(np.sort(above), rel=1e-5)
    below, above = (illuminate(build([FLOOR, ceiling, quad], [of(quad)]), i)[0] for i in (0, 1))
    assert below.min() > 0
    assert not above.any()


@pytest.mark.parametrize("subdivisions", [2, 4])
def test_a_shining_sphere_of_triangles_is_a_spherical_luminaire(subdivisions):
    """As bright as a sphere of its area; 320 and 5120 luminaires; the error told is true."""
    shape = icosphere(subdivisions)
    shape = replace(shape, points=shape.points * 0.3)
    sphere = shining(shape.moved(z=1), 500.0)
    radius = np.sqrt(shape.area() / (4 * np.pi))
    round_ = luminaire(np.pi * 500 * shape.area(), (0, 0, 1), "sphere", (radius, 0))
    expected, _ = illuminate(build([FLOOR], [round_]), 0)
    scene = build([FLOOR, sphere], [of(sphere)])
    runs = [illuminate(scene, 0, seed) for seed in range(4)]
    mean = np.mean([lit for lit, _ in runs], axis=0)
    assert mean.mean() == pytest.approx(expected.mean(), rel=5e-3)
    assert mean == pytest.approx(expected, rel=0.05)
    off = np.sqrt(np.mean([(lit - expected) ** 2 for lit, _ in runs]))
    told = np.sqrt(np.mean([error**2 for _, error in runs]))
    assert off < 1.5 * told + 2e-3 * expected.mean()


def test_photons_of_a_mesh_and_its_shadow_rays_agree():
    """A box that shines, on a floor and past a blocker: direct light by photons and by rays."""
    lamp = shining(box((0.4, 0.3, 0.2), 0.1).turned(x=20, z=30).moved(z=1.6), 500.0)
    traced = trace([FLOOR, BLOCKER, lamp], [of(lamp)], PHOTONS)
    ends = traced.buckets.ends
    assert ends["emitted"] == ends["absorbed"] + ends["escaped"] + ends["back_absorbed"]
    assert traced.scene.luminous_flux == pytest.approx(np.pi * 500 * (0.12 + 0.08 + 0.06) * 2)
    assert not traced.hits[traced.front(2)].any()  # convex: no photon comes back
    lit, error = illuminate(traced.scene, 0)
    areas = traced.areas[traced.front()]
    by_photons = traced.illuminance[traced.front(), 0]
    sigma = np.sqrt(traced.hits[traced.front(), 0].sum()) * traced.photon_flux
    assert (lit * areas).sum() == pytest.approx(
        (by_photons * areas).sum(), abs=4 * sigma + (error * areas).sum()
    )


@pytest.mark.validation(GLOBAL)
@pytest.mark.parametrize("reflectance", [0.0, 0.5, 0.8])
def test_a_closed_room_that_shines_everywhere_is_a_furnace(validation, reflectance):
    """B = M / (1 - ρ): the illuminance is π L / (1 - ρ) at each point of it."""
    walls = shining(box((2, 2, 2), 0.5).flipped(), 100.0)
    walls = replace(walls, reflectance=np.full((1, 3), reflectance, np.float32))
    traced = trace([walls], [of(walls)], PHOTONS)
    sigma = np.sqrt(reflectance / PHOTONS)
    expected = 100 * np.pi / (1 - reflectance)
    case = f"furnace of ρ {reflectance} that shines everywhere, mean light, photons"
    found = traced.mean_illuminance.sum()
    validation.check(case, expected, found, sigma=sigma * expected, relative=1e-9)
    assert traced.buckets.ends["escaped"] == 0
    # Near an edge or a corner a point sees its neighbours aslant: by shadow rays the same.
    lit, _ = illuminate(traced.scene, 0)
    case = f"furnace of ρ {reflectance} that shines everywhere, direct light"
    validation.check(case, 100 * np.pi, lit.mean(), relative=0.005)


def test_a_hundred_thousand_triangles_are_one_light():
    shape = icosphere(6)
    shape = replace(shape, points=shape.points * 0.3)
    sphere = shining(shape.moved(z=1), 500.0)
    assert len(sphere.face_vertex_counts) == 81_920
    scene = build([FLOOR, sphere], [of(sphere)])
    lit, _ = illuminate(scene, 0)
    round_ = luminaire(np.pi * 500 * shape.area(), (0, 0, 1), "sphere", (0.3, 0))
    expected, _ = illuminate(build([FLOOR], [round_]), 0)
    assert lit.mean() == pytest.approx(expected.mean(), rel=5e-3)
