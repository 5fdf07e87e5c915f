"""Light from infinitely far: distant lights and domes, against closed forms and quadrature."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chisquare
from usd_scenes.furnace_sphere.generate import icosphere
from usd_scenes.shapes import box, rectangle

from core_scenes import bucket_flux, build, distant, dome, luminaire, surface, trace
from isolux import _core
from validation.rows import DIRECT

pytestmark = pytest.mark.validation(DIRECT)

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
FLOOR = surface(rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0), 0.5))
TURNED = Rotation.from_euler("xyz", [20, -50, 130], degrees=True).as_matrix().T
PHOTONS = 100_000


def illuminate(scene, points=None, normals=None, seed=1, accuracy=0.01):
    """Photometric; by default at the scene's own receivers."""
    if points is None:
        points, normals = scene.receiver_positions, scene.vertex_normals
    found = _core.DirectLighting(scene, seed, accuracy).illuminate(
        np.atleast_2d(np.asarray(points, float)),
        np.ascontiguousarray(np.broadcast_to(np.asarray(normals, np.float32), np.shape(points))),
        np.zeros(0, np.float32),
        2,
    )
    return found["illuminance"].astype(float) @ LUMINANCE, found


def tilted(degrees):
    """(n, 3) unit, turned from +Z about X."""
    angle = np.radians(np.atleast_1d(degrees))
    return np.stack([np.zeros_like(angle), np.sin(angle), np.cos(angle)], axis=1)


def sphere_of_directions(rows=480, columns=960):
    """Directions (n, 3), their solid angles (n,), rows and columns, as OpenEXR has them."""
    edges = np.sin(np.pi * (0.5 - np.arange(rows + 1) / rows))
    y = (edges[:-1] + edges[1:]) / 2
    turn = np.pi * (1 - 2 * (np.arange(columns) + 0.5) / columns)
    solid_angle = np.repeat((edges[:-1] - edges[1:]) * 2 * np.pi / columns, columns)
    y, turn = np.repeat(y, columns), np.tile(turn, rows)
    r = np.sqrt(1 - y**2)
    row, column = np.divmod(np.arange(rows * columns), columns)
    return np.stack([r * np.sin(turn), y, r * np.cos(turn)], axis=1), solid_angle, row, column


DIRECTIONS, SOLID_ANGLE, ROW, COLUMN = sphere_of_directions()


@pytest.mark.parametrize("degrees", [0.0, 30.0, 60.0, 89.0, 120.0])
def test_parallel_light_falls_with_the_cosine(validation, degrees):
    lit, found = illuminate(build([FLOOR], [distant(1000.0)]), np.ones((1, 3)), tilted(degrees))
    expected = 1000 * max(0, np.cos(np.radians(degrees)))
    case = f"parallel light, {degrees:g}° off the normal"
    validation.check(case, expected, lit[0], relative=1e-6, absolute=1e-9)
    assert found["standard_error"][0] == 0


@pytest.mark.parametrize("half_angle", [0.265, 5.0, 45.0, 90.0, 120.0, 180.0])
def test_a_cone_of_light_against_quadrature(validation, half_angle):
    """Over a floor that hides none of it; also where the horizon cuts it."""
    degrees = np.array([0.0, 40.0, 70.0, 85.0, 90.0, 95.0, 130.0, 180.0])
    normals = tilted(degrees)
    cosine = np.cos(np.radians(half_angle))
    # On a grid around the light's own axis.
    below = (1 - cosine) * (np.arange(2000) + 0.5) / 2000
    turn = 2 * np.pi * (np.arange(1000) + 0.5) / 1000
    sine = np.sqrt(below * (2 - below))[:, None]
    to_light = np.stack(
        [
            sine * np.cos(turn),
            sine * np.sin(turn),
            np.broadcast_to(1 - below[:, None], (2000, 1000)),
        ]
    ).reshape(3, -1)
    expected = [1000 * np.maximum(0, n @ to_light).mean() for n in normals]
    scene = build([FLOOR], [distant(1000.0, np.radians(half_angle))])
    high_up = np.tile([0, 0, 500.0], (len(normals), 1))  # what the floor hides is small
    lit, _ = illuminate(scene, high_up, normals)
    case = f"distant light from a cone of {half_angle:g}°, by quadrature"
    validation.check(case, expected, lit, relative=2e-4, absolute=0.05)


@pytest.mark.parametrize("axes", [np.eye(3), TURNED], ids=["upright", "turned"])
@pytest.mark.parametrize(
    "light",
    [distant(1000.0), distant(1000.0, 0.6), distant(1000.0, 2.5), dome(100.0), "map"],
    ids=["parallel", "cone", "wide cone", "constant dome", "dome"],
)
def test_photons_and_shadow_rays_see_the_same_light(light, axes):
    """χ² of the photons on a closed sphere from outside, where each point sees a hemisphere."""
    light = dome(environment(), axes) if light == "map" else replace(light, axes=axes)
    sphere = surface(icosphere(3))
    traced = trace([sphere], [light], PHOTONS)
    scene = build([FLOOR], [light])

    def illuminance(points, normals):
        return illuminate(scene, np.tile([0, 0, 1e4], (len(normals), 1)), normals)[0]

    expected = bucket_flux(traced, illuminance, divisions=3) / traced.photon_flux
    ends = traced.buckets.ends
    assert ends["emitted"] == PHOTONS == ends["absorbed"] + ends["escaped"]
    assert traced.hits[:, 0].sum() == pytest.approx(expected.sum(), abs=2 * np.sqrt(PHOTONS))
    counts, lit = traced.hits[:, 0], expected > 5
    assert counts[expected == 0].sum() == 0
    predicted = expected[lit] * counts[lit].sum() / expected[lit].sum()
    assert chisquare(counts[lit], predicted).pvalue > 1e-3


def environment(rows=24, columns=48):
    """A sky above, a ground below, a sun of five texels and a coloured side; cd/m²."""
    map_ = np.zeros((rows, columns, 3), np.float32)
    map_[: rows // 2] = (80.0, 100.0, 160.0)
    map_[rows // 2 :] = (30.0, 20.0, 10.0)
    map_[5, 20:25] = (9000.0, 8000.0, 7000.0)
    map_[:, 40:44] += (0.0, 60.0, 0.0)
    return map_


@pytest.mark.parametrize("normal", [(0, 0, 1), (1, 0, 0), (0.6, -0.8, 0), (-0.3, -0.4, -0.866)])
def test_a_constant_dome_gives_pi_times_its_luminance_whatever_the_direction(normal):
    scene = build([FLOOR], [dome(100.0)])
    lit, found = illuminate(scene, np.array([[0, 0, 1e5]]), [normal])
    assert lit[0] == pytest.approx(100 * np.pi, rel=1e-6)
    assert found["standard_error"][0] < 0.01 * lit[0]


def test_a_constant_dome_on_an_open_plane():
    scene = build([FLOOR], [dome(100.0)])
    lit, _ = illuminate(scene)
    assert lit == pytest.approx(np.full(len(lit), 100 * np.pi), rel=1e-6)


def test_a_plane_at_right_angles_to_an_endless_floor_sees_half_of_a_dome():
    """Floor and plane are black. The floor ends at 10 km, a height of 1 m above it."""
    floor = surface(rectangle((-1e4, -1e4, 0), (2e4, 0, 0), (0, 2e4, 0), 1e4))
    lit, found = illuminate(
        build([floor], [dome(100.0)]), [[0, 0, 1.0]], [[1, 0, 0]], accuracy=1e-3
    )
    assert lit[0] == pytest.approx(50 * np.pi, abs=4 * float(found["standard_error"][0]))
    assert lit[0] == pytest.approx(50 * np.pi, rel=0.01)


@pytest.mark.parametrize("axes", [np.eye(3), TURNED], ids=["upright", "turned"])
def test_a_textured_dome_against_quadrature_over_its_map(axes):
    map_ = environment()
    texels = map_[ROW // 20, COLUMN // 20]
    normals = np.vstack([np.eye(3), -np.eye(3), TURNED, [[0.6, -0.8, 0]]])
    expected = [
        (texels * (np.maximum(0, DIRECTIONS @ axes @ n) * SOLID_ANGLE)[:, None]).sum(axis=0)
        for n in normals
    ]
    scene = build([FLOOR], [dome(map_, axes)])
    _, found = illuminate(scene, np.tile([0, 0, 1e4], (len(normals), 1)), normals)
    assert found["illuminance"] == pytest.approx(np.array(expected), rel=3e-4)


def room_with_a_window():
    """A floor, and walls and a ceiling of 4 m with a square of 2 m left out."""
    walls = surface(box((4, 4, 4), 0.5).flipped(), double_sided=True)
    faces = walls.face_vertex_indices.reshape(-1, walls.face_vertex_counts[0])
    middles = walls.points[faces].mean(axis=1)
    is_window = (np.abs(middles[:, 0] - 2) < 1e-9) & (np.abs(middles[:, 1:]) < 1).all(axis=1)
    is_floor = np.abs(middles[:, 2] + 2) < 1e-9
    kept = ~is_window & ~is_floor
    room = replace(
        walls,
        face_vertex_counts=walls.face_vertex_counts[kept],
        face_vertex_indices=faces[kept].reshape(-1),
    )
    return [surface(rectangle((-2, -2, -2), (4, 0, 0), (0, 4, 0), 0.5)), room]


def on_the_floor(count):
    """Points of an even grid, (count², 3)."""
    along = 4 * (np.arange(count) + 0.5) / count - 2
    x, y = np.meshgrid(along, along)
    return np.stack([x, y, np.full_like(x, -2.0)], axis=-1).reshape(-1, 3)


def mean_error(found):
    """lx, of the mean of what was found at many points."""
    squares = found["standard_error"].astype(float) ** 2
    return float(np.sqrt(squares.mean() / len(squares)))


def test_light_through_a_window_is_that_of_photons():
    """Direct light of a floor in a room with a window, by shadow rays and by photons."""
    traced = trace(room_with_a_window(), [dome(environment(), TURNED)], 600_000)
    hits = traced.hits[traced.front(), 0].sum()
    by_photons = hits * traced.photon_flux / 16
    lit, found = illuminate(traced.scene, on_the_floor(24), [0, 0, 1.0])
    assert hits > 1_000
    error = np.hypot(by_photons / hits**0.5, mean_error(found))
    assert lit.mean() == pytest.approx(by_photons, abs=4 * error)


def test_a_window_before_a_dome_is_a_rectangle_of_its_luminance():
    """What makes a portal of it: a rectangular luminaire of the dome's luminance in the window."""
    meshes = room_with_a_window()
    facing_in = np.array([[0, 1.0, 0], [0, 0, 1], [1, 0, 0]])  # local -Z is -X
    portal = luminaire(100 * np.pi * 4, (2, 0, 0), "rect", (2, 2), axes=facing_in)
    points = on_the_floor(8)
    by_dome, found = illuminate(build(meshes, [dome(100.0)]), points, [0, 0, 1.0])
    by_portal, _ = illuminate(build(meshes, [portal]), points, [0, 0, 1.0])
    assert by_dome.mean() == pytest.approx(by_portal.mean(), abs=4 * mean_error(found))
    off = np.sqrt(np.mean((by_dome - by_portal) ** 2))
    assert off < 1.5 * np.sqrt(np.mean(found["standard_error"].astype(float) ** 2))


def test_the_told_error_of_a_dome_past_boxes_is_the_true_one():
    table = surface(box((1.5, 1, 0.6), 0.5).moved(z=0.8), double_sided=True)
    screen = surface(rectangle((-2, 1.2, 0), (4, 0, 0), (0, 0, 2), 1.0), double_sided=True)
    floor = surface(rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0), 0.4))
    scene = build([floor, table, screen], [dome(environment(), TURNED)])
    inside = slice(*scene.mesh_ranges[0][:2])
    points, normals = scene.receiver_positions[inside], scene.vertex_normals[inside]
    truth = np.mean(
        [illuminate(scene, points, normals, seed, accuracy=1e-6)[0] for seed in range(100, 116)],
        axis=0,
    )
    runs = [illuminate(scene, points, normals, seed, accuracy=0.02) for seed in range(4)]
    true = np.sqrt(np.mean([(lit - truth) ** 2 for lit, _ in runs]))
    told = np.sqrt(np.mean([found["standard_error"] ** 2 for _, found in runs]))
    assert told == pytest.approx(true, rel=0.35), told / true


def test_light_from_afar_has_the_same_bits_on_any_number_of_threads():
    table = surface(box((1, 1, 1), 0.5).moved(z=1), 0.5, double_sided=True)
    scene = build([FLOOR, table], [dome(environment(), TURNED), distant(1000.0, 0.3)])
    lighting = _core.DirectLighting(scene, 1, 0.01)
    places = scene.receiver_positions, scene.vertex_normals, np.zeros(0, np.float32)
    one, two = (lighting.illuminate(*places, threads) for threads in (1, 2))
    for name in ("illuminance", "standard_error"):
        np.testing.assert_array_equal(one[name], two[name])
    buckets = [_core.PhotonBuckets(scene) for _ in range(2)]
    for threads, own in enumerate(buckets, start=1):
        _core.trace_photons(scene, own, 1, 0, 20_000, threads)
    np.testing.assert_array_equal(*(own.illuminance(scene) for own in buckets))
