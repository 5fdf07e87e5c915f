"""Hard shadows by direct lighting on the adaptive mesh, against plain geometry."""

from __future__ import annotations

import numpy as np
import pytest
from usd_scenes.shapes import rectangle

from core_scenes import Array, build, luminaire, surface
from isolux import _core
from validation.rows import DIRECT

pytestmark = pytest.mark.validation(DIRECT)

LAMP_HEIGHT, SCREEN_HEIGHT = 3.0, 1.5  # m
CANDELA = 1000.0
TURN = np.radians(20.0)  # of the screen's edge against the floor's grid
ALONG = np.array([np.cos(TURN), np.sin(TURN), 0.0])
ACROSS = np.array([-np.sin(TURN), np.cos(TURN), 0.0])
OFFSET = 0.05  # m, of the screen's edge from below the lamp


def floor_under_a_screen(step: float) -> _core.Scene:
    """A floor under a small lamp, beside it a screen whose edge casts a straight shadow border."""
    floor = surface(rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0), step), 0.5)
    corner = OFFSET * ACROSS - 4 * ALONG + [0, 0, SCREEN_HEIGHT]
    screen = surface(rectangle(corner, 8 * ALONG, 4 * ACROSS, 4.0))
    gamma = np.radians(np.arange(0.0, 181.0))
    diagram = _core.CandelaDistribution(gamma, np.zeros(1), np.full((1, 181), CANDELA))
    lamp = luminaire(4 * np.pi * CANDELA, (0, 0, LAMP_HEIGHT), size=(1e-5, 0.0))
    return build([floor, screen], [lamp], diagram)


def illuminance(points: Array) -> Array:
    """(n,) lx on the floor: I cosθ / d², none behind the border."""
    squared = (points[:, :2] ** 2).sum(axis=1) + LAMP_HEIGHT**2
    at_screen = points * (LAMP_HEIGHT - SCREEN_HEIGHT) / LAMP_HEIGHT
    return np.where(at_screen @ ACROSS > OFFSET, 0.0, CANDELA * LAMP_HEIGHT / squared**1.5)


def refine(scene: _core.Scene, iterations: int, threads: int = 2) -> list[dict]:
    """The meshes before and after each iteration."""
    lighting = _core.DirectLighting(scene, 1, 0.01)
    none = np.zeros(0, np.float32)
    lit = lighting.illuminate(scene.receiver_positions, scene.vertex_normals, none, threads)
    refinement = _core.MeshRefinement(scene)
    direct, error = lit["illuminance"], lit["standard_error"]
    no_indirect, none3 = np.zeros_like(direct), np.zeros((0, 3), np.float32)
    refinement.begin(direct, error, no_indirect, 10.0, 0.05, none3, none)
    meshes = [refinement.mesh()]
    for _ in range(iterations):
        while len((wanted := refinement.wanted_samples())["positions"]):
            lit = lighting.illuminate(**wanted, threads=threads)
            refinement.add_samples(lit["illuminance"], lit["standard_error"])
        refinement.split()
        meshes.append(refinement.mesh())
    return meshes


def mean_error(mesh: dict, divisions: int = 8) -> tuple[float, int]:
    """Area-weighted mean absolute error on the floor, lx, and the number of its elements."""
    on_floor = (mesh["vertex_positions"][mesh["elements"]][:, :, 2] == 0).all(axis=1)
    elements = mesh["elements"][on_floor]
    corners, values = mesh["vertex_positions"][elements], mesh["direct"][:, 0][elements]
    sides = corners[:, 1:] - corners[:, :1]
    areas = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) / 2
    n = divisions
    upright = [(3 * i + 1, 3 * j + 1) for i in range(n) for j in range(n - i)]
    inverted = [(3 * i + 2, 3 * j + 2) for i in range(n - 1) for j in range(n - 1 - i)]
    error = 0.0
    for v, w in np.array(upright + inverted) / (3 * n):
        weights = np.array([1 - v - w, v, w])
        points = np.einsum("k,tkc->tc", weights, corners)
        error += areas @ np.abs(values @ weights - illuminance(points)) / n**2
    return error / areas.sum(), len(elements)


def test_the_error_of_a_shadow_border_falls_with_each_iteration() -> None:
    errors = [mean_error(mesh)[0] for mesh in refine(floor_under_a_screen(0.25), 2)]
    assert errors[1] < errors[0] / 3
    assert errors[2] < errors[1] / 2


def test_few_elements_in_the_right_places_do_better_than_many_alike() -> None:
    error, count = mean_error(refine(floor_under_a_screen(0.25), 2)[-1])
    uniform_error, uniform_count = mean_error(refine(floor_under_a_screen(0.05), 0)[0])
    assert uniform_count > 10 * count
    assert error < uniform_error


def test_light_without_shadows_wants_hardly_any_elements() -> None:
    """The floor's other half of the same lamp: steep, but smooth."""
    scene = floor_under_a_screen(0.25)
    before, after = refine(scene, 1)
    lit = before["vertex_positions"][before["elements"]].mean(axis=1) @ ACROSS < 2 * OFFSET - 0.3
    parts = np.bincount(after["element_parents"], minlength=len(lit))
    assert lit.sum() > 200
    assert parts[lit].sum() == lit.sum()


def test_illuminances_of_split_vertices_are_exact() -> None:
    mesh = refine(floor_under_a_screen(0.25), 2)[-1]
    points, values = mesh["receiver_positions"], mesh["direct"][:, 0]
    # On the border itself either side is right.
    clear = np.abs(points @ ACROSS - 2 * OFFSET) > 1e-4
    on_floor = (mesh["vertex_positions"][:, 2] == 0) & clear
    assert on_floor.sum() > 400
    assert values[on_floor] == pytest.approx(illuminance(points[on_floor]), rel=1e-3)


def test_the_bits_of_the_mesh_do_not_depend_on_threads() -> None:
    scene = floor_under_a_screen(0.5)
    for one, two in zip(refine(scene, 2, threads=1), refine(scene, 2, threads=2), strict=True):
        for name, values in one.items():
            np.testing.assert_array_equal(values, two[name], err_msg=name)
