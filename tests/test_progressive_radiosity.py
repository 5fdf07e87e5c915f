"""Hierarchical progressive radiosity as its caller meets it: begin, advance, ask for light."""

import numpy as np
import pytest
from usd_scenes.shapes import box, rectangle

from core_scenes import build, luminaire, surface
from isolux import _core

ROOM = box((4, 3, 5), 10.0).flipped()
NO_LIGHT = np.zeros(0, np.float32)


def table_in_a_room(**kwargs):
    """Fewer than 500 polygons: a room, and a table top over its floor."""
    table = surface(rectangle((-1, -0.7, 0.5), (0, 0, -1), (1.5, 0, 0), 10.0), 0.6, **kwargs)
    return build([surface(ROOM, (0.7, 0.5, 0.3)), table], [luminaire(at=(0.5, 1, 0))])


def direct_light(scene, radiosity):
    lighting = _core.DirectLighting(scene, 1, 0.01)
    return lighting.illuminate(*radiosity.receivers(), NO_LIGHT, 2)["illuminance"]


def solved(scene, seed=1, accuracy=0.05, threads=2):
    radiosity = _core.ProgressiveRadiosity(scene, seed, accuracy)
    radiosity.begin(direct_light(scene, radiosity))
    radiosity.advance(10**9, threads)
    return radiosity


def at_vertices(scene, radiosity, threads=2):
    return radiosity.indirect(scene.receiver_positions, scene.vertex_normals, threads)


def test_leaves_cover_each_side_that_reflects_with_some_thousand_points():
    one_sided, double_sided = (table_in_a_room(double_sided=side) for side in (False, True))
    count = {}
    for scene in (one_sided, double_sided):
        positions, normals = _core.ProgressiveRadiosity(scene, 1, 0.01).receivers()
        assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0, abs=1e-6)
        count[scene] = np.count_nonzero(np.abs(positions[:, 1] + 0.7) < 1e-9)
        assert 2_000 < len(positions) < 20_000
    assert count[double_sided] == pytest.approx(2 * count[one_sided], rel=0.1)


def test_shooting_is_progressive_and_ends():
    scene = table_in_a_room()
    radiosity = _core.ProgressiveRadiosity(scene, 1, 0.05)
    radiosity.begin(direct_light(scene, radiosity))
    unshot, means, finished = [1.0], [], False
    while not finished:
        progress = radiosity.advance(1, 2)
        unshot.append(progress["unshot"])
        finished = progress["finished"]
        means.append(at_vertices(scene, radiosity)["illuminance"].mean())
    assert len(means) > 3
    assert np.all(np.diff(unshot) < 0)
    assert unshot[-1] < 0.02
    # Light is added, never taken away.
    assert np.all(np.diff(means) > -1e-3 * means[-1])


def test_same_bits_on_one_and_two_threads():
    scene = table_in_a_room()
    one, two = (at_vertices(scene, solved(scene, threads=n), n) for n in (1, 2))
    assert one["rays"] == two["rays"]
    assert np.array_equal(one["illuminance"], two["illuminance"])
    assert np.array_equal(one["standard_error"], two["standard_error"])


def test_a_point_has_the_same_light_whoever_else_is_asked_for():
    scene = table_in_a_room()
    radiosity = solved(scene)
    everywhere = at_vertices(scene, radiosity)["illuminance"]
    some = slice(3, 9)
    alone = radiosity.indirect(
        scene.receiver_positions[some].copy(), scene.vertex_normals[some].copy(), 1
    )
    assert np.array_equal(alone["illuminance"], everywhere[some])


def test_black_surfaces_give_no_indirect_light():
    scene = build([surface(ROOM, 0.0)], [luminaire()])
    radiosity = _core.ProgressiveRadiosity(scene, 1, 0.05)
    radiosity.begin(direct_light(scene, radiosity))
    progress = radiosity.advance(10**9, 2)
    assert progress["finished"]
    assert progress["unshot"] == progress["shot_flux"] == progress["rays"] == 0
    assert not at_vertices(scene, radiosity)["illuminance"].any()


def test_beginning_again_forgets():
    scene = table_in_a_room()
    radiosity = solved(scene)
    first = at_vertices(scene, radiosity)["illuminance"]
    direct = direct_light(scene, radiosity)
    radiosity.begin(np.zeros_like(direct))
    assert not at_vertices(scene, radiosity)["illuminance"].any()
    radiosity.begin(direct)
    radiosity.advance(10**9, 2)
    assert np.array_equal(at_vertices(scene, radiosity)["illuminance"], first)


def test_arrays_of_the_wrong_length_are_refused():
    scene = table_in_a_room()
    radiosity = _core.ProgressiveRadiosity(scene, 1, 0.05)
    with pytest.raises(ValueError, match="one row a receiver"):
        radiosity.begin(np.zeros((3, 3), np.float32))
    with pytest.raises(ValueError, match="differ in length"):
        radiosity.indirect(np.zeros((3, 3)), np.zeros((2, 3), np.float32), 1)
