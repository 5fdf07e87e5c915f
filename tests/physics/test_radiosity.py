"""Indirect light by radiosity against what is known of closed rooms, and against photons.

In a closed room of one reflectance ρ the mean indirect illuminance is ρ E / (1 - ρ) for a mean
direct illuminance E, whatever the room's form: CIE 171:2006, case 5.8, tabulates it.
"""

from dataclasses import replace

import numpy as np
import pytest
from reference import INDIRECT, path_traced_reference
from usd_scenes.box_room.generate import LUMINOUS_FLUX, SIZE
from usd_scenes.furnace_sphere.generate import icosphere
from usd_scenes.shapes import Shape, box, rectangle

from core_scenes import bucket_flux, build, luminaire, relative_rms, surface, trace
from hand_built import scene_of
from isolux import _core
from isolux.core_scene import build_core_scene
from isolux.settings import SolverSettings
from isolux.solution import LUMINANCE_WEIGHTS
from validation.rows import CIE_171, GLOBAL

pytestmark = pytest.mark.validation(GLOBAL)

NO_LIGHT = np.zeros(0, np.float32)
ACCURACY = 0.02
# Boxes of six quads: the leaves of the solver are all the mesh there is.
WALLS = box((SIZE, SIZE, SIZE), SIZE).flipped()
BLOCKS = (
    box((1, 1.5, 1), 10.0).turned(y=20).moved(-0.6, -1.0, 0.4),
    box((1, 0.8, 1), 10.0).turned(y=-30).moved(0.8, -1.2, -0.4),
)


def begun(scene, direct=None, accuracy=ACCURACY):
    """Radiosity before its first shot; direct : lx, everywhere alike, or as the luminaires give."""
    radiosity = _core.ProgressiveRadiosity(scene, 1, accuracy)
    positions, normals = radiosity.receivers()
    if direct is None:
        lighting = _core.DirectLighting(scene, 1, 0.01)
        light = lighting.illuminate(positions, normals, NO_LIGHT, 2)["illuminance"]
    else:
        light = np.full((len(positions), 3), direct, np.float32)
    radiosity.begin(light)
    return radiosity


def solved(scene, direct=None, accuracy=ACCURACY):
    radiosity = begun(scene, direct, accuracy)
    radiosity.advance(10**10, 2)
    return radiosity


def at_vertices(scene, radiosity):
    """(V,) photometric indirect illuminance, lx."""
    found = radiosity.indirect(scene.receiver_positions, scene.vertex_normals, 2)
    return found["illuminance"] @ LUMINANCE_WEIGHTS


@pytest.mark.parametrize("blocks", [(), BLOCKS], ids=["empty", "with blocks"])
def test_a_furnace_gives_each_point_the_light_of_all_its_walls(validation, blocks):
    """Exitance alike everywhere: the form factors of what a point sees sum to 1."""
    reflectance = 0.5
    scene = build([surface(s, reflectance) for s in (WALLS, *blocks)], [luminaire()])
    radiosity = begun(scene, direct=100.0)
    found = radiosity.indirect(scene.receiver_positions, scene.vertex_normals, 2)
    illuminance = found["illuminance"][:, 0] / (100.0 * reflectance)
    # Without anything in the way form factors are exact and the rays agree.
    room = "a room with blocks" if blocks else "an empty room"
    validation.check(
        f"furnace, {room}, sum of form factors at each point, ddl+hpr",
        *(1.0, illuminance),
        relative=4 * ACCURACY if blocks else 1e-4,
        unit="",
    )


@pytest.mark.parametrize(
    "blocks",
    [
        pytest.param(
            (),
            marks=pytest.mark.xfail(
                strict=True,
                raises=AssertionError,
                reason="0.5 % is asked of a furnace without noise; radiosity, at 2 %, "
                "is 0.51 % too bright at the worst vertex",
            ),
        ),
        BLOCKS,
    ],
    ids=["empty", "with blocks"],
)
def test_a_furnace_gives_each_point_the_light_of_all_bounces(validation, blocks):
    reflectance = 0.5
    scene = build([surface(s, reflectance) for s in (WALLS, *blocks)], [luminaire()])
    radiosity = begun(scene, direct=100.0)
    room = "a room with blocks" if blocks else "an empty room"
    radiosity.advance(10**10, 2)
    everywhere = at_vertices(scene, radiosity) / (100.0 * reflectance / (1 - reflectance))
    validation.check(
        f"furnace, {room}, indirect light of all bounces at each point, ddl+hpr",
        *(1.0, everywhere),
        relative=4 * ACCURACY if blocks else 0.005,
        unit="",
    )


def test_a_closed_sphere_is_lit_alike(validation):
    sphere = icosphere(1).flipped()
    reflectance, flux = 0.8, 1000.0
    scene = build([surface(sphere, reflectance)], [luminaire(flux)])
    illuminance = at_vertices(scene, solved(scene))
    expected = reflectance * flux / (sphere.area() * (1 - reflectance))
    found = np.average(illuminance, weights=scene.vertex_areas)
    case = "sphere, mean indirect light, ddl+hpr"
    validation.check(case, expected, found, relative=ACCURACY)
    case = "sphere, indirect light, ddl+hpr"
    validation.check(case, expected, illuminance, relative=2 * ACCURACY)


@pytest.mark.validation(CIE_171)
@pytest.mark.parametrize("reflectance", [0.05, *np.arange(1, 10) / 10, 0.95])
def test_mean_indirect_light_in_the_cube_of_cie_171_case_5_8(validation, reflectance):
    scene = build([surface(WALLS, reflectance)], [luminaire(LUMINOUS_FLUX)])
    radiosity = solved(scene)
    # Leaves of a cube of six quads are of one area.
    positions, normals = radiosity.receivers()
    mean = radiosity.indirect(positions, normals, 2)["illuminance"][:, 0].mean()
    expected = reflectance * LUMINOUS_FLUX / (6 * SIZE**2 * (1 - reflectance))
    along = dict(relative=0.005, at=[reflectance], axis="reflectance")
    validation.check("5.8 mean indirect light, ddl+hpr", expected, mean, **along)


def test_between_wide_plates_light_comes_from_the_other_plate_alone(validation):
    """E1 = M ρ2 / (1 - ρ1 ρ2), E2 = M / (1 - ρ1 ρ2) for a plate 1 of exitance M that faces 2."""
    reflectances = np.array([0.8, 0.3])
    width, gap = 100.0, 1.0
    corner = -width / 2
    down = rectangle((corner, gap, corner), (width, 0, 0), (0, 0, width), width)
    up = rectangle((corner, 0, corner), (0, 0, width), (width, 0, 0), width)
    plates = [surface(s, r) for s, r in zip((down, up), reflectances, strict=True)]
    # Far above, where the upper plate's back is: nothing but the leaves' own light counts.
    scene = build(plates, [luminaire(at=(0, 50, 0))])
    radiosity = _core.ProgressiveRadiosity(scene, 1, ACCURACY)
    _, normals = radiosity.receivers()
    emitting = normals[:, 1] < 0
    radiosity.begin(np.outer(emitting * 100.0 / reflectances[0], np.ones(3)).astype(np.float32))
    radiosity.advance(10**10, 2)
    middle = np.array([(0.3, gap, 0.2), (0.3, 0.0, 0.2)])
    found = radiosity.indirect(middle, np.array([(0, -1, 0), (0, 1, 0)], np.float32), 2)
    expected = 100.0 / (1 - reflectances.prod()) * np.array([reflectances[1], 1.0])
    # A plate of half width w at a distance h fills all but about (h / w)² of the hemisphere.
    found = found["illuminance"][:, 0]
    case = "wide plates of ρ (0.8, 0.3), light on each, ddl+hpr"
    validation.check(case, expected, found, relative=ACCURACY)


def test_the_foot_of_a_block_takes_half_of_the_light_of_its_floor():
    """The form factor from the foot of a wall to a wide floor is 1/2."""
    turn = np.radians(20.0)
    across = np.array([(np.cos(turn), -np.sin(turn)), (np.sin(turn), np.cos(turn))])  # in x, z
    floor = surface(rectangle((-2, 0, -2), (0, 0, 4), (4, 0, 0), 4.0), 0.5)
    block = surface(box((1, 1, 1), 1.0).turned(y=20).moved(y=0.5), 0.0)
    scene = build([floor, block], [luminaire(at=(0, 3, 0))])
    radiosity = _core.ProgressiveRadiosity(scene, 1, ACCURACY)
    positions, _ = radiosity.receivers()
    covered = (np.abs(positions[:, [0, 2]] @ across.T) < 0.5).all(axis=1)
    radiosity.begin(np.outer((positions[:, 1] == 0) & ~covered, np.full(3, 100.0, np.float32)))
    along = np.linspace(-0.45, 0.45, 19)
    for side in (across[0], across[1], -across[0], -across[1]):
        x, z = (0.5 * side[:, None] + along * np.array([[-side[1]], [side[0]]])).reshape(2, -1)
        points = np.stack([x, np.full_like(x, 1e-3), z], axis=1)
        normals = np.tile(np.array([side[0], 0, side[1]], np.float32), (len(x), 1))
        found = radiosity.indirect(points, normals, 2)["illuminance"][:, 0]
        assert found.mean() == pytest.approx(0.5 * 50.0, rel=0.03)


def test_flux_that_is_shot_is_received_or_lost():
    """A room with one wall missing: what is not received leaves by the opening."""
    closed = box((4, 3, 5), 10.0).flipped()
    room = surface(Shape(closed.points, closed.counts[1:], closed.indices[4:]), (0.7, 0.6, 0.4))
    scene = build([room], [luminaire(at=(0.5, 0.5, 0.5))])
    progress = begun(scene).advance(10**10, 2)
    assert progress["finished"]
    assert 0.02 < progress["lost_flux"] / progress["shot_flux"] < 0.3
    balance = progress["received_flux"] + progress["lost_flux"]
    assert balance == pytest.approx(progress["shot_flux"], rel=ACCURACY)
    # Photons of the same room lose as much.
    traced = trace([room], [luminaire(at=(0.5, 0.5, 0.5))], 400_000)
    indirect_flux = traced.hits[:, 1].sum() * traced.photon_flux
    assert progress["shot_flux"] - progress["lost_flux"] == pytest.approx(indirect_flux, rel=0.01)


def test_light_of_a_furnished_room_is_that_of_photons():
    lamp = luminaire(10_000.0, (0.5, 1.2, 0.3), size=(0.1, 0.0))
    colours = (0.75, 0.5, 0.3)
    coarse, fine = (
        [surface(s, colours) for s in (walls, *BLOCKS)]
        for walls in (WALLS, box((SIZE, SIZE, SIZE), 1.0).flipped())
    )
    traced = trace(fine, [lamp], 1_000_000)
    radiosity = solved(build(coarse, [lamp]))

    def illuminance(points, normals):
        found = radiosity.indirect(points, normals.astype(np.float32), 2)
        return found["illuminance"] @ LUMINANCE_WEIGHTS

    walls = traced.front(0)
    areas = traced.areas[walls]
    means = bucket_flux(traced, illuminance, divisions=4) / areas
    truth = traced.illuminance[walls, 1]
    variance = np.average(truth * traced.photon_flux / areas, weights=areas)  # of the photons
    noise = np.sqrt(variance) / np.average(truth, weights=areas)
    assert relative_rms(means, truth, areas) < np.hypot(0.01, noise)
    sigma = 1 / np.sqrt(traced.hits[:, 1].sum())
    assert np.average(means, weights=areas) == pytest.approx(
        np.average(truth, weights=areas), rel=ACCURACY / 2 + 3 * sigma
    )


def test_the_reported_error_is_the_true_one():
    """Against the same room solved four times as closely."""
    scene = build([surface(s, 0.6) for s in (WALLS, *BLOCKS)], [luminaire(at=(0.5, 1.2, 0.3))])
    rough, close = (solved(scene, accuracy=a) for a in (0.04, 0.01))
    positions, normals = (x[::11].copy() for x in rough.receivers())
    found = rough.indirect(positions, normals, 2)
    truth = close.indirect(positions, normals, 2)["illuminance"][:, 0]
    true = np.sqrt(np.mean((found["illuminance"][:, 0] - truth) ** 2))
    reported = np.sqrt(np.mean(found["standard_error"].astype(float) ** 2))
    assert 0.5 < reported / true < 2.0


def test_the_reported_error_knows_the_corners_of_a_room():
    """All vertices of an empty room are corners, which see the dimmest part of the leaves there."""
    description = replace(
        scene_of([surface(WALLS, 0.6)]), luminaires=(luminaire(at=(0.3, 0.5, 0.1)),)
    )
    scene = build_core_scene(description, SolverSettings(), 2, divide=False)
    found = solved(scene, accuracy=0.01).indirect(scene.receiver_positions, scene.vertex_normals, 2)
    reference = path_traced_reference(description, scene, vertices=24, batches=8, strata=12)
    true = reference.error(np.zeros_like(found["illuminance"]), found["illuminance"], INDIRECT)
    told = np.sqrt(np.mean(found["standard_error"].astype(float) ** 2))
    told /= reference.mean(INDIRECT)
    assert 0.6 < told / true.rms < 1.5
