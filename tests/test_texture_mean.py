"""The mean of a texture over triangles, against sums by hand and against a million samples."""

import numpy as np
import pytest

from isolux.texture_mean import MAX_CROSSINGS, TexelSums

WRAPS = ["repeat", "mirror", "clamp", "black"]
# Numbers unlike each other, so that a texel taken for another is seen.
TEXELS = (np.arange(35).reshape(5, 7, 1) * 0.618034) % 1.0
HALVES = np.array([[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]], float)


def sums(wrap=("repeat", "repeat"), texels=TEXELS, outside=0.0):
    return TexelSums(texels, wrap, np.full(texels.shape[2], outside))


def looked_up(points, wrap, outside=0.0):
    """Texels at (n, 2) coordinates, by the definition of the wrap modes."""
    height, width, _ = TEXELS.shape
    cells, inside = [], np.ones(len(points), bool)
    for place, size, mode in zip(
        (points[:, 0], 1 - points[:, 1]), (width, height), wrap, strict=True
    ):
        if mode == "mirror":
            place = 1 - np.abs(place % 2 - 1)
        if mode == "repeat":
            place = place % 1
        if mode == "black":
            inside &= (place >= 0) & (place < 1)
        cells.append(np.clip(np.floor(place * size).astype(int), 0, size - 1))
    return np.where(inside, TEXELS[cells[1], cells[0], 0], outside)


def test_two_halves_of_the_picture_give_its_mean():
    assert sums().triangle_means(HALVES).mean() == pytest.approx(TEXELS.mean(), rel=1e-12)


def test_the_first_row_is_on_top():
    top = np.array([[[0, 0.8], [1, 0.8], [0.5, 1]]], float)
    rows = TEXELS[0, :, 0]
    columns = (np.arange(7000) + 0.5) / 7000
    share = 1 - np.abs(2 * columns - 1)  # height of the triangle over each column
    expected = (rows[(columns * 7).astype(int)] * share).sum() / share.sum()
    assert sums().triangle_means(top)[0, 0] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("across", WRAPS)
@pytest.mark.parametrize("down", WRAPS)
def test_any_triangle_in_any_wrap_mode_is_what_a_million_samples_find(across, down):
    wrap = (across, down)
    corners = np.array([[-1.3, 0.4], [1.9, -0.7], [0.6, 2.2]])
    n = 1000
    i, j = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    a, b = (i.ravel() + 0.5) / n, (j.ravel() + 0.5) / n
    folded = a + b > 1
    a, b = np.where(folded, 1 - a, a), np.where(folded, 1 - b, b)
    points = corners[0] + a[:, None] * (corners[1] - corners[0])
    points = points + b[:, None] * (corners[2] - corners[0])
    expected = looked_up(points, wrap, outside=0.25).mean()
    found = sums(wrap, outside=0.25).triangle_means(corners[None])[0, 0]
    assert found == pytest.approx(expected, abs=2e-4)  # samples of edges: 1e-3 of them wrong by 0.2


@pytest.mark.parametrize("turned", [False, True])
def test_a_triangle_counts_the_same_from_either_side(turned):
    corners = np.array([[0.1, 0.2], [1.7, 0.4], [0.3, 0.9]])
    there = sums().triangle_means(corners[None])
    back = sums().triangle_means(corners[None, ::-1])
    np.testing.assert_allclose(there, back, rtol=1e-12)


@pytest.mark.parametrize("far", [1e3, 1e6])
def test_far_off_tiles_are_the_same_tiles(far):
    corners = np.array([[0.1, 0.2], [1.7, 0.4], [0.3, 0.9]])
    near = sums().triangle_means(corners[None])
    np.testing.assert_allclose(sums().triangle_means(corners[None] + far), near, atol=1e-8)


@pytest.mark.parametrize("times", [10, 1000, 1_000_000])
def test_many_repeats_give_the_mean_of_the_picture(times):
    found = sums().triangle_means(HALVES * times).mean()
    tolerance = 1e-9 if 7 * times < MAX_CROSSINGS else 1e-3
    assert found == pytest.approx(TEXELS.mean(), rel=tolerance)


@pytest.mark.parametrize(
    "corners",
    [
        [[0.5, 0.5]] * 3,  # a palette: all of the face at one texel
        [[0.45, 0.45], [0.55, 0.55], [0.5, 0.5]],  # no area, within one texel
        [[0.5, 0.5], [0.5 + 1e-9, 0.5], [0.5, 0.5 + 1e-9]],
    ],
)
def test_a_triangle_without_area_is_looked_up(corners):
    found = sums().triangle_means(np.array([corners]))
    assert found[0, 0] == pytest.approx(TEXELS[2, 3, 0], rel=1e-9)


def test_channels_are_kept_apart():
    colours = np.dstack([TEXELS, 2 * TEXELS, np.ones_like(TEXELS)])
    found = sums(texels=colours).triangle_means(HALVES).mean(axis=0)
    np.testing.assert_allclose(found, TEXELS.mean() * np.array([1, 2, 1 / TEXELS.mean()]))
