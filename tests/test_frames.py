"""A shot: each frame is what a solve at its time gives, and one root plays them back."""

import signal
import subprocess
import sys
import time as clock

import numpy as np
import pytest
from pxr import Usd, UsdGeom
from typer.testing import CliRunner

from isolux import ProgressiveSolver, SettingsError, SolverSettings, read_stage
from isolux.cli import ExitCode, app
from isolux.frames import frame_label
from isolux.frames_command import parse_frames
from isolux.report import read_replay, read_report
from usda_stage import METRES

LAMP = """def SphereLight "Lamp" {
    float inputs:intensity = 300
    double3 xformOp:translate.timeSamples = { 1: (-1, 0, 3), 3: (1, 0, 3) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""
FLOOR = """def Mesh "Floor" {
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(-2, -2, 0), (2, -2, 0), (2, 2, 0), (-2, 2, 0)]
    uniform token subdivisionScheme = "none"
    color3f[] primvars:displayColor = [(0.6, 0.5, 0.4)]
}
"""
# Flat at 1 and 2: its middle line is a crease only at 3.
FOLD = """def Mesh "Fold" {
    int[] faceVertexCounts = [4, 4]
    int[] faceVertexIndices = [0, 1, 4, 3, 1, 2, 5, 4]
    point3f[] points.timeSamples = {
        2: [(-1,-1,1), (0,-1,1), (1,-1,1), (-1,1,1), (0,1,1), (1,1,1)],
        3: [(-1,-1,1), (0,-1,2), (1,-1,1), (-1,1,1), (0,1,2), (1,1,1)],
    }
    uniform token subdivisionScheme = "none"
}
"""
GROWING = """def Mesh "Growing" {
    int[] faceVertexCounts.timeSamples = { 1: [4], 3: [4, 3] }
    int[] faceVertexIndices.timeSamples = { 1: [0, 1, 2, 3], 3: [0, 1, 2, 3, 3, 2, 4] }
    point3f[] points.timeSamples = {
        1: [(-1,-1,1), (1,-1,1), (1,1,1), (-1,1,1)],
        3: [(-1,-1,1), (1,-1,1), (1,1,1), (-1,1,1), (0,2,1)],
    }
    uniform token subdivisionScheme = "none"
}
"""
BALL = """def Sphere "Ball" {
    double radius.timeSamples = { 1: 0.5, 3: 1 }
}
"""
SEEN_AT_1_AND_3 = """token visibility.timeSamples = {
    1: "inherited", 2: "invisible", 3: "inherited"
}"""
BLINKING = FLOOR.replace('"Floor" {', f'"Blinking" {{\n {SEEN_AT_1_AND_3}')
# One colour for both faces, then one each: displayColor is parted at 3 alone.
COLOURED = """def Mesh "Coloured" {
    int[] faceVertexCounts = [4, 4]
    int[] faceVertexIndices = [0, 1, 4, 3, 1, 2, 5, 4]
    point3f[] points = [(-1,-1,1), (0,-1,1), (1,-1,1), (-1,1,1), (0,1,1), (1,1,1)]
    uniform token subdivisionScheme = "none"
    color3f[] primvars:displayColor ( interpolation = "uniform" )
    color3f[] primvars:displayColor.timeSamples = {
        2: [(0.5, 0.5, 0.5), (0.5, 0.5, 0.5)],
        3: [(0.5, 0.1, 0.1), (0.1, 0.1, 0.5)],
    }
}
"""
TWO_COLOURS = COLOURED.replace("2: [(0.5, 0.5, 0.5), (", "2: [(0.2, 0.2, 0.2), (")
BUDGET = ("--method", "dept", "--photons", "4000", "--stages", "2")


def isolux(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def write(folder, *prims):
    path = folder / "shot.usda"
    path.write_text(
        "#usda 1.0\n" + METRES + 'def Xform "World" {\n' + "".join(prims) + "}\n" + LAMP
    )
    return path


def solved_at(source, frame):
    """The solution that a single solve at this time gives."""
    settings = SolverSettings(method="dept", stages=2).with_budget(photons=4000)
    return list(ProgressiveSolver(read_stage(source, frame), settings).stages())[-1]


def corner_values(stage, path, name, time):
    """A primvar at face corners, as a reader at this time would expand it."""
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath(path))
    corners = np.array(mesh.GetFaceVertexIndicesAttr().Get(time))
    primvar = UsdGeom.PrimvarsAPI(mesh).GetPrimvar(name)
    values = np.array(primvar.ComputeFlattened(time))
    wanted = {"vertex": len(mesh.GetPointsAttr().Get(time)), "faceVarying": len(corners)}
    assert len(values) == wanted[primvar.GetInterpolation()]
    return values[corners] if primvar.GetInterpolation() == "vertex" else values


@pytest.mark.parametrize(
    "prims",
    [
        (FLOOR,),
        (FLOOR, FOLD),
        (FLOOR, GROWING),
        (FLOOR, BALL),
        (FLOOR, BLINKING),
        (FLOOR, COLOURED),
        (FLOOR, TWO_COLOURS),
    ],
    ids=[
        "moving lamp",
        "crease that comes",
        "topology that changes",
        "growing gprim",
        "blinking",
        "one colour, then two",
        "two colours",
    ],
)
def test_each_frame_is_a_solve_at_its_time(tmp_path, prims):
    source = write(tmp_path, *prims)
    before = source.read_bytes()
    output = tmp_path / "bake.usda"
    result = isolux("solve", source, "-o", output, "--frames", "1:3", *BUDGET)
    assert result.exit_code == ExitCode.DONE, result.stderr
    assert source.read_bytes() == before
    stage = Usd.Stage.Open(str(output))
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1, 3)
    for frame in (1, 2, 3):
        solution = solved_at(source, frame)
        for mesh in solution.scene.meshes:
            baked = corner_values(stage, mesh.path, "isolux:illuminance", frame)
            np.testing.assert_array_equal(baked, solution.illuminance(mesh.path))
            assert len(corner_values(stage, mesh.path, "displayColor", frame)) == len(baked)
    if BLINKING in prims:
        assert (
            stage.GetPrimAtPath("/World/Blinking")
            .GetAttribute("primvars:isolux:illuminance")
            .Get(2)
            is None
        )


def test_a_deforming_subdivision_surface_keeps_its_values_by_point(tmp_path):
    """Values by corner would be interpolated by another rule."""
    source = write(tmp_path, FLOOR, FOLD.replace('"none"', '"catmullClark"'))
    isolux("solve", source, "-o", tmp_path / "bake.usda", "--frames", "1:3", *BUDGET)
    stage = Usd.Stage.Open(str(tmp_path / "bake.usda"))
    baked = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/World/Fold")).GetPrimvar("isolux:direct")
    assert (baked.GetInterpolation(), baked.IsIndexed()) == ("vertex", False)
    for frame in (1, 2, 3):
        alone = tmp_path / f"alone{frame}.usda"
        isolux("solve", source, "-o", alone, "--time", frame, *BUDGET)
        single = Usd.Stage.Open(str(alone))
        direct = single.GetAttributeAtPath("/World/Fold.primvars:isolux:direct")
        # The fit to the cage goes on from that of the stage before, if there was one.
        np.testing.assert_allclose(baked.Get(frame), direct.Get(2), rtol=1e-3)


def test_the_moving_lamp_moves_the_light(tmp_path):
    """Frames 1 and 3 mirror each other: the brighter side of the floor changes."""
    source = write(tmp_path, FLOOR)
    isolux("solve", source, "-o", tmp_path / "bake.usda", "--frames", "1:3:2", "--photons", 30000)
    stage = Usd.Stage.Open(str(tmp_path / "bake.usda"))
    left, right = (
        corner_values(stage, "/World/Floor", "isolux:illuminance", frame)[:, 0] for frame in (1, 3)
    )
    assert left[0] > 1.2 * left[1]
    np.testing.assert_allclose(left, right[[1, 0, 3, 2]], rtol=0.05)


def test_a_frame_that_fails_names_its_prim_and_the_others_go_on(tmp_path):
    bad = FLOOR.replace(
        "displayColor = [(0.6, 0.5, 0.4)]",
        "displayColor.timeSamples = { 1: [(1, 1, 1)], 2: [(3, 3, 3)], 3: [(1, 1, 1)] }",
    )
    source = write(tmp_path, bad)
    output = tmp_path / "bake.usda"
    result = isolux("solve", source, "-o", output, "--frames", "1:3", *BUDGET)
    assert result.exit_code == ExitCode.STAGE
    errors = [line for line in result.stderr.splitlines() if "error:" in line]
    assert len(errors) == 1
    assert errors[0].startswith("frame 2 (2/3): error: /World/Floor: found reflectance (3, 3, 3)")
    stage = Usd.Stage.Open(str(output))
    baked = stage.GetPrimAtPath("/World/Floor").GetAttribute("primvars:isolux:illuminance")
    assert [baked.Get(frame) is not None for frame in (1, 2, 3)] == [True, False, True]
    provenance, stages = read_report(output)
    assert provenance["frames"] == [1, 3]
    assert [stage.index for stage in stages] == [1, 3]


def test_a_shot_whose_frames_all_fail_writes_nothing(tmp_path):
    source = write(tmp_path, FLOOR.replace("(0.6, 0.5, 0.4)", "(3, 3, 3)"))
    result = isolux("solve", source, "-o", tmp_path / "bake.usda", "--frames", "1:2", *BUDGET)
    assert result.exit_code == ExitCode.STAGE
    assert sorted(path.name for path in tmp_path.iterdir()) == ["shot.usda"]


def test_a_frame_can_be_replayed_and_the_whole_can_not(tmp_path):
    source = write(tmp_path, FLOOR)
    output = tmp_path / "bake.usda"
    isolux("solve", source, "-o", output, "--frames", "1:2", "--photons", "20000")
    layer = tmp_path / "bake.frames" / "bake.0002.usdc"
    again = tmp_path / "again.usda"
    result = isolux("solve", source, "--replay", layer, "--time", 2, "-o", again)
    assert result.exit_code == ExitCode.DONE, result.stderr
    last = read_report(again)[1][-1].index
    np.testing.assert_array_equal(
        corner_values(Usd.Stage.Open(str(again)), "/World/Floor", "isolux:direct", last),
        corner_values(Usd.Stage.Open(str(output)), "/World/Floor", "isolux:direct", 2),
    )
    assert read_replay(layer)[0].photons == 20000
    result = isolux("solve", source, "--replay", output, "-o", again)
    assert result.exit_code == ExitCode.STAGE
    assert "results of many frames" in result.stderr


def test_the_frames_can_be_shown(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    source = write(tmp_path, FLOOR, BALL)
    isolux("solve", source, "-o", "bake.usda", "--frames", "1:3", *BUDGET)
    last = isolux("render", "bake.usda", "--width", 32, "--samples", 1)
    assert "stage 3" in last.stdout, last.stderr
    second = isolux("render", "bake.usda", "--time", 2, "--width", 32, "--samples", 1)
    assert "stage 2" in second.stdout, second.stderr
    assert "frames" in isolux("info", "bake.usda").stdout


def test_chosen_variants_and_a_report_a_frame_go_along(tmp_path):
    variants = f"""def Xform "Set" (
        variants = {{ string look = "none" }}
        prepend variantSets = "look"
    ) {{
        variantSet "look" = {{ "none" {{ }} "floor" {{ {FLOOR} }} }}
    }}
    """
    source = write(tmp_path, variants)
    output = tmp_path / "bake.usda"
    choice = "/World/Set:look=floor"
    result = isolux(
        "solve", source, "-o", output, "--frames", "1:2", "--variant", choice,
        "--report", tmp_path / "run.json", *BUDGET,
    )  # fmt: skip
    assert result.exit_code == ExitCode.DONE, result.stderr
    stage = Usd.Stage.Open(str(output))
    assert corner_values(stage, "/World/Set/Floor", "isolux:illuminance", 2).max() > 0
    assert {"run.0001.json", "run.0002.json"} < {path.name for path in tmp_path.iterdir()}


@pytest.mark.parametrize(
    ("text", "frames"),
    [
        ("1:3", [1, 2, 3]),
        ("1:3:2", [1, 3]),
        ("1:4:2", [1, 3]),
        ("-2:0", [-2, -1, 0]),
        ("5:5", [5]),
        ("0:0.3:0.1", [0, 0.1, 0.2, 0.3]),
        ("1.5:3", [1.5, 2.5]),
    ],
)
def test_frames_are_a_range_with_its_end(text, frames):
    assert parse_frames(text) == pytest.approx(frames)


@pytest.mark.parametrize(
    "text", ["", "1", "3:1", "1:2:0", "1:2:-1", "a:b", "1:2:3:4", "nan:2", "1:inf", "0:1e9", ":"]
)
def test_other_frames_are_a_wrong_option(text):
    with pytest.raises(SettingsError):
        parse_frames(text)


@pytest.mark.parametrize(
    "option", [("--time", 1), ("--replay", "x.usda"), ("--output-mode", "refined")]
)
def test_what_frames_can_not_be_combined_with(tmp_path, option):
    result = isolux("solve", write(tmp_path, FLOOR), "--frames", "1:2", *option)
    assert result.exit_code == ExitCode.USAGE
    assert "--frames" in result.stderr


def test_labels_sort_as_frames_do():
    assert [frame_label(f) for f in (1, 12, 101.5, 12345)] == ["0001", "0012", "0101.5", "12345"]


def test_ctrl_c_keeps_the_finished_frames(tmp_path):
    source = write(tmp_path, FLOOR)
    command = [sys.executable, "-m", "isolux", "solve", source, "-o", tmp_path / "bake.usda"]
    command += ["--frames", "1:50000", *BUDGET]
    run = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    until = clock.monotonic() + 20
    while not (tmp_path / "bake.frames/bake.0002.usdc").exists() and clock.monotonic() < until:
        clock.sleep(0.02)
    run.send_signal(signal.SIGINT)
    _, messages = run.communicate(timeout=20)
    assert run.returncode == ExitCode.INTERRUPTED
    assert "Traceback" not in messages
    frames = read_report(tmp_path / "bake.usda")[0]["frames"]
    assert len(frames) >= 2
    assert f"interrupted: {len(frames)} frames kept" in messages
    assert len(list((tmp_path / "bake.frames").iterdir())) == len(frames)
    stage = Usd.Stage.Open(str(tmp_path / "bake.usda"))
    assert corner_values(stage, "/World/Floor", "isolux:illuminance", frames[-1]).max() > 0
