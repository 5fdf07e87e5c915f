"""What a baked stage looks like to a reader that has nothing but usd-core."""

import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from isolux._core import tone_map
from pxr import Gf, Sdf, Usd, UsdGeom, UsdRender, UsdValidation

from hand_built import cube, grid, scene_of, solution_of, source_stage
from isolux.errors import SceneError
from isolux.report import read_report
from isolux.results import ResultsWriter

RED_AND_GREY = [[0.8, 0.1, 0.1], [0.4, 0.4, 0.4], [0.8, 0.1, 0.1], [0.4, 0.4, 0.4]]
WEIGHTS = np.array([0.2126, 0.7152, 0.0722])

# Mesh; interpolation of its illuminance; of its displayColor.
MESHES = {
    "cube of creases": (cube("/World/Mesh"), "faceVarying", "faceVarying"),
    "smooth grid": (grid("/World/Mesh"), "vertex", "vertex"),
    "point that no face uses": (grid("/World/Mesh", unused_points=1), "vertex", "vertex"),
    "hole": (grid("/World/Mesh", holes=[2]), "vertex", "vertex"),
    "cube with a hole": (cube("/World/Mesh", holes=[2]), "faceVarying", "faceVarying"),
    "two materials": (grid("/World/Mesh", reflectance=RED_AND_GREY), "vertex", "faceVarying"),
    "one material, told by face": (
        grid("/World/Mesh", reflectance=RED_AND_GREY[:1] * 4),
        "vertex",
        "vertex",
    ),
    "double-sided": (grid("/World/Mesh", double_sided=True), "vertex", "vertex"),
    "double-sided cube of two materials": (
        cube("/World/Mesh", reflectance=RED_AND_GREY + RED_AND_GREY[:2], double_sided=True),
        "faceVarying",
        "faceVarying",
    ),
}


def bake(folder, parts, stages=3, *, source=None, provenance=None):
    """Write progressive stages over a source; gives the output and the solutions."""
    source = source or source_stage(folder / "room.usda", parts)
    output = folder / "room.isolux.usda"
    scene = scene_of(description for description, _ in parts)
    writer = ResultsWriter(source, output, scene, provenance or {"version": "1.2.3"})
    solutions = [solution_of(parts, index) for index in range(1, stages + 1)]
    for solution in solutions:
        writer.write(solution)
    return output, solutions


def names_in(folder):
    return sorted(path.name for path in folder.iterdir())


def primvar(stage, name, path="/World/Mesh"):
    return UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(path)).GetPrimvar(name)


def corner_values(stage, name, time, path="/World/Mesh"):
    """A primvar at each face corner, as any reader would expand it."""
    values = np.array(primvar(stage, name, path).ComputeFlattened(time))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath(path))
    corners = np.array(mesh.GetFaceVertexIndicesAttr().Get())
    interpolation = primvar(stage, name, path).GetInterpolation()
    wanted = {"vertex": len(mesh.GetPointsAttr().Get()), "faceVarying": len(corners)}
    assert len(values) == wanted[interpolation]
    return values[corners] if interpolation == "vertex" else values


def log_average_luminance(solution, description, corner_vertices, sides):
    """A vertex between faces reflects as they do on average."""
    reflectance = face_corners(description.reflectance, description)
    total = (solution.direct + solution.indirect).astype(float)
    log_luminance, areas = [], []
    for side in sides:
        for vertex, illuminance in enumerate(total[side]):
            mean_reflectance = reflectance[corner_vertices == vertex].mean(axis=0)
            log_luminance.append(np.log(illuminance * mean_reflectance / np.pi @ WEIGHTS))
        areas.extend(solution.vertex_areas[side])
    return np.exp(np.average(log_luminance, weights=areas))


def face_corners(by_face, description):
    faces = np.repeat(
        np.arange(len(description.face_vertex_counts)), description.face_vertex_counts
    )
    return by_face[faces % len(by_face)].astype(float)


@pytest.mark.parametrize(("part", "interpolation", "_"), MESHES.values(), ids=MESHES.keys())
def test_each_corner_reads_its_own_illuminance_at_every_stage(tmp_path, part, interpolation, _):
    output, solutions = bake(tmp_path, [part])
    stage = Usd.Stage.Open(str(output))
    description, corner_vertices = part
    for time, solution in enumerate(solutions, start=1):
        layout = solution.layout("/World/Mesh")
        for name, values, side in (
            ("illuminance", solution.direct + solution.indirect, layout.front),
            ("direct", solution.direct, layout.front),
            ("indirect", solution.indirect, layout.front),
            ("relativeDeviation", solution.relative_deviation, layout.front),
            ("backIlluminance", solution.direct + solution.indirect, layout.back),
        ):
            if name == "backIlluminance" and not description.double_sided:
                assert not primvar(stage, "isolux:backIlluminance").HasValue()
                continue
            surface = corner_vertices >= 0
            found = corner_values(stage, f"isolux:{name}", time)
            assert np.array_equal(found[surface], values[side][corner_vertices[surface]])
            assert primvar(stage, f"isolux:{name}").GetInterpolation() == interpolation


@pytest.mark.parametrize(("part", "_", "interpolation"), MESHES.values(), ids=MESHES.keys())
def test_display_colour_is_the_tone_mapped_luminance_of_the_brighter_side(
    tmp_path, part, _, interpolation
):
    output, (solution,) = bake(tmp_path, [part], stages=1)
    stage = Usd.Stage.Open(str(output))
    description, corner_vertices = part
    layout = solution.layout("/World/Mesh")
    sides = (layout.front, layout.back) if description.double_sided else (layout.front,)
    adaptation = log_average_luminance(solution, description, corner_vertices, sides)

    surface = corner_vertices >= 0
    vertices = corner_vertices[surface]
    total = solution.direct + solution.indirect
    both_sides = zip(*(total[side][vertices] for side in sides), strict=True)
    illuminance = np.array([max(pair, key=WEIGHTS.dot) for pair in both_sides])
    reflectance = face_corners(description.reflectance, description)[surface]
    expected = tone_map((illuminance * reflectance / np.pi).astype(np.float32), adaptation)
    found = corner_values(stage, "displayColor", 1)[surface]
    assert found == pytest.approx(expected, abs=1e-5)
    assert primvar(stage, "displayColor").GetInterpolation() == interpolation


def test_the_default_time_reads_as_the_last_stage(tmp_path):
    output, solutions = bake(tmp_path, [grid("/World/Mesh")])
    stage = Usd.Stage.Open(str(output))
    last = solutions[-1].illuminance("/World/Mesh")
    assert np.array_equal(corner_values(stage, "isolux:illuminance", Usd.TimeCode.Default()), last)


def test_a_point_that_no_face_uses_reads_zero(tmp_path):
    output, _ = bake(tmp_path, [grid("/World/Mesh", unused_points=2)])
    stage = Usd.Stage.Open(str(output))
    values = primvar(stage, "isolux:illuminance").Get(2)
    assert [tuple(value) for value in values[9:]] == [(0, 0, 0), (0, 0, 0)]


def test_indices_of_the_source_do_not_pick_from_the_results(tmp_path):
    part = grid("/World/Mesh")
    source = source_stage(tmp_path / "room.usda", [part])
    own = UsdGeom.PrimvarsAPI(source.GetPrimAtPath("/World/Mesh")).CreatePrimvar(
        "displayColor", Sdf.ValueTypeNames.Color3fArray, "faceVarying"
    )
    own.Set([Gf.Vec3f(1, 0, 0)])
    own.SetIndices([0] * 16)
    own.GetIndicesAttr().Set([0] * 16, 2.0)
    source.Save()

    output, _ = bake(tmp_path, [part], source=source)
    stage = Usd.Stage.Open(str(output))
    colour = primvar(stage, "displayColor")
    assert not colour.IsIndexed()
    assert len(colour.ComputeFlattened(2.0)) == 9


def test_a_mesh_that_references_another_keeps_its_own_results(tmp_path):
    """Composition carries the results of /World/A into /World/B as well: another layout."""
    parts = [cube("/World/A", double_sided=True), grid("/World/B")]
    source = source_stage(tmp_path / "room.usda", parts)
    source.GetPrimAtPath("/World/B").GetReferences().AddInternalReference("/World/A")
    source.Save()
    output, (solution,) = bake(tmp_path, parts, stages=1, source=source)
    stage = Usd.Stage.Open(str(output))
    for path in ("/World/A", "/World/B"):
        found = corner_values(stage, "isolux:illuminance", 1, path)
        assert np.array_equal(found, solution.illuminance(path))
    assert primvar(stage, "isolux:backIlluminance", "/World/A").HasValue()
    assert not primvar(stage, "isolux:backIlluminance", "/World/B").HasValue()


def test_the_results_pass_every_validator_of_usd(tmp_path):
    parts = [make(f"/World/Mesh{i}", **kwargs) for i, (make, kwargs) in enumerate(VALIDATED)]
    output, _ = bake(tmp_path, parts)
    stage = Usd.Stage.Open(str(output))
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    errors = UsdValidation.ValidationContext(validators).Validate(stage)
    assert [(error.GetName(), error.GetMessage()) for error in errors] == []


VALIDATED = [(cube, {}), (grid, {"double_sided": True}), (grid, {"reflectance": RED_AND_GREY})]


def test_the_source_is_untouched_and_the_folder_can_move(tmp_path):
    project = tmp_path / "project"
    (project / "lighting").mkdir(parents=True)
    part = grid("/World/Mesh")
    source_stage(project / "room.usda", [part])
    before = (project / "room.usda").read_bytes()
    output = project / "lighting" / "baked.usda"
    writer = ResultsWriter(project / "room.usda", output, scene_of([part[0]]), {})
    writer.write(solution_of([part]))
    assert (project / "room.usda").read_bytes() == before
    assert names_in(output.parent) == ["baked.results.usdc", "baked.usda"]

    shutil.move(project, tmp_path / "elsewhere")
    stage = Usd.Stage.Open(str(tmp_path / "elsewhere/lighting/baked.usda"))
    assert stage.GetPrimAtPath("/World/Mesh").GetTypeName() == "Mesh"
    assert primvar(stage, "isolux:illuminance").Get(1)


def test_the_root_layer_carries_the_metadata_that_sublayers_do_not_give(tmp_path):
    part = grid("/World/Mesh")
    source = source_stage(tmp_path / "room.usda", [part])
    source.SetTimeCodesPerSecond(48)
    source.SetFramesPerSecond(12)
    UsdGeom.SetStageMetersPerUnit(source, 0.01)
    source.Save()
    output, solutions = bake(tmp_path, [part], source=source)
    stage = Usd.Stage.Open(str(output))
    assert stage.GetTimeCodesPerSecond() == 48
    assert stage.GetFramesPerSecond() == 12
    assert UsdGeom.GetStageMetersPerUnit(stage) == 0.01
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    assert stage.GetDefaultPrim().GetPath() == "/World"
    # No range in the source: the timeline shows the stages.
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1, 3)
    # Another rate in the results layer would have moved the samples.
    assert primvar(stage, "isolux:direct").GetTimeSamples() == [1, 2, 3]
    second = solutions[1].illuminance("/World/Mesh")
    assert np.array_equal(corner_values(stage, "isolux:illuminance", 2), second)


def test_an_authored_time_range_stays(tmp_path):
    part = grid("/World/Mesh")
    source = source_stage(tmp_path / "room.usda", [part])
    source.SetStartTimeCode(1001)
    source.SetEndTimeCode(1100)
    source.Save()
    output, _ = bake(tmp_path, [part], source=source)
    stage = Usd.Stage.Open(str(output))
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1001, 1100)


def render_settings_of(output):
    stage = Usd.Stage.Open(str(output))
    prim = UsdRender.Settings.GetStageRenderSettings(stage).GetPrim()
    assert prim.GetAttribute("isolux:report:component").Get(1) == "DEPT"
    assert prim.GetAttribute("isolux:report:photons").Get(2) == 2**40 + 2
    assert prim.GetAttribute("isolux:report:rmsErrorIndirect").Get(2) == 0.1
    return str(prim.GetPath())


def test_the_report_sits_on_the_render_settings_of_the_stage(tmp_path):
    part = grid("/World/Mesh")
    source = source_stage(tmp_path / "room.usda", [part])
    UsdRender.Settings.Define(source, "/Pipeline/Final")
    source.SetMetadata("renderSettingsPrimPath", "/Pipeline/Final")
    source.Save()
    output, _ = bake(tmp_path, [part], source=source)
    assert render_settings_of(output) == "/Pipeline/Final"


@pytest.mark.parametrize("names", [(), ("/Render",), ("/Render", "/IsoluxRender")])
def test_a_stage_without_render_settings_gets_some_beside_its_prims(tmp_path, names):
    part = grid("/World/Mesh")
    source = source_stage(tmp_path / "room.usda", [part])
    for name in names:
        UsdGeom.Mesh.Define(source, name)
    source.Save()
    output, _ = bake(tmp_path, [part], source=source)
    path = render_settings_of(output)
    assert Sdf.Path(path).GetParentPath() not in [Sdf.Path(name) for name in names]


@pytest.mark.parametrize("edit", ["in memory", "unsaved", "session"])
def test_a_stage_that_no_file_holds_is_kept_beside_the_results(tmp_path, edit):
    part = grid("/World/Mesh")
    source = source_stage(tmp_path / "room.usda", [part])
    if edit == "in memory":
        memory = Usd.Stage.CreateInMemory()
        memory.GetRootLayer().TransferContent(source.GetRootLayer())
        source = memory
    if edit == "session":
        source.SetEditTarget(source.GetSessionLayer())
    source.GetPrimAtPath("/World/Mesh").GetAttribute("points").Set([Gf.Vec3f(7)] * 9)

    output, _ = bake(tmp_path, [part], source=source)
    assert (tmp_path / "room.isolux.source.usdc").exists()
    stage = Usd.Stage.Open(str(output))
    assert stage.GetPrimAtPath("/World/Mesh").GetAttribute("points").Get()[0] == Gf.Vec3f(7)
    assert primvar(stage, "isolux:illuminance").Get(1)


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("room.usda", "a layer of the source stage"),
        ("walls.usda", "a layer of the source stage"),
        ("room.png", 'suffix ".png"'),
        ("room", 'suffix ""'),
        ("missing/room.usda", "no writable folder"),
    ],
)
def test_an_output_that_cannot_be_is_refused_before_any_work(tmp_path, name, found):
    part = grid("/World/Mesh")
    source_stage(tmp_path / "walls.usda", [part])
    source = Usd.Stage.CreateNew(str(tmp_path / "room.usda"))
    source.GetRootLayer().subLayerPaths.append("./walls.usda")
    source.Save()
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(SceneError, match=found):
        ResultsWriter(source, tmp_path / name, scene_of([part[0]]), {})
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_reader_sees_whole_stages_at_every_moment(tmp_path, monkeypatch):
    """Looked at before and after each file takes its place."""
    output = tmp_path / "room.isolux.usda"
    seen = []

    def look():
        if output.exists():
            _, stages = read_report(output)
            layer = Sdf.Layer.OpenAsAnonymous(str(tmp_path / "room.isolux.results.usdc"))
            for name in ("isolux:illuminance", "displayColor"):
                times = layer.ListTimeSamplesForPath(f"/World/Mesh.primvars:{name}")
                assert times == [stage.index for stage in stages]
            seen.append(len(stages))

    replace = Path.replace

    def watched(self, target):
        look()
        replace(self, target)
        look()

    monkeypatch.setattr(Path, "replace", watched)
    bake(tmp_path, [grid("/World/Mesh")])
    assert seen == sorted(seen)
    assert set(seen) == {1, 2, 3}


@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_a_write_that_fails_leaves_the_earlier_stages(tmp_path, monkeypatch, call):
    part = grid("/World/Mesh")
    source = source_stage(tmp_path / "room.usda", [part])
    output = tmp_path / "baked.usda"
    writer = ResultsWriter(source, output, scene_of([part[0]]), {})
    writer.write(solution_of([part], 1))
    files = names_in(tmp_path)

    def refuse(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os if call == "fsync" else Path, call, refuse)
    with pytest.raises(SceneError, match=r"baked\.results\.usdc: found No space left on device"):
        writer.write(solution_of([part], 2))
    monkeypatch.undo()
    assert names_in(tmp_path) == files
    assert [stage.index for stage in read_report(output)[1]] == [1]
    writer.write(solution_of([part], 3))
    assert read_report(output)[1][-1].index == 3


@pytest.fixture
def tiny_disk(tmp_path):
    """A file system of 256 KiB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(disk)]
    if not shutil.which("mount") or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("mounting a small file system needs privileges")
    yield disk
    subprocess.run(["umount", str(disk)], check=True)


def test_a_full_disk_is_named_and_leaves_the_earlier_stages(tmp_path, tiny_disk):
    parts = [cube(f"/World/Mesh{i}") for i in range(20)]
    source = source_stage(tmp_path / "room.usda", parts)
    output = tiny_disk / "baked.usda"
    writer = ResultsWriter(source, output, scene_of(p[0] for p in parts), {})
    with pytest.raises(SceneError, match=r"baked\.results\.usdc.*No space left on device"):
        for index in range(1, 100):
            writer.write(solution_of(parts, index))
    assert names_in(tiny_disk) == ["baked.results.usdc", "baked.usda"]
    _, stages = read_report(output)
    assert [stage.index for stage in stages] == list(range(1, index))
