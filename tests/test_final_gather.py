"""The final gather as a component: what it is given, what it hands back."""

import numpy as np
import pytest
from usd_scenes.furnace_sphere.generate import icosphere
from usd_scenes.shapes import box, rectangle

from core_scenes import build, luminaire, retrace, surface, trace
from isolux import _core

GREY = 0.5


def room(step=0.4):
    """A room of 4 x 4 x 3 m with a box in it and a lamp; 0.4 m: some 1,000 vertices."""
    walls = surface(box((4, 4, 3), step).flipped().moved(z=1.5), GREY)
    block = surface(box((1, 1, 1), step / 2).moved(z=0.5), (0.7, 0.4, 0.2))
    return [walls, block]


@pytest.fixture(scope="module")
def traced():
    return trace(room(), [luminaire(10_000.0, (1, 1, 2.5))], 50_000)


def cache_of(traced):
    return np.ascontiguousarray(traced.buckets.illuminance(traced.scene).sum(axis=1))


def indirect_buckets(traced):
    return np.ascontiguousarray(traced.buckets.illuminance(traced.scene)[:, 1])


def test_buckets_tell_the_illuminance_of_their_hits(traced):
    illuminance = traced.buckets.illuminance(traced.scene).astype(float)
    assert illuminance @ [0.2126, 0.7152, 0.0722] == pytest.approx(traced.illuminance, rel=1e-5)


def test_one_and_two_threads_give_the_same_bits(traced):
    outcomes = []
    for threads in (1, 2):
        gather = _core.FinalGather(traced.scene, 3)
        found = [
            gather.advance(
                cache_of(traced), budget, threads, indirect_buckets(traced), traced.photon_flux
            )
            for budget in (5_000, 20_000)
        ]
        outcomes.append([np.asarray(value).tobytes() for one in found for value in one.values()])
    assert outcomes[0] == outcomes[1]


def test_the_budget_is_spent_and_kept(traced):
    gather = _core.FinalGather(traced.scene, 3)
    for budget in (6_400, 12_800, 200_000):
        rays = gather.advance(cache_of(traced), budget, 2)["rays"]
        # What is left over when a sixteenth is left starts no round of its own.
        assert budget * 15 / 16 <= rays < 1.1 * budget


def test_rays_are_kept_for_the_next_light(traced):
    """Without a further ray, other photons' light is looked up where the first rays hit."""
    gather = _core.FinalGather(traced.scene, 3)
    first = gather.advance(cache_of(traced), 20_000, 2)
    dark = gather.advance(np.zeros_like(cache_of(traced)), 0, 2)
    again = gather.advance(cache_of(traced), 0, 2)
    assert dark["rays"] == again["rays"] == 0
    assert dark["indirect"].mean() < 0.2 * first["indirect"].mean()  # near hits alone
    assert again["indirect"].tobytes() == first["indirect"].tobytes()


def test_degenerate_vertices_are_left_dark():
    floor = surface(rectangle((-1, -1, 0), (2, 0, 0), (0, 2, 0), 0.5), GREY)
    corners = floor.face_vertex_indices.copy()
    corners[1] = corners[0]  # a quad becomes a triangle, and one point is in no face
    floor.face_vertex_indices[:] = corners
    sky = surface(rectangle((-1, -1, 1), (0, 2, 0), (2, 0, 0), 0.5), GREY)
    traced = trace([floor, sky], [luminaire(at=(0, 0, 0.5))], 10_000)
    found = _core.FinalGather(traced.scene, 1).advance(cache_of(traced), 20_000, 2)
    degenerate = ~traced.scene.vertex_normals.any(axis=1)
    assert (found["indirect"][degenerate] == 0).all()
    assert np.isfinite(found["indirect"]).all()


def test_wrong_lengths_are_refused(traced):
    gather = _core.FinalGather(traced.scene, 3)
    with pytest.raises(ValueError, match="one row a vertex"):
        gather.advance(np.zeros((3, 3), np.float32), 1000, 2)
    with pytest.raises(ValueError, match="one row a vertex"):
        gather.advance(cache_of(traced), 1000, 2, np.zeros((3, 3), np.float32), 1.0)


def test_a_scene_without_a_usable_vertex_has_no_light():
    needle = surface(rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0), 1.0), GREY)
    needle.points[:] = 0.0
    sphere = surface(icosphere(0), GREY)
    scene = build([needle, sphere], [luminaire(at=(0, 0, 3))])
    found = _core.FinalGather(scene, 1).advance(
        np.zeros((scene.vertex_count, 3), np.float32), 1000, 2
    )
    assert not found["indirect"].any()


def test_other_photons_change_the_light_within_its_error(traced):
    results = []
    for seed in (1, 2):
        other = retrace(traced, 50_000, seed)
        gather = _core.FinalGather(traced.scene, seed)
        results.append(gather.advance(cache_of(other), 40_000, 2))
    a, b = (r["indirect"] @ [0.2126, 0.7152, 0.0722] for r in results)
    rms = np.sqrt(np.average((a - b) ** 2, weights=traced.areas))
    assert rms < 1.5 * np.hypot(results[0]["indirect_rms"], results[1]["indirect_rms"])
