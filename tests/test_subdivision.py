"""Limit surfaces of control cages, against the closed forms of their schemes."""

import numpy as np
import pytest

from cages import (
    CUBE_EDGES,
    CUBE_FACES,
    CUBE_POINTS,
    cage,
    cube,
    face_area_vectors,
    grid,
    triangles,
)

TWO_BY_TWO = grid(2)
MIDDLE = 4  # of its 9 points


def weights_at(stencils, row):
    return stencils[[row]].toarray()[0]


def test_limit_mask_of_a_regular_catmull_clark_point():
    # Bicubic B-spline at a knot: (1, 4, 1) / 6 each way.
    _, faces = grid(4)
    limit = weights_at(cage(faces, 25, 0).refine().limit_stencils, 12).reshape(5, 5)
    row = np.array([0, 1, 4, 1, 0]) / 6
    np.testing.assert_allclose(limit, np.outer(row, row), atol=1e-12)


def test_limit_mask_of_a_regular_loop_point():
    # Quartic box spline: 1/2 and six times 1/12.
    _, faces = grid(4)
    limit = weights_at(cage(triangles(faces), 25, 0, scheme="loop").refine().limit_stencils, 12)
    assert limit[12] == pytest.approx(1 / 2)
    assert sorted(limit)[-7:-1] == pytest.approx([1 / 12] * 6)


def test_limit_mask_of_an_extraordinary_point():
    # Valence n: n² at the point, 4 an edge, 1 a face, over n(n + 5) [Halstead et al. 1993].
    limit = weights_at(cube(0).refine().limit_stencils, 7)
    distance = np.abs(CUBE_POINTS - CUBE_POINTS[7]).sum(axis=1) / 2
    expected = np.select([distance == 0, distance == 1, distance == 2], [9, 4, 1]) / 24
    np.testing.assert_allclose(limit, expected, atol=1e-12)


@pytest.mark.parametrize(
    ("boundary", "corner", "edge"),
    [
        ("edgeAndCorner", (1, 0, 0), (1 / 6, 4 / 6, 1 / 6)),
        ("edgeOnly", (4 / 6, 1 / 6, 1 / 6), (1 / 6, 4 / 6, 1 / 6)),
    ],
)
def test_limit_of_a_boundary_is_a_cubic_curve(boundary, corner, edge):
    _, faces = TWO_BY_TWO
    limit = cage(faces, 9, 0, boundary=boundary).refine().limit_stencils
    assert weights_at(limit, 0)[[0, 1, 3]] == pytest.approx(corner)
    assert weights_at(limit, 1)[[0, 1, 2]] == pytest.approx(edge)


def test_without_boundary_interpolation_the_faces_at_the_boundary_are_no_surface():
    _, faces = grid(4)
    surface = cage(faces, 25, 1, boundary="none").refine()
    left = np.setdiff1d(np.arange(len(surface.topology.counts)), surface.hole_faces)
    assert np.unique(surface.cage_faces[left]).tolist() == [5, 6, 9, 10]


@pytest.mark.parametrize("scheme", ["catmullClark", "loop", "bilinear"])
def test_all_levels_lie_on_one_limit_surface(scheme):
    faces = triangles(CUBE_FACES) if scheme == "loop" else CUBE_FACES
    coarse, fine = (cage(faces, 8, level, scheme=scheme).refine() for level in (1, 3))
    fine_points = fine.limit_points(CUBE_POINTS)
    for point in coarse.limit_points(CUBE_POINTS):
        assert np.abs(fine_points - point).sum(axis=1).min() < 1e-12


def test_a_bilinear_surface_is_its_cage():
    surface = cube(3, scheme="bilinear").refine()
    points = surface.limit_points(CUBE_POINTS)
    areas = np.linalg.norm(face_area_vectors(surface.topology, points), axis=1)
    assert areas.sum() == pytest.approx(24.0, rel=1e-12)
    assert surface.limit_normals(CUBE_POINTS) is None


def test_a_cube_sharp_at_all_edges_stays_a_cube():
    surface = cube(2, creases=[(*edge, 10) for edge in CUBE_EDGES]).refine()
    points, normals = surface.limit_points(CUBE_POINTS), surface.limit_normals(CUBE_POINTS)
    vectors = face_area_vectors(surface.topology, points)
    areas = np.linalg.norm(vectors, axis=1)
    assert areas.sum() == pytest.approx(24.0, rel=1e-12)
    np.testing.assert_allclose(normals, np.repeat(vectors / areas[:, None], 4, axis=0), atol=1e-6)


def fine_normals(faces, point_count, points, **rules):
    """Unit normals of small faces of a fine level, by the place of their corners."""
    surface = cage(faces, point_count, 5, **rules).refine()
    vectors = face_area_vectors(surface.topology, surface.limit_points(points))
    normals = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    corners = surface.limit_points(points)[surface.topology.indices]
    return corners, np.repeat(normals, surface.topology.counts, axis=0), surface.cage_faces


@pytest.mark.parametrize(
    ("faces", "rules"),
    [
        (CUBE_FACES, {}),
        (triangles(CUBE_FACES), {"scheme": "loop"}),
        (CUBE_FACES, {"creases": [(1, 3, 10), (3, 7, 10), (5, 7, 10), (1, 5, 10)]}),
        (CUBE_FACES, {"creases": [(1, 3, 1), (3, 7, 1), (5, 7, 1), (1, 5, 1)]}),
        (CUBE_FACES[1:], {}),
        ([[0, 1, 3], [0, 3, 2], *CUBE_FACES[1:]], {"smooth_triangles": True}),
    ],
    ids=["catmullClark", "loop", "crease", "semi-sharp", "open", "triangles"],
)
def test_normals_are_those_of_the_faces_of_a_far_finer_level(faces, rules):
    surface = cage(faces, 8, 2, **rules).refine()
    points, normals = surface.limit_points(CUBE_POINTS), surface.limit_normals(CUBE_POINTS)
    corners, fine, fine_parents = fine_normals(faces, 8, CUBE_POINTS, **rules)
    parents = np.repeat(surface.cage_faces, surface.topology.counts)
    fine_parents = np.repeat(
        fine_parents, np.diff(np.linspace(0, len(fine), len(fine_parents) + 1, dtype=int))
    )
    for corner in range(0, len(parents), 11):
        here = points[surface.topology.indices[corner]]
        near = (np.abs(corners - here).sum(axis=1) < 1e-9) & (fine_parents == parents[corner])
        mean = fine[near].mean(axis=0)
        assert normals[corner] @ mean / np.linalg.norm(mean) > np.cos(np.radians(4.0))


def test_a_crease_has_two_normals_and_a_smooth_edge_one():
    ring = [(1, 3, 10), (3, 7, 10), (5, 7, 10), (1, 5, 10)]
    surface = cube(2, creases=ring).refine()
    normals, points = surface.limit_normals(CUBE_POINTS), surface.topology.indices
    kinds = [len(np.unique(np.round(normals[points == p], 4), axis=0)) for p in range(points.max())]
    on_ring = surface.limit_points(CUBE_POINTS)[:-1, 2] > 1 - 1e-9
    top = np.unique(points.reshape(-1, 4)[surface.cage_faces == 5])
    border = np.isin(np.arange(len(kinds)), top) & np.isin(
        np.arange(len(kinds)), points.reshape(-1, 4)[surface.cage_faces != 5]
    )
    assert on_ring.any()
    assert set(np.array(kinds)[border]) == {2}
    assert set(np.array(kinds)[~border]) == {1}


@pytest.mark.parametrize("scheme", ["catmullClark", "loop", "bilinear"])
@pytest.mark.parametrize("level", [0, 1, 3])
def test_primvars_of_every_interpolation_spread_over_a_flat_grid(scheme, level):
    points, faces = grid(3)
    faces = triangles(faces) if scheme == "loop" else faces
    surface = cage(faces, len(points), level, scheme=scheme, face_varying="all").refine()
    limit = surface.limit_points(points)
    vertex = surface.refine_primvar(points, "vertex")
    np.testing.assert_allclose(vertex, limit, atol=1e-12)
    # Linear over the cage: the place of each point before it moves to the limit.
    varying = surface.refine_primvar(points, "varying")
    corners = surface.refine_primvar(points[np.concatenate(faces)], "faceVarying")
    np.testing.assert_allclose(corners, varying[surface.topology.indices], atol=1e-12)
    assert varying.min() == 0
    assert varying.max() == 3
    uniform = surface.refine_primvar(np.arange(len(faces))[:, None], "uniform")
    np.testing.assert_array_equal(uniform[:, 0], surface.cage_faces)
    assert surface.refine_primvar(np.ones((1, 3)), "constant").shape == (1, 3)


def test_a_seam_of_a_face_varying_primvar_stays_one():
    _, faces = TWO_BY_TWO
    surface = cage(faces, 9, 2).refine()
    left = np.repeat([1.0, 0.0, 1.0, 0.0], 4)[:, None]  # one chart on the left, one on the right
    spread = surface.refine_primvar(left, "faceVarying")
    np.testing.assert_allclose(spread[:, 0], np.repeat(1.0 - surface.cage_faces % 2, 4), atol=1e-12)


@pytest.mark.parametrize("level", [0, 1, 2])
@pytest.mark.parametrize("faces", [CUBE_FACES, [[0, 1, 3, 2, 6, 4], [0, 4, 5, 1]]])
def test_each_corner_of_the_cage_is_found_on_the_refined_faces(faces, level):
    surface = cage(faces, 8, level).refine()
    corners = surface.corners_of_cage
    # A corner's point is the cage's own, first of its limit's weights; its face a part of it.
    limit = surface.limit_stencils[surface.topology.indices[corners]]
    nearest = surface.nearest("vertex")[surface.topology.indices[corners]]
    np.testing.assert_array_equal(nearest, np.concatenate(faces))
    assert limit.shape == (len(corners), 8)
    parents = np.repeat(surface.cage_faces, surface.topology.counts)[corners]
    np.testing.assert_array_equal(parents, np.repeat(range(len(faces)), [len(f) for f in faces]))


@pytest.mark.parametrize(
    "faces",
    [
        [[0, 1, 2, 2], [0, 2, 3, 1]],  # an edge without length
        [[0, 1, 2], [0, 1, 3], [1, 0, 4]],  # three faces at an edge
        [[0, 1, 2, 3], [0, 1, 2, 3]],  # a face twice
        [[0, 1, 0, 2]],  # a point used twice
        [[0, 1, 2], [0, 3, 4]],  # two faces at a point
    ],
)
def test_odd_topology_gives_finite_points(faces):
    faces = [[0, 2, 4], *faces]
    for level in (0, 1, 2):
        surface = cage(faces, 5, level).refine()
        assert np.isfinite(surface.limit_points(CUBE_POINTS[:5])).all()
        assert np.isfinite(surface.limit_normals(CUBE_POINTS[:5])).all()
        charts = surface.refine_primvar(
            np.arange(len(np.concatenate(faces)))[:, None], "faceVarying"
        )
        assert np.isfinite(charts).all()


def test_of_equal_corners_next_to_each_other_one_is_left():
    quads, triangle = [[0, 1, 2, 2], [2, 1, 3, 4]], [[0, 1, 2], [2, 1, 3, 4]]
    for level in (0, 2):
        squeezed, plain = (cage(f, 5, level).refine() for f in (quads, triangle))
        np.testing.assert_array_equal(squeezed.topology.indices, plain.topology.indices)
    assert squeezed.corners_of_cage[:4].min() == -1


def test_faces_that_use_a_point_twice_take_no_part():
    bow = cage([[0, 1, 0, 2], [2, 3, 4]], 5, 1)
    assert bow.faces.tolist() == [1]
    assert set(bow.refine().cage_faces) == {1}


def test_loop_refuses_what_is_no_triangle():
    with pytest.raises(ValueError, match="Loop"):
        cube(1, scheme="loop").refine()
