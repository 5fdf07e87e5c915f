"""What reading does to every point and corner, against NumPy and counting by hand."""

import numpy as np
import pytest

from isolux import _core

THREADS = 2
QUADS = 70_000  # more than one thread takes at a time


def survey(counts, indices, threads=THREADS):
    return _core.survey_topology(np.array(counts, np.int32), np.array(indices, np.int32), threads)


@pytest.mark.parametrize(
    ("counts", "indices", "degenerate"),
    [
        ([3], [0, 1, 2], 0),
        ([3], [0, 1, 0], 1),
        ([4, 4], [0, 1, 2, 3, 4, 5, 6, 4], 1),
        ([2, 3, 1, 0], [0, 1, 0, 1, 2, 3], 3),
        ([40], [*range(39), 39], 0),
        ([40, 3], [*range(39), 7, 0, 1, 2], 1),
    ],
)
def test_faces_under_three_corners_or_with_a_point_twice_are_counted(counts, indices, degenerate):
    assert survey(counts, indices).degenerate_faces == degenerate


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize(("index", "low", "high"), [(-5, -5, 10**6), (10**9, 0, 10**9)])
def test_one_wrong_index_among_many_is_seen_wherever_it_is(index, low, high, threads):
    rng = np.random.default_rng(1)
    for place in (0, 4 * QUADS // 2, 4 * QUADS - 1):
        indices = rng.integers(1, 10**6, 4 * QUADS, dtype=np.int32)
        indices[[1, 2]] = 0, 10**6
        indices[place] = index
        found = survey(np.full(QUADS, 4), indices, threads)
        assert (found.least_index, found.greatest_index) == (low, high)


def test_mixed_faces_are_told_apart_in_every_part():
    rng = np.random.default_rng(2)
    counts = rng.integers(0, 7, 200_000, dtype=np.int32)
    indices = rng.integers(0, 12, counts.sum(), dtype=np.int32)
    faces = np.split(indices, np.cumsum(counts)[:-1])
    expected = sum(len(face) < 3 or len(set(face.tolist())) < len(face) for face in faces)
    assert survey(counts, indices).degenerate_faces == expected


@pytest.mark.parametrize("counts", [[4, 4], [-1, 5], [2**31 - 1] * 3])
def test_counts_that_do_not_add_up_are_never_followed(counts):
    found = survey(counts, [0, 1, 2, 3])
    assert (found.corners, found.least_count) == (sum(counts), min(counts))


@pytest.mark.parametrize("count", [5, 70_000])
def test_points_are_placed_as_by_matrix_product(count):
    rng = np.random.default_rng(3)
    points = rng.normal(size=(count, 3)).astype(np.float32)
    matrix = rng.normal(size=(4, 3))
    placed = np.empty((count, 3))
    assert _core.place_points(points, matrix, placed, THREADS)
    np.testing.assert_allclose(placed, points.astype(float) @ matrix[:3] + matrix[3], atol=1e-12)


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("row", [0, 69_999])
def test_one_point_that_is_not_finite_is_seen(wrong, row):
    points = np.zeros((70_000, 3), np.float32)
    points[row, 1] = wrong
    identity = np.eye(4)[:, :3].copy()
    assert not _core.place_points(points, identity, np.empty(points.shape), THREADS)


def test_points_that_overflow_are_not_finite():
    points = np.full((1, 3), 3e38, np.float32)
    assert not _core.place_points(points, np.full((4, 3), 1e300), np.empty((1, 3)), THREADS)


@pytest.mark.parametrize("spread", [True, False])
def test_normals_are_turned_and_of_unit_length(spread):
    rng = np.random.default_rng(4)
    normals = rng.normal(size=(70_000, 3)).astype(np.float32)
    matrix = np.vstack([rng.normal(size=(3, 3)), np.zeros((1, 3))])
    of = rng.integers(0, len(normals), 280_000, dtype=np.int32) if spread else None
    placed = np.empty((len(normals) if of is None else len(of), 3), np.float32)
    assert _core.place_normals(normals, of, matrix, placed, THREADS)
    turned = normals.astype(float) @ matrix[:3]
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    np.testing.assert_allclose(placed, turned if of is None else turned[of], atol=1e-7)


@pytest.mark.parametrize("wrong", [0.0, np.nan, np.inf])
def test_one_normal_without_a_direction_is_seen(wrong):
    normals = np.tile(np.float32([0, 0, 1]), (70_000, 1))
    normals[65_537] = wrong
    identity = np.eye(4)[:, :3].copy()
    assert not _core.place_normals(normals, None, identity, np.empty_like(normals), THREADS)
