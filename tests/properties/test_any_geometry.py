"""What holds of any polygon, mesh, placement and cage that is drawn."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from itertools import combinations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from usd_scenes.shapes import Shape

from cages import cage, mesh_usda
from core_scenes import build, luminaire, surface
from isolux import _core
from isolux.core_scene import mesh_triangles
from usda_stage import read_usda

numbers = st.integers(-12, 12)
seeds = st.integers(0, 2**32 - 1)


def turn(seed: int) -> np.ndarray:
    return Rotation.random(random_state=seed).as_matrix()


# --- polygons -----------------------------------------------------------------------------------


def side(o, a, b):
    """Twice the signed area of a triangle, in whole numbers."""
    return (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0])


def meet(a, b, c, d):
    """Whether two edges have a point in common."""

    def on(o, a, p):
        return side(o, a, p) == 0 and all(
            min(o[k], a[k]) <= p[k] <= max(o[k], a[k]) for k in (0, 1)
        )

    crossing = side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0
    return crossing or on(a, b, c) or on(a, b, d) or on(c, d, a) or on(c, d, b)


def first_crossing(ring):
    n = len(ring)
    for i, j in combinations(range(n), 2):
        a, b, c, d = ring[i], ring[(i + 1) % n], ring[j], ring[(j + 1) % n]
        neighbours = j == i + 1 or (i == 0 and j == n - 1)
        if not neighbours and meet(a, b, c, d):
            return i, j
        if neighbours:  # they share a point, and must not fold back
            shared, p, q = (b, a, d) if j == i + 1 else (a, b, c)
            folded = (p[0] - shared[0]) * (q[0] - shared[0]) + (p[1] - shared[1]) * (
                q[1] - shared[1]
            )
            if side(shared, p, q) == 0 and folded > 0:
                return i, j
    return None


@st.composite
def simple_polygons(draw, most=14):
    """Corners on whole numbers, counter-clockwise; corners in line with others are many."""
    ring = draw(st.lists(st.tuples(numbers, numbers), min_size=3, max_size=most, unique=True))
    for _ in range(200):
        crossing = first_crossing(ring)
        if crossing is None:
            break
        i, j = crossing  # undone by going through the corners between the other way round
        ring[i + 1 : j + 1] = ring[i + 1 : j + 1][::-1]
    assume(first_crossing(ring) is None)
    area = sum(side((0, 0), ring[i - 1], ring[i]) for i in range(len(ring)))
    assume(area != 0)
    return np.array(ring if area > 0 else ring[::-1], float)


def twice_area(polygon):
    x, y = polygon.T
    return (x * np.roll(y, -1) - np.roll(x, -1) * y).sum()


def triangulated(points, flip=False):
    corners, _ = _core.triangulate(
        np.ascontiguousarray(points),
        np.array([len(points)], np.int32),
        np.arange(len(points), dtype=np.int32),
        np.zeros(0, np.int32),
        flip,
    )
    return corners


@given(simple_polygons(), seeds, st.booleans())
@settings(max_examples=250)
def test_triangles_of_any_simple_polygon_cover_it_once_and_face_its_front(polygon, seed, flip):
    rotation = turn(seed)
    points = np.column_stack([polygon, np.zeros(len(polygon))]) @ rotation.T
    corners = triangulated(points, flip)
    p, q, r = points[corners].transpose(1, 0, 2)
    along = np.cross(q - p, r - p) @ rotation[:, 2] * (-1 if flip else 1)
    assert (along > -1e-12).all()
    assert along.sum() == pytest.approx(twice_area(polygon), rel=1e-12)


@given(simple_polygons(), seeds)
def test_a_point_of_any_simple_polygon_lies_in_one_triangle(polygon, seed):
    """With the area kept there is no gap either. The point is the centroid of each in turn."""
    corners = triangulated(np.column_stack([polygon, np.zeros(len(polygon))]))
    places = [[Fraction(x) for x in polygon[c].sum(axis=0)] for c in corners]  # times 3
    for own, place in enumerate(places):
        for other, triangle in enumerate(corners):
            a, b, c = ([3 * Fraction(x) for x in polygon[k]] for k in triangle)
            inside = min(side(a, b, place), side(b, c, place), side(c, a, place)) > 0
            assert inside == (own == other)


# --- placements ---------------------------------------------------------------------------------

factors = st.tuples(*[st.floats(0.01, 100).flatmap(lambda x: st.sampled_from([x, -x]))] * 3)
TETRAHEDRON = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], np.float32)
OUTWARD = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]


@given(factors, seeds, seeds, st.tuples(*[st.floats(-1e4, 1e4)] * 3), st.booleans())
@settings(max_examples=80)
def test_wherever_a_mesh_stands_its_areas_normals_and_front_go_with_it(
    scale, first, second, at, left_handed
):
    """Area vectors go by the cofactors of the matrix: area ratios and outward sides at once."""
    linear = turn(first) @ np.diag(scale) @ turn(second)  # of row vectors
    matrix = np.eye(4)
    matrix[:3, :3], matrix[3, :3] = linear, at
    p = TETRAHEDRON[OUTWARD].astype(float)
    before = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    normals = ", ".join(str(tuple(map(float, v))) for v in before)
    body = f"""matrix4d xformOp:transform = ({", ".join(str(tuple(map(float, r))) for r in matrix)})
        uniform token[] xformOpOrder = ["xformOp:transform"]
        uniform token orientation = "{"leftHanded" if left_handed else "rightHanded"}"
        normal3f[] normals = [{normals}] (interpolation = "uniform")"""
    faces = [f[::-1] for f in OUTWARD] if left_handed else OUTWARD
    mesh = read_usda(mesh_usda(TETRAHEDRON, faces, body, scheme="none")).meshes[0]
    corners, of = mesh_triangles(mesh)
    q = mesh.points[mesh.face_vertex_indices[corners]]
    after = np.cross(q[:, 1] - q[:, 0], q[:, 2] - q[:, 0])
    expected = (before @ np.linalg.inv(linear).T * abs(np.linalg.det(linear)))[of]
    size = np.abs(expected).max()
    np.testing.assert_allclose(after, expected, atol=1e-9 * size + 1e-10 * np.abs(at).max())
    unit = expected / np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(mesh.corner_normals[::3][of], unit, atol=1e-6)


# --- rays ---------------------------------------------------------------------------------------


def crossings(origins, directions, points, triangles):
    """(R, T) distances of rays to triangles' planes, and how far inside in barycentrics they are.

    By Cramer's rule, in double precision; planes along a ray are nowhere met.
    """
    a, b, c = points[triangles].transpose(1, 0, 2)
    columns = np.broadcast_arrays((b - a)[None], (c - a)[None], -directions[:, None])
    systems = np.stack(columns, axis=-1)
    met = np.abs(np.linalg.det(systems)) > 1e-9
    systems[~met] = np.eye(3)
    u, v, t = np.moveaxis(np.linalg.solve(systems, (origins[:, None] - a)[..., None]), 2, 0)[..., 0]
    return np.where(met, t, np.inf), np.where(met, np.minimum(np.minimum(u, v), 1 - u - v), -1.0)


@given(seeds, st.integers(1, 12), st.floats(-1e5, 1e5))
@settings(max_examples=60)
def test_the_closest_hit_is_the_nearest_crossing_and_lies_where_it_says(seed, count, far):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1, 1, (3 * count, 3))
    triangles = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    origins = rng.uniform(-1, 1, (50, 3)) * 3
    directions = (rng.uniform(-0.7, 0.7, (50, 3)) - origins).astype(np.float32)
    caster = _core.RayCaster(points + far, triangles)
    hits, weights, distances = caster.closest_hits(origins + far, directions)
    to_planes, margins = crossings(origins, directions.astype(float), points, triangles)
    truth = np.where((margins > 0) & (to_planes > 0), to_planes, np.inf)

    near = 1e-3  # of a border, or of another triangle: either is right
    nearest = np.sort(np.column_stack([truth, np.full(50, np.inf)]), axis=1)[:, :2]
    clear = (np.abs(margins) > near).all(axis=1) & ~(nearest[:, 1] < nearest[:, 0] + near)
    expected = np.where(nearest[:, 0] < np.inf, truth.argmin(axis=1), -1)
    np.testing.assert_array_equal(hits[clear], expected[clear])
    met = clear & (hits >= 0)
    np.testing.assert_allclose(distances[met], nearest[met, 0], rtol=1e-4)
    a, b, c = points[triangles[hits[met]]].transpose(1, 0, 2)
    u, v = weights[met].T[..., None]
    places = (1 - u - v) * a + u * b + v * c
    np.testing.assert_allclose(
        origins[met] + distances[met, None] * directions[met], places, atol=1e-4
    )


# --- illumination mesh --------------------------------------------------------------------------


@st.composite
def hills(draw):
    """A grid of quads and triangles with any heights, some of them holes."""
    n, m = draw(st.integers(1, 5)), draw(st.integers(1, 5))
    rng = np.random.default_rng(draw(seeds))
    points = np.array([(x, y, 0) for y in range(m + 1) for x in range(n + 1)], float)
    points[:, :2] += rng.uniform(-0.3, 0.3, (len(points), 2))
    points[:, 2] = rng.normal(0, draw(st.sampled_from([0, 0.1, 1, 10])), len(points))
    faces = []
    for j in range(m):
        for i in range(n):
            c = i + j * (n + 1)
            quad = [c, c + 1, c + n + 2, c + n + 1]
            faces += [quad] if rng.random() < 0.5 else [quad[:3], [quad[0], *quad[2:]]]
    holes = np.flatnonzero(rng.random(len(faces)) < draw(st.sampled_from([0, 0.3])))
    shape = Shape(points, np.array([len(f) for f in faces]), np.concatenate(faces))
    return replace(
        surface(shape, 0.5, double_sided=draw(st.booleans()), flip_winding=draw(st.booleans())),
        hole_faces=holes.astype(np.int32),
    )


@given(st.lists(hills(), min_size=1, max_size=3), st.floats(0, 180))
def test_vertices_share_out_the_area_of_each_side_of_each_mesh(meshes, crease):
    assume(any(len(m.hole_faces) < len(m.face_vertex_counts) for m in meshes))
    scene = build(meshes, [luminaire()], crease_angle=np.radians(crease))
    areas = scene.vertex_areas
    for mesh, (begin, end, back_end, corner_vertices) in zip(
        meshes, scene.mesh_ranges, strict=True
    ):
        corners, _ = mesh_triangles(mesh)
        p, q, r = mesh.points[mesh.face_vertex_indices[corners]].transpose(1, 0, 2)
        each = np.linalg.norm(np.cross(q - p, r - p), axis=1) / 2
        assert areas[begin:end].sum() == pytest.approx(each.sum(), rel=1e-12)
        if mesh.double_sided:
            np.testing.assert_array_equal(areas[end:back_end], areas[begin:end])
        else:
            assert back_end == end
        own = np.bincount(
            corner_vertices[corners].ravel(), np.repeat(each, 3) / 3, minlength=end - begin
        )
        np.testing.assert_allclose(areas[begin:end], own, rtol=1e-9)


# --- subdivision --------------------------------------------------------------------------------

SHARPNESS = st.sampled_from([0.0, 0.5, 1.0, 2.3, 10.0])


@st.composite
def cages_with_rules(draw):
    mesh = draw(hills())
    faces = np.split(mesh.face_vertex_indices, np.cumsum(mesh.face_vertex_counts)[:-1])
    scheme = draw(st.sampled_from(["catmullClark", "loop", "bilinear"]))
    if scheme == "loop":
        faces = [[f[0], f[i], f[i + 1]] for f in faces for i in range(1, len(f) - 1)]
    edges = sorted({(min(e), max(e)) for f in faces for e in zip(f, np.roll(f, 1), strict=True)})
    creases = draw(st.lists(st.tuples(st.sampled_from(edges), SHARPNESS), max_size=6))
    sharp = st.tuples(st.integers(0, len(mesh.points) - 1), SHARPNESS)
    return mesh.points, cage(
        faces,
        len(mesh.points),
        draw(st.integers(0, 2)),
        scheme=scheme,
        boundary=draw(st.sampled_from(["none", "edgeOnly", "edgeAndCorner"])),
        smooth_triangles=draw(st.booleans()),
        creases=[(*edge, s) for edge, s in creases],
        corners=draw(st.lists(sharp, max_size=3)),
    )


@given(cages_with_rules(), seeds)
@settings(max_examples=60)
def test_a_limit_surface_stays_inside_the_hull_of_its_cage(drawn, seed):
    points, of = drawn
    surface = of.refine()
    limit = surface.limit_points(points)
    weights = surface.limit_stencils
    np.testing.assert_allclose(np.asarray(weights.sum(axis=1)).ravel(), 1, atol=1e-5)
    np.testing.assert_allclose(weights @ points, limit, atol=1e-5 * (1 + np.abs(points).max()))
    directions = np.random.default_rng(seed).normal(size=(3, 30))
    reach = (points @ directions).max(axis=0)
    assert ((limit @ directions) <= reach + 1e-4 * (1 + np.abs(points).max())).all()
