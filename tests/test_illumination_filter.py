"""Filtered illuminance: which vertices share their photons, and which never do."""

from dataclasses import replace

import numpy as np
import pytest
from usd_scenes.shapes import box, merge, rectangle

from core_scenes import (
    luminaire,
    relative_rms,
    retrace,
    shadowed_floor,
    shadowed_floor_illuminance,
    surface,
    trace,
)
from hand_built import mesh, scene_of
from isolux.components import PhotonTracing
from isolux.core_scene import build_core_scene
from isolux.settings import SolverSettings

FLUX = 1000.0  # lm
ROOM = box((4, 4, 4), 0.25).flipped()
FLOOR = rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0), 0.1)


def values(traced, part=slice(None), **settings):
    """Photometric illuminance, direct and indirect, of the vertices of a grey scene, lx."""
    filtered = traced.filtered(**settings)
    return filtered["direct"][part, 0], filtered["indirect"][part, 0]


def test_vertices_without_a_photon_take_the_light_around_them():
    """400 photons on 1,681 vertices of a floor that is lit almost evenly."""
    lamp = luminaire(FLUX, (0, 0, 30), "rect", (4.0, 4.0))
    floor = trace([surface(FLOOR, 0.5)], [lamp], 80_000)
    direct, indirect = values(floor)
    assert (floor.hits[:, 0] == 0).mean() > 0.5
    assert (direct > 0).all()
    # Nearly all of the intensity Φ/π to the floor: E = Φ/π/h².
    noise = 1 / np.sqrt(floor.hits.sum())
    expected = np.full(len(direct), FLUX / np.pi / 900)
    assert relative_rms(direct, expected, floor.areas) < 0.2
    assert np.average(direct, weights=floor.areas) == pytest.approx(
        FLUX / np.pi / 900, rel=4 * noise
    )
    assert not indirect.any()


@pytest.mark.parametrize(("step", "divide"), [(0.25, False), (2.0, True)])
def test_a_vertex_under_a_box_shows_the_light_beside_it(step, divide):
    """Its own bucket is dark; a lamp above the middle lights what is near by far the most."""
    floor = surface(rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0), step), 0.5)
    cover = surface(box((0.2, 0.2, 0.02), 0.2).moved(z=0.005), 0.0)
    scene = replace(scene_of([floor, cover]), luminaires=(luminaire(FLUX, (0, 0, 1)),))
    core = build_core_scene(scene, SolverSettings(), 2, divide=divide)
    photons = PhotonTracing(core, SolverSettings(), 2)
    photons.trace(400_000)
    light, _ = photons.filtered()
    (covered,) = np.flatnonzero(np.abs(core.vertex_positions).max(axis=1) < 0.001)
    place = core.receiver_positions[covered]
    assert 0.1 < np.abs(place[:2]).max() < 0.15
    expected = FLUX / (4 * np.pi) / (1 + place @ place) ** 1.5
    assert light.direct[covered, 0] == pytest.approx(expected, rel=0.15)
    assert abs(light.direct[covered, 0] - expected) < 3 * light.direct_error[covered]


def test_few_photons_tell_as_much_on_a_finer_mesh():
    """The same 400 photons on 1,681 and on 25,921 vertices: supports are as wide in metres."""
    lamp = luminaire(FLUX, (0, 0, 30), "rect", (4.0, 4.0))
    radii = []
    for step in (0.1, 0.025):
        floor = trace([surface(rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0), step))], [lamp], 80_000)
        filtered = floor.filtered()
        expected = np.full(len(floor.areas), FLUX / np.pi / 900)
        error = relative_rms(filtered["direct"][:, 0].astype(float), expected, floor.areas)
        assert error < 2 / np.sqrt(floor.hits.sum())
        radii.append(np.median(filtered["direct_support_radius"]))
    assert radii[1] == pytest.approx(radii[0], rel=0.25)


def test_no_photons_at_all_are_darkness():
    """A lamp that shines away from the only surface."""
    lamp = luminaire(FLUX, (0, 0, 1), "disk", (0.2, 0.0), axes=np.diag([1.0, -1.0, -1.0]))
    traced = trace([surface(FLOOR, 0.5)], [lamp], 1000)
    filtered = traced.filtered()
    for component in ("direct", "indirect"):
        assert not filtered[component].any()
    assert (filtered["relative_deviation"] == 1).all()
    for error in ("rms_error", "bucket_rms_error", "batch_rms_error"):
        assert filtered[error] == 0


WALLS = {
    "two rooms back to back": [ROOM, ROOM.moved(x=4)],
    "a wall a hair thick": [ROOM, ROOM.moved(x=4 + 1e-4)],
    "one mesh of both rooms": [merge(ROOM, ROOM.moved(x=4.001))],
}


@pytest.mark.parametrize("rooms", WALLS.values(), ids=WALLS)
@pytest.mark.parametrize("paper", [False, True])
def test_light_never_crosses_a_wall(rooms, paper):
    """A bright room beside a dark one; their floors are coplanar and end at the wall."""
    traced = trace([surface(shape, 0.5) for shape in rooms], [luminaire(FLUX)], 200_000)
    direct, indirect = values(traced, paper=paper)
    dark = traced.scene.vertex_positions[:, 0] > 2.0
    dark |= (traced.scene.vertex_positions[:, 0] == 2.0) & (traced.hits.sum(axis=1) == 0)
    assert dark.sum() > 0.45 * len(dark)
    assert not direct[dark].any()
    assert not indirect[dark].any()
    assert (direct[~dark] > 0).all()


@pytest.mark.parametrize("double_sided", [True, False], ids=["one sheet", "two sheets"])
def test_the_sides_of_a_sheet_keep_their_own_light(double_sided):
    """Two lamps, ten to one; each lights its own half of a black room with a sheet across."""
    sheet = rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0), 0.25)
    sheets = (
        [surface(sheet, 0.3, double_sided=True)]
        if double_sided
        else [surface(sheet, 0.3), surface(sheet.flipped(), 0.3)]
    )
    lamps = [luminaire(10 * FLUX, (0, 0, 1.0)), luminaire(FLUX, (0, 0, -1.0))]
    traced = trace([*sheets, surface(ROOM)], lamps, 400_000)
    above = traced.front(0)
    below = traced.back(0) if double_sided else traced.front(1)
    direct, _ = values(traced)
    means = [np.average(direct[side], weights=traced.areas[side]) for side in (above, below)]
    assert means[0] / means[1] == pytest.approx(10, rel=0.05)
    # By the closed form, all round: E = I z / d³, and the same shape on both sides.
    x, y, _ = traced.scene.vertex_positions[below].T
    expected = FLUX / (4 * np.pi) / (x**2 + y**2 + 1) ** 1.5
    assert relative_rms(direct[below], expected, traced.areas[below]) < 0.2


def test_a_crease_parts_the_light():
    """The lit riser of a step shares no photons with its tread, which the lamp doesn't reach."""
    edge = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, -2), (0, 2, -2)]
    step = mesh("/Step", edge, [[0, 1, 2, 3], [0, 3, 5, 4]])
    lamp = luminaire(FLUX, (-5.0, 1.0, -1.0))
    traced = trace([step], [lamp], 100_000)
    direct, _ = values(traced)
    tread = traced.scene.vertex_normals[:, 2] > 0.9
    assert tread.sum() == 4
    assert not direct[tread].any()
    assert (direct[~tread] > 0).all()


def test_sharing_values_costs_little_accuracy():
    floor = shadowed_floor(16)
    truth = shadowed_floor_illuminance(floor)
    squares = []
    for seed in range(6):
        traced = retrace(floor, 40_000, seed)
        squares.append(
            [
                relative_rms(values(traced, sharing=sharing)[0], truth, traced.areas) ** 2
                for sharing in (0.0, 0.25)
            ]
        )
    exact, shared = np.sqrt(np.mean(squares, axis=0))
    assert shared == pytest.approx(exact, rel=0.1)


@pytest.mark.parametrize("paper", [False, True])
def test_filtering_lowers_the_error_of_smooth_light(paper):
    """Against the closed form I cosθ / d², far below the noise of the buckets."""
    traced = trace([surface(FLOOR, 0.5)], [luminaire(FLUX, (0, 0, 3))], 40_000)
    x, y, _ = traced.scene.vertex_positions.T
    expected = FLUX / (4 * np.pi) * 3 / (x**2 + y**2 + 9) ** 1.5
    direct, _ = values(traced, paper=paper)
    error = relative_rms(direct, expected, traced.areas)
    bucket_error = relative_rms(traced.illuminance[:, 0], expected, traced.areas)
    assert error < 0.4 * bucket_error


def test_the_wanted_accuracy_stops_supports():
    """At 20 % a support needs 25 photons, at 5 % 400: radii differ by 4 where light is even."""
    lamp = luminaire(FLUX, (0, 0, 30), "rect", (4.0, 4.0))
    floor = trace([surface(FLOOR, 0.5)], [lamp], 4_000_000)
    inner = (np.abs(floor.scene.vertex_positions[:, :2]) < 1.0).all(axis=1)
    radii = [
        floor.filtered(accuracy, 0.0)["direct_support_radius"][inner].mean()
        for accuracy in (0.2, 0.05)
    ]
    assert radii[1] / radii[0] == pytest.approx(4, rel=0.35)


DEGENERATE = {
    "a face without area": ([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0, 0), (3, 0, 0)],
                            [[0, 1, 2, 3], [1, 4, 5]]),
    "a repeated index": ([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [[0, 1, 2, 3], [2, 2, 3]]),
    "a needle of a million to one": ([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (1e6, 1e-6, 0)],
                                     [[0, 1, 2, 3], [1, 4, 2]]),
    "a point that no face uses": ([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (9, 9, 9)],
                                  [[0, 1, 2, 3]]),
    "all vertices in one place but three": ([(0, 0, 0), (1, 0, 0), (0, 1, 0), *[(0, 0, 0)] * 60],
                                            [[0, 1, 2], *[[0, i, i + 1] for i in range(3, 61)]]),
    "three faces at an edge": ([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1)],
                               [[0, 1, 2], [0, 3, 1], [0, 1, 4]]),
}  # fmt: skip


@pytest.mark.parametrize(("points", "faces"), DEGENERATE.values(), ids=DEGENERATE)
@pytest.mark.parametrize("double_sided", [False, True])
def test_degenerate_meshes_have_finite_values(points, faces, double_sided):
    description = mesh("/Mesh", points, faces, double_sided=double_sided)
    traced = trace([description], [luminaire(FLUX, (0.4, 0.4, 1.0))], 5000)
    filtered = traced.filtered()
    for name, value in filtered.items():
        assert np.isfinite(value).all(), name
    assert filtered["direct"].max() > 0


def test_a_vertex_without_area_takes_the_value_of_its_neighbours():
    """Its only face has no area, but it lies on the same floor."""
    points = [*map(tuple, FLOOR.points), (0.05, 0.05, 0.0), (0.05, 0.15, 0.0), (0.05, 0.1, 0.0)]
    count = len(FLOOR.points)
    faces = [list(quad) for quad in FLOOR.indices.reshape(-1, 4)]
    description = mesh("/Floor", points, [*faces, [count, count + 1, count + 2]])
    lamp = luminaire(FLUX, (0, 0, 10), "disk", (1.0, 0.0))
    traced = trace([description], [lamp], 1_000_000)
    direct, _ = values(traced)
    without_area = traced.areas == 0
    assert without_area.sum() == 3
    # Configuration factor r² / (r² + h²) of a coaxial disk; the nearest bucket has some 30 photons.
    expected = FLUX / np.pi / 101
    assert direct[without_area] == pytest.approx(np.full(3, expected), rel=4 / np.sqrt(30))


def test_zero_or_one_photon_is_no_certainty():
    """A count of 0 or 1 has no deviation of 0."""
    room = trace([surface(ROOM, 0.5)], [luminaire(FLUX)], 30)
    filtered = room.filtered()
    assert (filtered["relative_deviation"] > 0.05).all()
    assert np.isfinite(filtered["rms_error"])


def test_light_inside_a_double_sided_room_stays_off_its_outside():
    room = replace(surface(ROOM, 0.5), double_sided=True)
    traced = trace([room], [luminaire(FLUX)], 50_000)
    direct, indirect = values(traced, traced.back())
    assert not direct.any()
    assert not indirect.any()
