"""What must not change the light: the unit of length, the place, the orientation, the company."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from usd_scenes.furnace_sphere.generate import icosphere
from usd_scenes.shapes import box

from core_scenes import luminaire, surface, trace
from solved_scenes import mean, photometric, solved
from validation.rows import INVARIANCE

pytestmark = pytest.mark.validation(INVARIANCE)

PHOTONS = 60_000
FLUX = 2000.0  # lm


def moved(description, transform):
    return dataclasses.replace(description, points=transform(description.points))


def room(transform=lambda points: points, scale=1.0):
    """4 m wide, with a ball in it and a rectangular lamp; flux per area stays as it is."""
    meshes = [
        surface(box((4, 4, 4), 0.5).flipped(), 0.6),
        surface(icosphere(2).moved(0.5, -0.75, -1.0), 0.4),
    ]
    lamp = luminaire(
        FLUX * scale**2,
        transform(np.array([[0.5, 0.25, 1.75]]))[0],
        "rect",
        (0.5 * scale, 0.25 * scale),
    )
    return trace([moved(m, transform) for m in meshes], [lamp], PHOTONS)


@pytest.fixture(scope="module")
def reference():
    return room()


@pytest.mark.parametrize("exponent", [-20, -7, 7, 20])
def test_powers_of_two_in_size_change_no_bit(validation, reference, exponent):
    scale = 2.0**exponent
    scaled = room(lambda points: points * scale, scale)
    other = np.count_nonzero(scaled.hits != reference.hits)
    case = f"scale 2^{exponent}, vertices with other counts of photons"
    validation.check(case, 0, other, absolute=0, unit="")
    for component in ("direct", "indirect", "relative_deviation"):
        assert np.array_equal(scaled.filtered()[component], reference.filtered()[component])


@pytest.mark.parametrize("scale", [1e-6, 1e-3, 1e3, 1e6])
def test_the_unit_of_length_is_free(validation, reference, scale):
    """Rounding sends some photons other ways; filtered values differ where distances tied."""
    scaled = room(lambda points: points * scale, scale)
    assert share_of_other_hits(scaled, reference) < 5e-3
    case = f"scale {scale:g}, mean direct and indirect light"
    validation.check(case, reference.mean_illuminance, scaled.mean_illuminance, relative=1e-3)
    filtered, expected = scaled.filtered(), reference.filtered()
    off = filtered["indirect"][:, 0] - expected["indirect"][:, 0]
    rms = np.sqrt(np.average(off**2, weights=reference.areas))
    assert rms < expected["rms_error_indirect"] * reference.mean_illuminance[1]


def test_a_place_far_from_the_origin_changes_no_bit():
    """All coordinates of box and lamp are whole eighths, which doubles hold at 10⁷ as well."""
    meshes = [surface(box((4, 4, 4), 0.5).flipped(), 0.6)]
    near, far = (
        trace([moved(m, lambda p, at=at: p + at) for m in meshes], [luminaire(FLUX, at)], PHOTONS)
        for at in (np.zeros(3), np.array([1e7, -1e7, 1e7]))
    )
    assert np.array_equal(far.hits, near.hits)
    for component in ("direct", "indirect"):
        assert np.array_equal(far.filtered()[component], near.filtered()[component])


def test_a_place_far_from_the_origin_keeps_its_light(validation, reference):
    """A ball's points are rounded at 10⁷, to 10⁻⁹ m: some photons near edges go other ways."""
    far = room(lambda points: points + 1e7)
    assert share_of_other_hits(far, reference) < 1e-3
    case = "10⁷ m from the origin, mean direct and indirect light"
    validation.check(case, reference.mean_illuminance, far.mean_illuminance, relative=1e-4)


def share_of_other_hits(a, b):
    return np.abs(a.hits - b.hits).sum() / b.hits.sum()


def assert_samples_of_one_expectation(counts, others):
    """χ² of two histograms of as many photons."""
    total = counts + others
    filled = total > 10
    squares = (counts - others)[filled] ** 2 / total[filled]
    assert chi2.sf(squares.sum(), filled.sum()) > 1e-3


def test_a_turned_room_has_the_same_light(validation, reference):
    turn = Rotation.from_euler("xyz", [30, 40, 50], degrees=True).as_matrix().T
    meshes = [moved(m, lambda points: points @ turn) for m in reference.meshes]
    at = np.array([0.5, 0.25, 1.75]) @ turn
    lamp = luminaire(FLUX, at, "rect", (0.5, 0.25), axes=np.eye(3) @ turn)
    turned = trace(meshes, [lamp], PHOTONS, seed=2)
    assert_samples_of_one_expectation(turned.hits[:, 0], reference.hits[:, 0])
    # Indirect hits of one photon correlate a little: they are tested by their mean.
    validation.check(
        "turned room, mean direct and indirect light, photons",
        *(reference.mean_illuminance, turned.mean_illuminance),
        sigma=reference.mean_illuminance * np.sqrt(2 / (0.6 * PHOTONS)),
    )


def test_two_luminaires_give_the_sum_of_their_light(validation):
    meshes = [surface(box((4, 4, 4), 0.5).flipped(), 0.5)]
    lamps = [
        luminaire(1500.0, (1, 1, 1)),
        luminaire(500.0, (-1, 0, -1.5), "disk", (0.2, 0.0)),
    ]
    both = trace(meshes, lamps, 4 * PHOTONS, seed=3)
    alone = [trace(meshes, [lamp], PHOTONS, seed=4 + i) for i, lamp in enumerate(lamps)]
    total = sum(traced.illuminance for traced in alone)
    variance = both.illuminance * both.photon_flux / both.areas[:, None] + sum(
        traced.illuminance * traced.photon_flux / traced.areas[:, None] for traced in alone
    )
    squares = (both.illuminance - total)[:, 0] ** 2 / variance[:, 0]
    assert chi2.sf(squares.sum(), len(squares)) > 1e-3
    # At reflectance ρ the mean indirect light of N photons deviates by 1 / √(ρ N).
    sigma = both.mean_illuminance[1] * np.sqrt(2 / (0.5 * PHOTONS))
    validation.check(
        "two luminaires, mean indirect light, the sum of each alone, photons",
        *(sum(traced.mean_illuminance[1] for traced in alone), both.mean_illuminance[1]),
        sigma=sigma,
    )


def test_a_turned_room_by_the_composite(validation):
    """Vertex by vertex, and in other directions from a larger scale on."""
    turn = 3.0 * Rotation.from_euler("xyz", [70, -20, 110], degrees=True).as_matrix().T
    meshes = [
        surface(box((4, 4, 4), 0.5).flipped(), 0.6, path="/Room"),
        surface(icosphere(2).moved(0.5, -0.75, -1.0), 0.4, path="/Ball"),
    ]
    at, size = np.array([0.5, 0.25, 1.75]), np.array([0.5, 0.25])
    lamp = luminaire(FLUX, at, "rect", tuple(size))
    turned_lamp = luminaire(FLUX * 9, at @ turn, "rect", tuple(3 * size), axes=turn / 3)
    a, b = (
        solved(scene, [light], method="composite", photons=50_000)
        for scene, light in (
            (meshes, lamp),
            ([moved(m, lambda points: points @ turn) for m in meshes], turned_lamp),
        )
    )
    for component in ("direct", "indirect"):
        x, y = photometric(a, component), photometric(b, component)
        rms = np.sqrt(np.average((x - y) ** 2, weights=a.vertex_areas))
        case = f"room turned and 3 times as large, RMS between their {component} light, composite"
        # Each stopped where it tells such an error of its total light.
        tolerance = np.hypot(a.stage.rms_error, b.stage.rms_error) * mean(a)
        validation.bound(case, rms, at_most=tolerance, unit="lx")
