"""The adaptive mesh: fine at borders of light, conforming, the same whatever came before."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import numpy as np
import pytest
from usd_scenes.furnace_sphere.generate import icosphere
from usd_scenes.shapes import Shape, box, rectangle

from core_scenes import Array, build, luminaire, surface
from isolux import _core
from isolux.scene_description import MeshDescription
from isolux.solution import RefinedMesh

Light = Callable[[Array, Array], Array]

ADAPTATION = 20.0  # cd/m², of an observer in a room of some 100 lx
FLOOR = rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0), 0.5)
REFINED_MESH_ARRAYS = (
    "split_parents",
    "split_fraction",
    "split_twin",
    "split_point",
    "elements",
    "element_parents",
    "barycentrics",
)


def half_plane(positions: Array, normals: Array) -> Array:
    """Hard shadow beyond a line that runs askew through the floor."""
    return np.where(positions[:, 0] * 0.94 + positions[:, 1] * 0.34 < 0.13, 100.0, 0.0)


def band(positions: Array, normals: Array) -> Array:
    """Shadow of a pole of 0.3 m."""
    return np.where(np.abs(positions[:, 0] * 0.6 + positions[:, 1] * 0.8) < 0.15, 0.0, 100.0)


def gradient(positions: Array, normals: Array) -> Array:
    """From dark to bright over 4 m, without a bend."""
    return 100.0 + 40.0 * positions[:, 0]


class Run:
    """Refines a scene under a known light."""

    def __init__(self, meshes: list[MeshDescription], light: Light) -> None:
        self.scene = build(meshes, [luminaire(at=(0, 0, 9))])
        self.light = light
        self.refinement = _core.MeshRefinement(self.scene)
        self.samples = 0

    def _direct(self, positions: Array, normals: Array) -> Array:
        illuminance = self.light(positions, normals)
        return np.repeat(illuminance[:, None], 3, axis=1).astype(np.float32)

    def begin(self, threshold: float, indirect: float = 0.0, regional: Array | None = None) -> Run:
        count = self.scene.vertex_count
        self.refinement.begin(
            self._direct(self.scene.receiver_positions, self.scene.vertex_normals),
            np.zeros(count, np.float32),
            np.full((count, 3), indirect, np.float32),
            ADAPTATION,
            threshold,
            np.zeros((0, 3), np.float32) if regional is None else regional,
            np.zeros(0 if regional is None else count, np.float32),
        )
        return self

    def iterate(self, count: int = 1) -> dict:
        for _ in range(count):
            while len((wanted := self.refinement.wanted_samples())["positions"]):
                n = len(wanted["positions"])
                self.samples += n
                direct = self._direct(wanted["positions"], wanted["normals"])
                self.refinement.add_samples(direct, np.zeros(n, np.float32))
            self.refinement.split()
        return self.refinement.mesh()

    def refined(self, mesh: dict) -> RefinedMesh:
        return RefinedMesh(self.scene.vertex_count, *(mesh[name] for name in REFINED_MESH_ARRAYS))


def triangles(mesh: dict) -> Array:
    """(T, 3, 3) m"""
    return mesh["vertex_positions"][mesh["elements"]]


def area_vectors(corners: Array) -> Array:
    p, q, r = corners.transpose(1, 0, 2)
    return np.cross(q - p, r - p) / 2


def mean_error(mesh: dict, light: Light, divisions: int = 8) -> float:
    """Area-weighted mean absolute error of the interpolated illuminance, lx."""
    corners, values = triangles(mesh), mesh["direct"][:, 0][mesh["elements"]]
    areas = np.linalg.norm(area_vectors(corners), axis=1)
    n = divisions
    upright = [(3 * i + 1, 3 * j + 1) for i in range(n) for j in range(n - i)]
    inverted = [(3 * i + 2, 3 * j + 2) for i in range(n - 1) for j in range(n - 1 - i)]
    error = 0.0
    for v, w in np.array(upright + inverted) / (3 * n):
        weights = np.array([1 - v - w, v, w])
        points = np.einsum("k,tkc->tc", weights, corners)
        error += areas @ np.abs(values @ weights - light(points, points)) / n**2
    return error / areas.sum()


def assert_conforming(mesh: dict) -> None:
    """Each edge lies between the same two points for all its elements: no T-junction."""
    positions = mesh["vertex_positions"]
    _, points = np.unique(positions, axis=0, return_inverse=True)
    corners = points.reshape(-1)[mesh["elements"]]
    edges = Counter(
        (min(a, b), max(a, b))
        for k in range(3)
        for a, b in zip(corners[:, k], corners[:, (k + 1) % 3], strict=True)
    )
    border = [edge for edge, count in edges.items() if count == 1]
    place = np.zeros((points.max() + 1, 3))
    place[points.reshape(-1)] = positions
    on_border = np.unique(np.array(border))
    for a, b in border:  # nothing else lies on it
        along = place[b] - place[a]
        others = place[np.setdiff1d(on_border, [a, b])] - place[a]
        t = others @ along / (along @ along)
        away = np.linalg.norm(others - t[:, None] * along, axis=1)
        assert not ((t > 0) & (t < 1) & (away < 1e-9)).any()


def test_a_shadow_border_is_found_with_few_elements() -> None:
    run = Run([surface(FLOOR, 0.5)], half_plane).begin(0.05)
    errors, counts = [mean_error(run.refinement.mesh(), half_plane)], [run.scene.element_count]
    for _ in range(3):
        mesh = run.iterate()
        errors.append(mean_error(mesh, half_plane))
        counts.append(len(mesh["elements"]))
    assert errors[1] < errors[0] / 4
    assert errors[2] < errors[1] / 2
    # Uniform subdivision of at least as many elements.
    for count, error in zip(counts[1:], errors[1:], strict=True):
        divisions = 2 ** int(np.ceil(np.log2(count / counts[0]) / 2))
        floor = rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0), 0.5 / divisions)
        uniform = Run([surface(floor, 0.5)], half_plane).begin(0.05)
        assert uniform.scene.element_count >= count
        assert error < mean_error(uniform.refinement.mesh(), half_plane) / 2


@pytest.mark.parametrize(
    "meshes",
    [
        [surface(FLOOR, 0.5)],
        [surface(FLOOR, 0.5, double_sided=True)],
        [surface(FLOOR, 0.5, flip_winding=True)],
        [surface(box((2, 2, 2), 0.7), 0.5)],
        [surface(icosphere(2), 0.5)],
    ],
    ids=["floor", "double-sided", "flipped", "box", "sphere"],
)
@pytest.mark.parametrize("light", [half_plane, band])
def test_the_refined_mesh_is_the_same_surface(meshes: list[MeshDescription], light: Light) -> None:
    run = Run(meshes, light).begin(0.05)
    whole = area_vectors(triangles(run.refinement.mesh()))
    mesh = run.iterate(3)
    assert len(mesh["elements"]) > 1.2 * len(whole)
    assert_conforming(mesh)
    parts, parents = area_vectors(triangles(mesh)), mesh["element_parents"]
    assert (np.diff(parents) >= 0).all()
    sums = np.zeros_like(whole)
    np.add.at(sums, parents, parts)
    np.testing.assert_allclose(sums, whole, rtol=0, atol=1e-12)
    # Same sums without a turn over: none of the parts faces the other way.
    assert (np.einsum("ij,ij->i", parts, whole[parents]) > 0).all()
    sides = 2 if meshes[0].double_sided else 1
    total = sides * np.linalg.norm(whole, axis=1).sum()
    assert mesh["vertex_areas"].sum() == pytest.approx(total, rel=1e-12)


@pytest.mark.parametrize("double_sided", [False, True])
def test_corners_lie_where_their_barycentrics_say(double_sided: bool) -> None:
    run = Run([surface(box((2, 2, 2), 0.7), 0.5, double_sided=double_sided)], band).begin(0.05)
    base = triangles(run.refinement.mesh())
    mesh = run.iterate(3)
    places = np.einsum("tkw,twc->tkc", mesh["barycentrics"], base[mesh["element_parents"]])
    np.testing.assert_allclose(places, triangles(mesh), rtol=0, atol=1e-12)


def test_an_earlier_function_stays_the_same_on_the_finer_mesh() -> None:
    run = Run([surface(box((2, 2, 2), 0.7), 0.5, double_sided=True)], half_plane).begin(0.05)
    early = run.iterate()
    late = run.iterate(2)
    count = len(early["direct"])
    refined = run.refined(late)
    for name in REFINED_MESH_ARRAYS[:4]:
        np.testing.assert_array_equal(late[name][: count - refined.vertex_count], early[name])
    np.testing.assert_array_equal(late["direct"][:count], early["direct"])
    values = refined.interpolate(early["direct"])
    flux = [
        (values[mesh["elements"]].mean(axis=(1, 2)) * np.linalg.norm(area, axis=1)).sum()
        for mesh in (early, late)
        for area in [area_vectors(triangles(mesh))]
    ]
    assert flux[1] == pytest.approx(flux[0], rel=1e-6)
    carried = refined.interpolate(early["vertex_positions"])
    np.testing.assert_allclose(carried, late["vertex_positions"], rtol=0, atol=1e-12)


def test_both_sides_of_a_sheet_share_their_splits() -> None:
    """A sheet lit from above alone: the back gets what the front wants."""
    run = Run(
        [surface(FLOOR, 0.5, double_sided=True)],
        lambda positions, normals: np.where(normals[:, 2] > 0, half_plane(positions, normals), 5.0),
    ).begin(0.05)
    mesh = run.iterate(2)
    first = run.scene.vertex_count
    fronts = np.flatnonzero(mesh["split_twin"] >= 0)
    backs = mesh["split_twin"][fronts] - first
    assert len(fronts) * 2 == len(mesh["split_twin"])
    assert (mesh["split_twin"][backs] == -1).all()
    np.testing.assert_array_equal(mesh["split_point"][fronts], mesh["split_point"][backs])
    np.testing.assert_array_equal(
        mesh["vertex_normals"][first:][fronts], -mesh["vertex_normals"][first:][backs]
    )
    assert (mesh["direct"][first:][backs] == 5.0).all()


def test_the_sides_of_a_crease_share_a_point() -> None:
    run = Run([surface(box((2, 2, 2), 0.7), 0.5)], half_plane).begin(0.05)
    mesh = run.iterate(2)
    positions = mesh["vertex_positions"][run.scene.vertex_count :]
    by_point = Counter(mesh["split_point"].tolist())
    assert set(by_point.values()) == {1, 2}
    places = {p: positions[mesh["split_point"] == p] for p in by_point}
    assert all((place == place[0]).all() for place in places.values())


def test_light_without_bends_wants_no_elements() -> None:
    """Linear interpolation shows it as it is, however steep."""
    run = Run([surface(FLOOR, 0.5)], gradient).begin(0.05)
    assert len(run.iterate(3)["elements"]) == run.scene.element_count


def test_indirect_light_hides_shadows() -> None:
    """[Volevich 2000, §4]: contrast is what total light leaves of it."""
    run = Run([surface(FLOOR, 0.5)], half_plane)
    faint = [len(run.begin(0.1, indirect).iterate(2)["elements"]) for indirect in (0.0, 1000.0)]
    assert faint[0] > 1.5 * run.scene.element_count
    assert faint[1] == run.scene.element_count


def test_black_surfaces_want_no_elements() -> None:
    run = Run([surface(FLOOR, 0.0)], half_plane).begin(0.05)
    assert len(run.iterate(2)["elements"]) == run.scene.element_count


def test_photons_that_contradict_the_vertices_make_the_threshold_strict() -> None:
    """Vertices all lit, photons see a fifth of the light around: something is between."""

    def faint_band(positions: Array, normals: Array) -> Array:
        return np.where(np.abs(positions[:, 0] + 0.25) < 0.1, 75.0, 100.0)

    run = Run([surface(FLOOR, 0.5)], faint_band)
    count = run.scene.vertex_count
    dark, bright = (np.full((count, 3), e, np.float32) for e in (20.0, 100.0))
    elements = {}
    for name, regional in (("none", None), ("dark", dark), ("bright", bright)):
        elements[name] = len(run.begin(0.15, regional=regional).iterate()["elements"])
    assert elements["none"] == elements["bright"] == run.scene.element_count
    assert elements["dark"] > elements["none"]


def test_photons_that_agree_with_the_vertices_save_samples() -> None:
    """None where light is even; all that they need where two vertices differ."""

    def samples(light: Light, *, agree: bool) -> tuple[int, int]:
        run = Run([surface(FLOOR, 0.5)], light)
        lit = run._direct(run.scene.receiver_positions, run.scene.vertex_normals)
        mesh = run.begin(0.05, regional=lit if agree else None).iterate()
        return run.samples, len(mesh["elements"])

    even = [samples(lambda positions, normals: np.full(len(positions), 50.0), agree=agree)
            for agree in (False, True)]  # fmt: skip
    assert even[0][0] > 200
    assert even[1][0] == 0
    border = [samples(half_plane, agree=agree) for agree in (False, True)]
    assert border[1][0] < border[0][0] / 2
    assert border[1][1] == border[0][1]


def test_vertices_go_and_come_back_with_the_threshold() -> None:
    run = Run([surface(FLOOR, 0.5)], half_plane)
    fine = run.begin(0.02, indirect=10.0).iterate(3)
    asked = run.samples
    coarse = run.begin(0.9, indirect=10.0).iterate(3)
    again = run.begin(0.02, indirect=10.0).iterate(3)
    assert len(coarse["elements"]) < len(fine["elements"])
    assert run.samples == asked  # all were kept
    for name, values in fine.items():
        np.testing.assert_array_equal(again[name], values, err_msg=name)


def test_what_was_kept_does_not_change_what_comes() -> None:
    """A threshold first reached from coarser and finer ones gives the bits of a fresh start."""
    run = Run([surface(box((2, 2, 2), 0.7), 0.5)], band)
    for threshold in (0.4, 0.01):
        run.begin(threshold).iterate(3)
    used = run.begin(0.05).iterate(3)
    fresh = Run([surface(box((2, 2, 2), 0.7), 0.5)], band).begin(0.05).iterate(3)
    for name, values in fresh.items():
        np.testing.assert_array_equal(used[name], values, err_msg=name)


def test_needles_are_left_alone() -> None:
    """An element of 1e6 to 1 isn't split, and refinement ends at the least length."""
    needle = Shape(
        np.array([[-1.0, 0, 0], [1, 0, 0], [0, 2e-6, 0], [-1, -1, 0], [1, -1, 0]]),
        np.array([3], np.int32),
        np.array([0, 1, 2], np.int32),
    )
    run = Run([surface(FLOOR, 0.5), surface(needle, 0.5)], half_plane).begin(0.05)
    mesh = run.iterate(3)
    assert (mesh["element_parents"] == run.scene.element_count - 1).sum() == 1
    shortest = Run([surface(rectangle((0, -1, 0), (1, 0, 0), (0, 2, 0), 2.0), 0.5)], half_plane)
    shortest.begin(0.05)
    counts = [len(shortest.iterate()["elements"]) for _ in range(24)]
    assert counts[-1] == counts[-2]
    assert np.isfinite(shortest.refinement.mesh()["direct"]).all()


def test_misuse_is_told() -> None:
    run = Run([surface(FLOOR, 0.5)], half_plane).begin(0.05)
    with pytest.raises(RuntimeError, match="samples are still wanted"):
        run.refinement.split()
    run.refinement.wanted_samples()
    with pytest.raises(ValueError, match="as many illuminances"):
        run.refinement.add_samples(np.zeros((1, 3), np.float32), np.zeros(1, np.float32))
