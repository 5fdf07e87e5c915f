"""Closest hits among triangles against plane geometry, at any size and anywhere."""

import numpy as np
import pytest
from isolux._core import RayCaster
from usd_scenes.furnace_sphere.generate import icosphere
from usd_scenes.shapes import box

from hand_built import CUBE_FACES

TRIANGLE = np.array([(0.0, 0.0, 0.0), (3.0, 0.0, 0.0), (0.0, 2.0, 1.0)])
ONE = np.array([[0, 1, 2]], np.int32)


def triangles_of(shape):
    quads = shape.indices.reshape(-1, shape.counts[0])
    return np.concatenate([quads[:, [0, i, i + 1]] for i in range(1, shape.counts[0] - 1)])


def cast(caster, origins, directions):
    return caster.closest_hits(
        np.atleast_2d(origins).astype(float), np.atleast_2d(directions).astype(np.float32)
    )


@pytest.mark.parametrize("scale", [1e-6, 1e-3, 1.0, 1e3, 1e6])
@pytest.mark.parametrize("far", [0.0, 1e7])
def test_barycentrics_and_distance_at_any_size_and_anywhere(scale, far):
    """far : offset in units of the triangle's size"""
    offset = np.array([far, -far, far]) * scale
    points = TRIANGLE * scale + offset
    caster = RayCaster(points, ONE)
    rng = np.random.default_rng(2)
    weights = rng.dirichlet([1, 1, 1], 200)
    targets = weights @ points
    origins = targets + rng.normal(0, 1, (200, 3)) * scale + np.array([0, 0, 4]) * scale
    directions = (targets - origins).astype(np.float32)
    triangle, barycentrics, distance = cast(caster, origins, directions)
    assert (triangle == 0).all()
    assert barycentrics == pytest.approx(weights[:, 1:], abs=2e-6)
    assert distance == pytest.approx(np.ones(200), rel=2e-6)


def test_distance_is_in_lengths_of_the_direction():
    caster = RayCaster(TRIANGLE, ONE)
    for length in (0.25, 1.0, 8.0):
        _, _, distance = cast(caster, (0.5, 0.5, 5.25), (0, 0, -length))
        assert distance == pytest.approx([5.0 / length])


def test_both_sides_are_hit():
    caster = RayCaster(TRIANGLE, ONE)
    triangle, _, _ = cast(caster, [(0.5, 0.5, 9), (0.5, 0.5, -9)], [(0, 0, -1), (0, 0, 1)])
    assert triangle.tolist() == [0, 0]


@pytest.mark.parametrize(
    ("origin", "direction"),
    [
        ((0.5, 0.5, 9), (0, 0, 1)),  # away
        ((4, 4, 9), (0, 0, -1)),  # beside
        ((-1e-3, 0.5, 9), (0, 0, -1)),
        ((0, 0, 9), (1, 0, 0)),  # along
    ],
)
def test_what_meets_nothing_is_a_miss(origin, direction):
    triangle, _, _ = cast(RayCaster(TRIANGLE, ONE), origin, direction)
    assert triangle.tolist() == [-1]


def test_the_nearest_of_many_spheres_is_hit():
    """Along the X axis: the front of each in turn."""
    sphere = icosphere(2)
    points = np.concatenate([sphere.points * 0.4 + [x, 0, 0] for x in range(5)])
    each = triangles_of(sphere)
    triangles = np.concatenate([each + i * len(sphere.points) for i in range(5)]).astype(np.int32)
    caster = RayCaster(points, triangles)
    origins = np.stack([np.arange(-0.5, 4, 1.0), np.zeros(5), np.zeros(5)], axis=1)
    triangle, _, distance = cast(caster, origins, np.tile([1.0, 0, 0], (5, 1)))
    assert (triangle // len(each)).tolist() == [0, 1, 2, 3, 4]
    assert distance == pytest.approx(np.full(5, 0.1), abs=0.4 * 0.02)


def test_a_closed_surface_has_no_gaps():
    """Rays from inside through points on its edges, its corners among them."""
    for shape in (icosphere(2), box((1, 2, 3), 0.25)):
        triangles = triangles_of(shape).astype(np.int32)
        caster = RayCaster(shape.points, triangles)
        along = np.linspace(0, 1, 21)[:, None, None]
        p, q = shape.points[triangles[:, 0]], shape.points[triangles[:, 1]]
        targets = (p + along * (q - p)).reshape(-1, 3)
        triangle, _, distance = cast(caster, np.full_like(targets, 0.01), targets - 0.01)
        assert (triangle >= 0).all()
        assert distance == pytest.approx(np.ones(len(targets)), rel=1e-5)


def test_triangles_without_area_are_never_hit():
    points = np.array([(0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 0, -1), (2, 0, -1), (1, 2, -1)], float)
    caster = RayCaster(points, np.array([(0, 1, 2), (1, 1, 1), (3, 4, 5)], np.int32))
    triangle, _, _ = cast(caster, [(1, 0, 5), (1, 0.5, 5)], [(0, 0, -1)] * 2)
    assert set(triangle.tolist()) <= {2, -1}
    assert triangle[1] == 2


def test_no_triangles_at_all_is_a_miss():
    caster = RayCaster(np.zeros((0, 3)), np.zeros((0, 3), np.int32))
    assert cast(caster, (0, 0, 0), (0, 0, 1))[0].tolist() == [-1]


def test_the_hits_do_not_depend_on_the_threads_that_built_the_tree():
    sphere = icosphere(4)
    triangles = triangles_of(sphere).astype(np.int32)
    directions = np.random.default_rng(4).normal(size=(2000, 3)).astype(np.float32)
    one, two = (
        cast(RayCaster(sphere.points, triangles, threads), np.zeros((2000, 3)), directions)
        for threads in (1, 2)
    )
    for a, b in zip(one, two, strict=True):
        assert np.array_equal(a, b)


def test_lengths_that_differ_are_refused():
    with pytest.raises(ValueError, match="length"):
        RayCaster(TRIANGLE, ONE).closest_hits(np.zeros((2, 3)), np.zeros((1, 3), np.float32))


def test_a_cube_is_hit_on_each_face_from_its_centre():
    points = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    triangles = [(f[0], f[i], f[i + 1]) for f in CUBE_FACES for i in (1, 2)]
    directions = [(-1, 0, 0), (1, 0, 0), (0, -1, 0), (0, 1, 0), (0, 0, -1), (0, 0, 1)]
    triangle, _, distance = cast(
        RayCaster(points, np.array(triangles, np.int32)), np.full((6, 3), 0.5), directions
    )
    assert (triangle // 2).tolist() == [0, 1, 2, 3, 4, 5]
    assert distance == pytest.approx(np.full(6, 0.5))


@pytest.mark.parametrize("count", [0, 1023, 1024, 2048])
def test_any_number_of_shadow_rays(count):
    """Rays are traced in blocks of 1024."""
    caster = RayCaster(TRIANGLE, ONE)
    start = np.tile([1.0, 0.5, 5.0], (count, 1))
    passed = caster.transmitted(start, start - [0, 0, 10])
    assert passed.shape == (count,)
    assert not passed.any()
