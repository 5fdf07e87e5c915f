"""Where photons end: each that is emitted is absorbed or escapes, in exact counts."""

import numpy as np
import pytest
from usd_scenes.furnace_sphere.generate import icosphere
from usd_scenes.shapes import box, lathe, merge, rectangle

from core_scenes import luminaire, surface, trace
from validation.rows import INVARIANCE

PHOTONS = 50_000
FLUX = 1000.0  # lm
ROOM = box((4, 4, 4), 0.5).flipped()
FLOOR = rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0), 0.5)
SHADE = lathe([(0.3, -0.2), (0.2, 0.2)], 0.1)  # open at both ends


def ends(meshes, *luminaires, photons=PHOTONS):
    traced = trace(meshes, luminaires, photons)
    return traced, traced.buckets.ends


SCENES = {
    "closed room": [surface(ROOM, 0.7)],
    "floor in the open": [surface(FLOOR.moved(z=-1), 0.7)],
    "room inside out": [surface(ROOM.flipped(), 0.7)],
    "both sides of a shade": [surface(ROOM, 0.5), surface(SHADE, 0.8, double_sided=True)],
    "one side of a shade": [surface(FLOOR.moved(z=-1), 0.5), surface(SHADE, 0.8)],
    "closed fixture in a room": [surface(ROOM, 0.5), surface(icosphere(2), 0.3, double_sided=True)],
    "coloured": [surface(ROOM, (0.9, 0.5, 0.0)), surface(SHADE, (0, 0, 1), double_sided=True)],
}


@pytest.mark.validation(INVARIANCE)
@pytest.mark.parametrize("name", SCENES)
def test_emitted_is_absorbed_or_escaped(validation, name):
    traced, count = ends(SCENES[name], luminaire(FLUX))
    assert count["emitted"] == PHOTONS
    ended = count["absorbed"] + count["back_absorbed"] + count["escaped"]
    case = f"emitted = absorbed + escaped: {name}"
    validation.check(case, PHOTONS, ended, absolute=0, unit="photons")
    # Each ray ends at a front, at a back or nowhere.
    met = traced.hits.sum() + count["back_absorbed"] + count["escaped"]
    validation.check(f"rays = hits + escaped: {name}", count["rays"], met, absolute=0, unit="rays")
    assert sum(count["back_hits"]) == count["back_absorbed"]
    assert traced.hits[:, 0].sum() <= PHOTONS


@pytest.mark.validation(INVARIANCE)
def test_nothing_escapes_from_a_closed_room():
    traced, count = ends([surface(ROOM, 0.9)], luminaire(FLUX), photons=100_000)
    assert count["escaped"] == count["back_absorbed"] == 0
    assert traced.hits[:, 0].sum() == 100_000


@pytest.mark.validation(INVARIANCE)
def test_a_t_junction_does_not_leak():
    """Walls of large quads against a floor of small ones: edges meet without sharing points."""
    fine = rectangle((-2, -2, -2), (4, 0, 0), (0, 4, 0), 0.3)
    walls = merge(
        *(
            rectangle((2, 2, -2), (0, -4, 0), (0, 0, 4), step).turned(z=90 * turn)
            for turn, step in enumerate((4.0, 1.7, 0.9, 2.3))
        )
    )
    ceiling = rectangle((-2, 2, 2), (4, 0, 0), (0, -4, 0), 1.1)
    _, count = ends([surface(s, 0.9) for s in (fine, walls, ceiling)], luminaire(FLUX))
    assert count["escaped"] + count["back_absorbed"] <= 1e-5 * count["rays"]


def test_an_open_scene_counts_what_escapes():
    """Over an infinite floor half of an isotropic source's photons escape; here the solid angle
    of a square of side 2a at a height a is a sixth of the sphere."""
    floor = rectangle((-1, -1, -1), (2, 0, 0), (0, 2, 0), 0.5)
    traced, count = ends([surface(floor)], luminaire(FLUX))
    sigma = np.sqrt(PHOTONS * 1 / 6 * 5 / 6)
    assert traced.hits.sum() == pytest.approx(PHOTONS / 6, abs=4 * sigma)
    assert count["escaped"] == PHOTONS - traced.hits.sum()


def test_a_room_inside_out_absorbs_all_at_its_back():
    traced, count = ends(
        [surface(FLOOR.moved(z=-9), 0.5), surface(ROOM.flipped(), 0.9)], luminaire()
    )
    assert count["back_absorbed"] == PHOTONS
    assert list(count["back_hits"]) == [0, PHOTONS]
    assert not traced.hits.any()


def test_double_sided_it_shines_inside_out_as_well():
    reflectance = 0.5
    mesh = surface(ROOM.flipped(), reflectance, double_sided=True)
    traced, count = ends([mesh], luminaire(FLUX))
    assert count["back_absorbed"] == count["escaped"] == 0
    assert not traced.hits[traced.front()].any()
    back = traced.hits[traced.back()].sum() * traced.photon_flux / traced.areas[traced.back()].sum()
    assert back == pytest.approx(
        FLUX / (96 * (1 - reflectance)), rel=4 * np.sqrt(reflectance / PHOTONS)
    )


def test_flipped_winding_turns_a_room_right_side_in():
    traced, count = ends([surface(ROOM.flipped(), 0.5, flip_winding=True)], luminaire())
    assert count["back_absorbed"] == 0
    assert traced.hits[:, 0].sum() == PHOTONS


@pytest.mark.parametrize("reflectance", [0.0, 0.8])
def test_a_source_in_a_closed_fixture_lights_its_inside_alone(reflectance):
    fixture = surface(icosphere(2).flipped(), reflectance)
    traced, count = ends([surface(ROOM, 0.5), fixture], luminaire(FLUX))
    assert count["absorbed"] == PHOTONS
    assert not traced.hits[traced.front(0)].any()
    assert traced.hits[traced.front(1), 0].sum() == PHOTONS


@pytest.mark.validation(INVARIANCE)
@pytest.mark.parametrize("light", ["direct", "indirect"])
def test_coplanar_duplicates_do_not_double_the_flux(light):
    """Two floors in one place: together they have the light of one."""
    meshes = [surface(ROOM, 0.5), surface(FLOOR.moved(z=-1.0), 0.5)]
    column = ("direct", "indirect").index(light)
    once, _ = ends(meshes, luminaire(FLUX))
    twice, count = ends([*meshes, meshes[1]], luminaire(FLUX))
    on_floors = [t.hits[traced_floor, column].sum() for t, traced_floor in (
        (once, once.front(1)), (twice, slice(twice.front(1).start, twice.front(2).stop)),
    )]  # fmt: skip
    assert count["escaped"] == 0
    assert on_floors[1] == pytest.approx(on_floors[0], abs=4 * np.sqrt(2 * on_floors[0]))


@pytest.mark.validation(INVARIANCE)
@pytest.mark.parametrize("gap", [0.0, 1e-6])
def test_a_light_that_touches_a_wall_loses_no_flux(gap):
    """A square lamp in the plane of the ceiling, and one a millionth of a metre below."""
    lamp = luminaire(FLUX, (0.3, 0.4, 2.0 - gap), "rect", (1.0, 1.0))
    traced, count = ends([surface(ROOM)], lamp)
    assert count["absorbed"] == traced.hits[:, 0].sum() == PHOTONS
    on_ceiling = (traced.scene.vertex_positions[:, 2] == 2) & (
        traced.scene.vertex_normals[:, 2] == -1
    )
    assert on_ceiling.any()
    assert not traced.hits[on_ceiling].any()


def test_a_receiver_in_the_plane_of_the_light_is_dark():
    table = rectangle((1.0, -0.5, 0.0), (1, 0, 0), (0, 1, 0), 0.25)
    lamp = luminaire(FLUX, (0, 0, 0), "rect", (1.0, 1.0))
    traced, _ = ends([surface(table, double_sided=True)], lamp)
    assert not traced.hits.any()
    filtered = traced.filtered()
    for component in ("direct", "indirect"):
        assert not filtered[component].any()
    assert filtered["rms_error"] == 0
