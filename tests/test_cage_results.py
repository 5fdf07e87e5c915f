"""Results of subdivision surfaces: on the cage, whose own rules give the solver's values again."""

from dataclasses import replace

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from cages import CUBE_EDGES, CUBE_FACES, CUBE_POINTS, grid, mesh_usda
from hand_built import solution_of
from isolux.render import render_picture
from isolux.results import ResultsWriter
from isolux.solution import LUMINANCE_WEIGHTS
from isolux.stage_reader import read_stage
from small_room import LAMP, write_stage
from split_edges import SplitMesh, every_edge, layouts_of

WAVE_POINTS, WAVE_FACES = grid(5)
WAVE_POINTS[:, 2] = np.sin(WAVE_POINTS[:, 0] * 1.3) * np.cos(WAVE_POINTS[:, 1])
CHAINS = "; ".join(
    [
        f"int[] creaseIndices = {[p for edge in CUBE_EDGES for p in edge]}",
        f"int[] creaseLengths = {[2] * 12}",
        f"float[] creaseSharpnesses = {[10] * 12}",
    ]
)
SHOWN = "/World/Cage"


class Baked:
    """A cage with made-up illuminance, as the results hold it.

    light : illuminance of front vertices, (n, 3), by their places on the limit surface, their cage
        face and the refined surface
    """

    def __init__(self, folder, points, faces, light, extra="", refined=False):
        source = write_stage(folder / "cage.usda", mesh_usda(points, faces, extra), LAMP)
        stage = Usd.Stage.Open(str(source))
        self.scene = read_stage(stage)
        (self.mesh,) = self.scene.meshes
        self.surface = self.mesh.cage.refine()
        layouts = layouts_of(self.scene)
        corners = layouts[SHOWN].corner_vertices
        first = np.zeros(corners.max() + 1, np.int64)
        first[corners[corners >= 0]] = np.flatnonzero(corners >= 0)
        parents = np.repeat(self.surface.cage_faces, self.mesh.face_vertex_counts)
        point = self.mesh.face_vertex_indices[first]
        self.illuminance = light(self.mesh.points[point], parents[first], self.surface, point)
        solution = solution_of([(self.mesh, corners)])
        solution = replace(
            solution,
            scene=self.scene,
            layouts=layouts,
            direct=(0.75 * self.illuminance).astype(np.float32),
            indirect=(0.25 * self.illuminance).astype(np.float32),
        )
        if refined:
            split = SplitMesh(self.scene, layouts).split(every_edge)
            solution = replace(
                solution,
                refined=split,
                direct=split.interpolate(solution.direct),
                indirect=split.interpolate(solution.indirect),
                relative_deviation=split.interpolate(solution.relative_deviation),
            )
        self.solution, self.corner_light = solution, self.illuminance[corners]
        writer = ResultsWriter(stage, folder / "out.usda", self.scene, {})
        writer.write(solution)
        self.findings = writer.findings
        self.stage = Usd.Stage.Open(str(folder / "out.usda"))
        self.prim = self.stage.GetPrimAtPath(SHOWN)

    def primvar(self, name="isolux:illuminance"):
        return UsdGeom.PrimvarsAPI(self.prim).GetPrimvar(name)

    def limit(self, name="isolux:illuminance"):
        """The primvar at the refined corners, by the rules of the mesh that it is written on."""
        primvar = self.primvar(name)
        interpolation = primvar.GetInterpolation()
        if interpolation == "vertex":
            spread = self.surface.refine_primvar(np.array(primvar.Get(1.0)), "vertex")
            return spread[self.surface.topology.indices]
        indices = np.array(primvar.GetIndices(1.0), np.int32)
        return self.surface.refine_primvar(np.array(primvar.Get(1.0)), interpolation, indices)


def points_at_corners(mesh):
    return np.array(mesh.GetPointsAttr().Get())[mesh.GetFaceVertexIndicesAttr().Get()]


def smooth(cage_values):
    """What a function given on the cage's points is on the limit surface."""
    return lambda places, faces, surface, points: surface.limit_stencils[points] @ cage_values


def test_light_that_the_cage_can_carry_comes_back_whole(tmp_path):
    wanted = np.random.default_rng(3).uniform(10, 500, (len(WAVE_POINTS), 3))
    baked = Baked(tmp_path, WAVE_POINTS, WAVE_FACES, smooth(wanted))
    assert baked.primvar().GetInterpolation() == "vertex"
    np.testing.assert_allclose(np.array(baked.primvar().Get(1.0)), wanted, rtol=1e-3, atol=0.05)
    np.testing.assert_allclose(baked.limit(), baked.corner_light, rtol=1e-4, atol=0.01)
    assert not baked.findings


def test_the_total_on_the_cage_is_the_sum_of_its_parts(tmp_path):
    baked = Baked(tmp_path, CUBE_POINTS, CUBE_FACES, lambda p, *_: np.maximum(p, 0) * 100)
    direct, indirect = (
        np.array(baked.primvar(f"isolux:{part}").Get(1.0)) for part in ("direct", "indirect")
    )
    np.testing.assert_allclose(np.array(baked.primvar().Get(1.0)), direct + indirect, rtol=1e-6)


def test_light_that_the_cage_can_not_carry_is_told_by_how_much(tmp_path):
    """A ball lit from one side, E = max(0, cos θ), on the eight points of a cube."""

    def lit_from_above(places, *_):
        return np.repeat(np.maximum(places[:, 2:], 0), 3, axis=1) * 1000

    baked = Baked(tmp_path, CUBE_POINTS, CUBE_FACES, lit_from_above)
    assert (np.array(baked.primvar().Get(1.0)) >= 0).all()
    (finding,) = baked.findings
    assert (finding.path, finding.action) == (SHOWN, "approximated")
    told = float(finding.reason.split(" % RMS")[0].split()[-1]) / 100
    # The same, vertex by vertex, from what the layer holds.
    corners = baked.solution.layouts[SHOWN].corner_vertices
    first = np.unique(corners, return_index=True)[1]
    wanted = baked.corner_light[first] @ LUMINANCE_WEIGHTS
    difference = baked.limit()[first] @ LUMINANCE_WEIGHTS - wanted
    areas = baked.solution.vertex_areas
    rms = np.sqrt(np.average(difference**2, weights=areas)) / np.average(wanted, weights=areas)
    assert told == pytest.approx(rms, rel=0.01)


def test_no_other_non_negative_values_come_nearer(tmp_path):
    """At the bound, a step to either side along each point leaves more to be wanted."""
    light = lambda places, *_: np.repeat(np.maximum(places[:, 2:], 0), 3, axis=1) * 1000  # noqa: E731
    baked = Baked(tmp_path, CUBE_POINTS, CUBE_FACES, light)
    values = np.array(baked.primvar().Get(1.0), float)[:, 0]
    corners = baked.solution.layouts[SHOWN].corner_vertices
    first = np.unique(corners, return_index=True)[1]
    stencils = baked.surface.limit_stencils[baked.surface.topology.indices[first]].toarray()
    areas, wanted = baked.solution.vertex_areas, baked.corner_light[first][:, 0]

    def loss(cage):
        return areas @ (stencils @ cage - wanted) ** 2

    for point in range(8):
        for step in (-2.0, 2.0):
            other = values.copy()
            other[point] = max(0.0, other[point] + step)
            assert loss(other) >= loss(values) * (1 - 1e-6)


def test_sharp_edges_keep_the_light_of_their_sides_apart(tmp_path):
    baked = Baked(
        tmp_path,
        CUBE_POINTS,
        CUBE_FACES,
        lambda places, faces, *_: (100.0 * (1 + faces))[:, None] * np.ones(3),
        CHAINS,
    )
    assert baked.primvar().GetInterpolation() == "faceVarying"
    assert len(baked.primvar().Get(1.0)) == 24
    np.testing.assert_allclose(baked.limit(), baked.corner_light, rtol=1e-4)
    assert not baked.findings


def test_colours_of_faces_keep_their_display_colours_apart(tmp_path):
    colours = [(0.1 + 0.1 * i, 0.3, 0.3) for i in range(6)]
    baked = Baked(
        tmp_path,
        CUBE_POINTS,
        CUBE_FACES,
        lambda places, *_: np.full((len(places), 3), 300.0),
        f'color3f[] primvars:displayColor = {colours} ( interpolation = "uniform" )',
    )
    assert baked.primvar().GetInterpolation() == "vertex"
    colour = baked.primvar("displayColor")
    assert colour.GetInterpolation() == "faceVarying"
    shown = baked.limit("displayColor")[:, 0]
    faces = np.repeat(baked.surface.cage_faces, 4)
    for face in range(6):
        assert np.ptp(shown[faces == face]) < 1e-3
    assert len(np.unique(np.round(shown, 2))) == 6


def test_holes_take_no_part_in_the_light_of_their_cage(tmp_path):
    wanted = np.random.default_rng(5).uniform(10, 500, (len(WAVE_POINTS), 3))
    baked = Baked(tmp_path, WAVE_POINTS, WAVE_FACES, smooth(wanted), "int[] holeIndices = [12]")
    on_surface = np.repeat(baked.surface.cage_faces, 4) != 12
    np.testing.assert_allclose(
        baked.limit()[on_surface], baked.corner_light[on_surface], rtol=1e-3, atol=0.1
    )


def test_output_mode_refined_writes_the_limit_surface_as_polygons(tmp_path):
    extra = "; ".join(
        [
            "texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] "
            '( interpolation = "faceVarying" )',
            f"int[] primvars:st:indices = {[0, 1, 2, 3] * 6}",
            'int[] primvars:piece = [0, 1, 2, 3, 4, 5] ( interpolation = "uniform" )',
            'normal3f[] normals = [(0, 0, 1)] ( interpolation = "constant" )',
        ]
    )
    baked = Baked(
        tmp_path, CUBE_POINTS, CUBE_FACES, lambda p, *_: np.abs(p) * 100, extra, refined=True
    )
    mesh = UsdGeom.Mesh(baked.prim)
    assert mesh.GetSubdivisionSchemeAttr().Get() == "none"
    normals = np.array(mesh.GetNormalsAttr().Get())
    assert mesh.GetNormalsInterpolation() == "faceVarying"
    assert (np.einsum("ij,ij->i", normals, points_at_corners(mesh)) > 0.8).all()
    points = np.array(mesh.GetPointsAttr().Get())
    np.testing.assert_allclose(points[: len(baked.mesh.points)], baked.mesh.points, atol=1e-6)
    parents = np.array(baked.primvar("isolux:sourceFace").Get())
    np.testing.assert_array_equal(np.array(baked.primvar("piece").ComputeFlattened()), parents)
    st = np.array(baked.primvar("st").ComputeFlattened())
    assert len(st) == 3 * len(parents)
    assert st.min() >= 0
    assert st.max() <= 1
    light = np.array(baked.primvar().ComputeFlattened(1.0))
    at_points = np.abs(points) * 100
    known = slice(len(baked.mesh.points))
    np.testing.assert_allclose(light[known], at_points[known], rtol=1e-4, atol=1e-3)
    picture = render_picture(baked.stage, width=48, samples=1)
    assert picture.rgb.max() > 0


def test_a_picture_shows_the_subdivided_cage(tmp_path):
    """Seen from afar along z: the outline is the limit's, not the cage's, and shines evenly."""
    extra = 'color3f[] primvars:displayColor = [(0.5, 0.5, 0.5)] ( interpolation = "constant" )'
    baked = Baked(tmp_path, CUBE_POINTS, CUBE_FACES, lambda p, *_: np.full(p.shape, 100.0), extra)
    camera = UsdGeom.Camera.Define(baked.stage, "/Camera")
    camera.CreateProjectionAttr("orthographic")
    camera.CreateHorizontalApertureAttr(30.0)  # tenths of a unit
    camera.CreateVerticalApertureAttr(30.0)
    UsdGeom.XformCommonAPI(camera).SetTranslate((0, 0, -10))
    UsdGeom.XformCommonAPI(camera).SetRotate((180, 0, 0))
    picture = render_picture(baked.stage, camera="/Camera", width=90)
    outline = baked.mesh.points[:, :2]
    widest = np.ptp(outline[:, 0])
    share = picture.coverage.mean() * 3.0**2
    assert 0.75 * widest**2 < share < 0.85 * widest**2  # a disk has π/4
    seen = picture.coverage > 0.999
    np.testing.assert_allclose(picture.rgb[seen], 0.5 * 100 / np.pi, rtol=1e-3)


def test_output_mode_refined_writes_polygons_without_an_adaptive_mesh_too(tmp_path):
    folder = tmp_path / "plain"
    folder.mkdir()
    baked = Baked(folder, CUBE_POINTS, CUBE_FACES, lambda p, *_: np.abs(p) * 100)
    output = tmp_path / "refined.usda"
    source = Usd.Stage.Open(str(folder / "cage.usda"))
    writer = ResultsWriter(source, output, baked.scene, {}, output_mode="refined")
    writer.write(baked.solution)
    writer.write(replace(baked.solution, stage=replace(baked.solution.stage, index=2)))
    results = Usd.Stage.Open(str(output))
    mesh = UsdGeom.Mesh(results.GetPrimAtPath(SHOWN))
    assert mesh.GetSubdivisionSchemeAttr().Get() == "none"
    assert len(mesh.GetFaceVertexCountsAttr().Get()) == 2 * len(baked.mesh.face_vertex_counts)
    primvar = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("isolux:illuminance")
    assert primvar.GetTimeSamples() == [1.0, 2.0]
    for time in primvar.GetTimeSamples():
        np.testing.assert_allclose(
            np.array(primvar.ComputeFlattened(time)),
            np.abs(baked.mesh.points) * 100,
            rtol=1e-5,
            atol=1e-4,
        )
    assert not writer.findings


def test_noise_that_the_solver_tells_is_no_fault_of_the_cage(tmp_path):
    rng = np.random.default_rng(1)

    def noisy(places, *_):
        return np.repeat(100 * (1 + 0.05 * rng.standard_normal((len(places), 1))), 3, axis=1)

    baked = Baked(tmp_path, WAVE_POINTS, WAVE_FACES, noisy)
    assert not baked.findings  # solution_of tells some 17 %
    # Every cage value is a mean over many places.
    values = np.array(baked.primvar().Get(1.0))[:, 0]
    assert np.std(values) < 0.05 * 100


def test_colours_that_vary_over_the_faces_are_smooth_on_the_cage(tmp_path):
    colours = [(float(0.1 + 0.15 * p[0]), 0.3, 0.3) for p in WAVE_POINTS]
    extra = f'color3f[] primvars:displayColor = {colours} ( interpolation = "vertex" )'
    light = smooth(np.full((len(WAVE_POINTS), 3), 300.0))
    baked = Baked(tmp_path, WAVE_POINTS, WAVE_FACES, light, extra)
    primvar = baked.primvar("displayColor")
    assert primvar.GetInterpolation() == "vertex"
    # Under even light the shown colour rises with the reflectance, from dark to bright.
    shown = baked.limit("displayColor")[:, 0]
    x = baked.mesh.points[baked.mesh.face_vertex_indices, 0]
    assert np.corrcoef(shown, x)[0, 1] > 0.99
    assert np.ptp(shown[x < 0.1]) < 0.25 * np.ptp(shown)
