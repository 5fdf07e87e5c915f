"""Triangles of polygon faces: they cover the face once, and face its front."""

import numpy as np
import pytest
from isolux._core import triangulate
from scipy.spatial.transform import Rotation

STAR = [
    (r * np.cos(a), r * np.sin(a))
    for r, a in zip([2, 0.5] * 7, np.arange(14) * np.pi / 7, strict=True)
]
SPIRAL = [
    *[(0, 0), (5, 0), (5, 5), (1, 5), (1, 2), (3, 2)],
    *[(3, 3), (2, 3), (2, 4), (4, 4), (4, 1), (0, 1)],
]
COMB = [(0, 0), (9, 0), *((9 - i / 2, 3 if i % 2 else 0.5) for i in range(19))]
POLYGONS = {
    "triangle": [(0, 0), (1, 0), (0, 1)],
    "square": [(0, 0), (1, 0), (1, 1), (0, 1)],
    "17-gon": [(np.cos(a), np.sin(a)) for a in np.arange(17) * 2 * np.pi / 17],
    "concave quad at corner 0": [(0.2, 0.2), (0, 1), (0, 0), (1, 0)],
    "concave quad at corner 2": [(0, 0), (1, 0), (0.2, 0.2), (0, 1)],
    "L": [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)],
    "star": STAR,
    "spiral": SPIRAL,
    "comb": COMB,
    "corners in line": [(0, 0), (1, 0), (2, 0), (3, 0), (3, 2), (1.5, 2), (0, 2), (0, 1)],
    "corners in line, concave": [(0, 0), (4, 0), (4, 2), (3, 2), (2, 2), (2, 1), (1, 1), (0, 1)],
    "a corner twice": [(0, 0), (1, 0), (1, 0), (1, 1), (0, 1)],
    "touching itself": [(0, 0), (2, 2), (4, 0), (4, 4), (2, 2), (0, 4)],
    "ring with a slit": [
        *[(0, 0), (3, 0), (3, 3), (0, 3), (0, 0)],
        *[(1, 1), (1, 2), (2, 2), (2, 1), (1, 1)],
    ],
}
TURNS = {
    "+z": Rotation.identity(),
    "-z": Rotation.from_euler("x", 180, degrees=True),
    "+x": Rotation.from_euler("y", 90, degrees=True),
    "-x": Rotation.from_euler("y", -90, degrees=True),
    "+y": Rotation.from_euler("x", -90, degrees=True),
    "oblique": Rotation.from_euler("xyz", [35, 45, 20], degrees=True),
}


def triangles(points, counts=None, indices=None, holes=(), flip=False):
    points = np.asarray(points, float)
    counts = [len(points)] if counts is None else counts
    indices = np.arange(sum(counts)) if indices is None else indices
    return triangulate(
        points, np.array(counts, np.int32), np.array(indices, np.int32),
        np.array(holes, np.int32), flip,
    )  # fmt: skip


def flat_area(polygon):
    x, y = np.array(polygon, float).T
    return (x * np.roll(y, -1) - np.roll(x, -1) * y).sum() / 2


def area_vectors(points, corners):
    p, q, r = points[corners].transpose(1, 0, 2)
    return np.cross(q - p, r - p) / 2


@pytest.mark.parametrize("turn", TURNS.values(), ids=TURNS)
@pytest.mark.parametrize("polygon", POLYGONS.values(), ids=POLYGONS)
def test_triangles_cover_a_polygon_once_and_face_its_front(polygon, turn):
    points = turn.apply(np.column_stack([np.array(polygon, float), np.zeros(len(polygon))]))
    for start in range(len(points)):  # whichever corner is the first
        rolled = np.roll(points, start, axis=0)
        corners, faces = triangles(rolled)
        along_normal = area_vectors(rolled, corners) @ turn.apply([0, 0, 1])
        assert (along_normal > -1e-14).all()
        assert along_normal.sum() == pytest.approx(flat_area(polygon))
        assert (faces == 0).all()


@pytest.mark.parametrize("name", ["L", "star", "spiral", "comb", "corners in line, concave"])
def test_triangles_of_a_concave_face_lie_inside_it(name):
    """Their centroids wind once around; with the area kept there is no overlap."""
    polygon = np.array(POLYGONS[name], float)
    corners, _ = triangles(np.column_stack([polygon, np.zeros(len(polygon))]))
    for centroid in polygon[corners].mean(axis=1):
        angles = np.arctan2(*(polygon - centroid).T[::-1])
        turns = np.angle(np.exp(1j * np.diff(np.append(angles, angles[0])))).sum() / (2 * np.pi)
        assert turns == pytest.approx(1)


def test_corners_are_counted_over_all_faces_and_triangles_know_their_face():
    points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0, 0)]
    corners, faces = triangles(points, [4, 3], [0, 1, 2, 3, 1, 4, 2])
    assert corners.tolist() == [[0, 1, 2], [0, 2, 3], [4, 5, 6]]
    assert faces.tolist() == [0, 0, 1]


def test_flipped_winding_turns_every_front():
    """Also of a concave face: other diagonals would leave it."""
    for polygon in POLYGONS.values():
        points = np.column_stack([np.array(polygon, float), np.zeros(len(polygon))])
        corners, _ = triangles(points, flip=True)
        facing = area_vectors(points, corners)[:, 2]
        assert (facing < 1e-14).all()
        assert facing.sum() == pytest.approx(-flat_area(polygon))


def test_holes_are_no_surface():
    points = [(x, y, 0) for y in range(2) for x in range(4)]
    quads = [0, 1, 5, 4, 1, 2, 6, 5, 2, 3, 7, 6]
    corners, faces = triangles(points, [4, 4, 4], quads, holes=[1])
    assert faces.tolist() == [0, 0, 2, 2]
    assert corners.min() == 0
    assert corners[2:].min() == 8


@pytest.mark.parametrize(
    ("points", "counts"),
    [
        ([(0, 0, 0), (1, 1, 1), (2, 2, 2)], [3]),
        ([(0, 0, 0), (0, 0, 0), (1, 0, 0)], [3]),
        ([(1, 2, 3)] * 4, [4]),
        ([(0, 0, 0), (1, 0, 0), (2, 0, 0), (3, 0, 0)], [4]),
        ([(0, 0, 0), (1, 0, 0)], [2]),
        ([(0, 0, 0)], [1, 0]),
        ([(0, 0, 0)], [0]),
    ],
)
def test_faces_without_area_give_no_triangle(points, counts):
    corners, faces = triangles(points, counts)
    assert corners.shape == (0, 3)
    assert faces.shape == (0,)


def test_a_repeated_index_leaves_the_rest_of_the_face():
    points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    corners, _ = triangles(points, [5], [0, 1, 1, 2, 3])
    indices = np.array([0, 1, 1, 2, 3])
    assert np.linalg.norm(
        area_vectors(np.array(points, float), indices[corners]), axis=1
    ).sum() == (pytest.approx(1))


def test_a_face_that_crosses_itself_is_covered_all_the_same():
    bow = [(0, 0, 0), (2, 0, 0), (0, 1, 0), (2, 1.5, 0)]
    corners, _ = triangles(bow)
    assert len(corners) == 2


def test_a_warped_quad_keeps_both_its_triangles():
    warped = [(0, 0, 0), (1, 0, 0.4), (1, 1, 0), (0, 1, 0.4)]
    corners, _ = triangles(warped)
    assert len(corners) == 2
    assert (area_vectors(np.array(warped), corners)[:, 2] > 0).all()
