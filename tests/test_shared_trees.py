"""Copies of triangles that share a tree: every ray meets what it meets in a tree of them all."""

from dataclasses import replace

import numpy as np
import pytest
from isolux._core import RayCaster
from usd_scenes.furnace_sphere.generate import icosphere
from usd_scenes.shapes import box, rectangle

from core_scenes import luminaire, surface
from hand_built import scene_of
from isolux import _core
from isolux.core_scene import build_core_scene
from isolux.scene_description import MeshCopy
from isolux.settings import SolverSettings

SPHERE = icosphere(2)
TRIANGLES = SPHERE.indices.reshape(-1, 3).astype(np.int32)


def placed(linear, at):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[3, :3] = linear, at
    return matrix


def turn(seed):
    return np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]


PLACES = {
    "moved": placed(np.eye(3), (3, 0, 0)),
    "turned": placed(turn(1) * np.linalg.det(turn(1)), (0, 3, 0)),
    "mirrored": placed(np.diag([-1.0, 1, 1]), (0, 0, 3)),
    "mirrored, its order kept": placed(np.diag([1.0, -1, 1]), (3, 3, 0)),
    "stretched": placed(np.diag([0.2, 1.4, 0.8]) @ turn(2), (0, 3, 3)),
    "small": placed(np.eye(3) * 0.01, (1.2, 1.2, 1.2)),
    "sheared": placed([[1, 0.5, 0], [0, 1, 0], [0, 0.3, 0.7]], (3, 0, 3)),
}


def casters(offset=0.0, opacity=None):
    """One with a tree of all triangles, one with a tree for all copies."""
    moved = placed(np.eye(3), (offset, -offset, offset))
    away = moved[3, :3]
    points, triangles, copies = [SPHERE.points + away], [TRIANGLES], []
    for i, (name, matrix) in enumerate(PLACES.items(), 1):
        at = matrix[3, :3] + away
        points.append(SPHERE.points @ matrix[:3, :3] + at)
        order = [0, 2, 1] if name == "mirrored" else [0, 1, 2]
        triangles.append(TRIANGLES[:, order] + i * len(SPHERE.points))
        world = np.linalg.inv(moved) @ matrix @ moved
        copies.append((i * len(TRIANGLES), len(TRIANGLES), 0, world))
    every = len(points)
    points.append(np.array([(9, 9, -9), (9, 9, 9), (-9, 9, 9)]) + away)  # of its own
    triangles.append(np.array([[0, 1, 2]]) + every * len(SPHERE.points))
    both = np.concatenate(points), np.concatenate(triangles).astype(np.int32), 2
    if opacity is not None:
        opacity = np.full(len(both[1]), opacity, np.float32)
    return RayCaster(*both, opacity), RayCaster(*both, opacity, copies)


def rays(count, offset=0.0):
    rng = np.random.default_rng(3)
    start = rng.uniform(-2, 5, (count, 3)) + np.array([offset, -offset, offset])
    return start, rng.normal(size=(count, 3)).astype(np.float32)


@pytest.mark.parametrize("offset", [0.0, 1e5])
def test_rays_meet_the_same_triangles_at_the_same_distances(offset):
    one_tree, shared = casters(offset)
    start, directions = rays(50_000, offset)
    triangle, barycentrics, distance = one_tree.closest_hits(start, directions)
    same_triangle, same_barycentrics, same_distance = shared.closest_hits(start, directions)
    same = triangle == same_triangle
    assert (triangle >= 0).mean() > 0.3
    met = triangle[same & (triangle >= 0)]
    assert np.unique(met // len(TRIANGLES)).tolist() == list(range(len(PLACES) + 2))
    assert same.mean() > 0.9995  # but for rays that graze an edge
    # The scene's coordinates, up to 9 m, are rounded to 1e-6 m.
    assert same_distance[same] == pytest.approx(distance[same], rel=1e-5, abs=4e-6)
    assert same_barycentrics[same] == pytest.approx(barycentrics[same], abs=2e-3)
    assert np.abs(same_barycentrics[same] - barycentrics[same]).mean() < 1e-5


def test_shadow_rays_and_see_through_copies_too():
    start, directions = rays(20_000)
    for opacity in (None, 0.4):
        one_tree, shared = casters(opacity=opacity)
        ends = start + 3.0 * directions
        passed, shared_passed = (c.transmitted(start, ends) for c in (one_tree, shared))
        assert (np.abs(passed - shared_passed) > 1e-6).mean() < 5e-4
        met, shared_met = (c.closest_hits(start, directions)[0] for c in (one_tree, shared))
        assert (met != shared_met).mean() < 5e-4


def test_a_tree_for_all_copies_takes_less():
    fine = icosphere(5)
    triangles = fine.indices.reshape(-1, 3).astype(np.int32)
    points = np.concatenate([fine.points + np.array([3 * i, 0, 0]) for i in range(10)])
    every = np.concatenate([triangles + i * len(fine.points) for i in range(10)]).astype(np.int32)
    copies = [
        (i * len(triangles), len(triangles), 0, placed(np.eye(3), (3 * i, 0, 0)))
        for i in range(1, 10)
    ]
    apart, shared = RayCaster(points, every), RayCaster(points, every, copies=copies)
    assert shared.tree_bytes < 0.15 * apart.tree_bytes


def test_triangles_that_are_no_copies_are_refused():
    points = np.concatenate([SPHERE.points, SPHERE.points + np.array([3, 0, 0.001])])
    both = np.concatenate([TRIANGLES, TRIANGLES + len(SPHERE.points)]).astype(np.int32)
    copies = [(len(TRIANGLES), len(TRIANGLES), 0, placed(np.eye(3), (3, 0, 0)))]
    with pytest.raises(ValueError, match="no copies"):
        RayCaster(points, both, copies=copies)


def test_copies_that_are_pressed_flat_keep_their_own_tree():
    flat = placed(np.diag([1.0, 1, 0]), (3, 0, 0))
    points = np.concatenate([SPHERE.points, SPHERE.points @ flat[:3, :3] + flat[3, :3]])
    both = np.concatenate([TRIANGLES, TRIANGLES + len(SPHERE.points)]).astype(np.int32)
    with pytest.raises(ValueError, match="no copies"):
        RayCaster(points, both, copies=[(len(TRIANGLES), len(TRIANGLES), 0, flat)])


def room_of_copies():
    """A room with a veil and four bowls, three of them copies of the first."""
    bowl = surface(box((0.4, 0.4, 0.4), 0.1, 0.1).moved(-0.5, -0.5, -0.7), 0.7, path="/Bowl")
    meshes = [
        surface(box((2, 2, 2), 0.25).flipped(), 0.5, path="/Room"),
        bowl,
        surface(rectangle((-1, -1, 0), (2, 0, 0), (0, 2, 0), 0.25), 0.5, opacity=0.3,
                double_sided=True, path="/Veil"),
    ]  # fmt: skip
    for name in ("mirrored", "stretched", "moved"):
        linear = {"mirrored": np.diag([-1.0, 1, 1]), "stretched": np.diag([1, -1.3, 1])}.get(
            name, np.eye(3)
        )
        matrix = placed(linear, (1, 1, 0) if name == "moved" else (0, 0, 0))
        meshes.append(
            replace(
                bowl,
                path=f"/{name}",
                points=bowl.points @ matrix[:3, :3] + matrix[3, :3],
                flip_winding=bool(np.linalg.det(matrix) < 0),
                copy_of=MeshCopy("/Bowl", matrix),
            )
        )
    lamps = (
        luminaire(1000.0, (0.1, 0.2, 0.7), size=(0.05, 0.0)),
        replace(luminaire(500.0, (0.1, 0.2, -0.3)), shadow_meshes=frozenset({"/Room", "/moved"})),
    )
    return replace(scene_of(meshes), luminaires=lamps)


def test_light_in_a_room_of_copies_is_the_same_whether_or_not_they_share_a_tree():
    """Fronts and backs, see-through and linked meshes: every photon takes the same way, but for
    rounding, and shadow rays find the same."""
    counts, direct, sizes = [], [], []
    for worth_sharing in (0, 2**62):
        scene = build_core_scene(room_of_copies(), SolverSettings(), 2, worth_sharing)
        buckets = _core.PhotonBuckets(scene)
        _core.trace_photons(scene, buckets, 1, 0, 100_000, 2)
        ends = buckets.ends
        assert ends["escaped"] + ends["back_absorbed"] <= 1e-5 * ends["rays"]
        hits = buckets.hit_counts.astype(float)
        counts.append([hits[begin:end].sum(axis=0) for begin, _, end, _ in scene.mesh_ranges])
        found = _core.DirectLighting(scene, 1, 0.01).illuminate(
            scene.receiver_positions,
            scene.vertex_normals,
            np.zeros(0, np.float32),
            2,
            scene.vertex_meshes,
        )
        direct.append(found["illuminance"][:, 0])
        sizes.append(scene.tree_bytes)
    shared, apart = np.array(counts)
    assert sizes[0] < sizes[1]
    assert (np.abs(shared - apart) <= 5 * np.sqrt(apart)).all()
    assert np.abs(shared - apart).sum() < 0.01 * apart.sum()
    assert (np.abs(direct[0] - direct[1]) > 0.02 * direct[1].mean()).mean() < 0.01
