"""A stage without light or without meshes solves to zeros, and every command says so."""

import json

import numpy as np
import pytest
from pxr import Usd
from typer.testing import CliRunner

from isolux.cli import ExitCode, app
from small_room import FLOOR, LAMP, write_stage
from usda_stage import METRES

SINGULAR = FLOOR.rstrip().removesuffix("}") + (
    "matrix4d xformOp:transform = ((1, 0, 0, 0), (0, 0, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))\n"
    'uniform token[] xformOpOrder = ["xformOp:transform"]\n}\n'
)
NAN_POINTS = FLOOR.replace("(2, 2, 0)", "(nan, 2, 0)")
OFF = LAMP.replace("intensity = 1000", "intensity = 0")

# Prims, what the warning says, prims that have results.
DARK = {
    "no lights": ([FLOOR], ["no luminaire"], ["/World/Floor"]),
    "a light that is off": ([FLOOR, OFF], ["no luminaire", "SphereLight"], ["/World/Floor"]),
    "no meshes": ([LAMP], ["no visible mesh"], []),
    "nothing": ([], ["no visible mesh", "no luminaire"], []),
    "NaN points in the only mesh": ([NAN_POINTS, LAMP], ["no visible mesh", "skipped: Mesh"], []),
    "no transform of the only mesh": ([SINGULAR, LAMP], ["no visible mesh", "skipped: Mesh"], []),
}


def isolux(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def warning_of(result):
    assert result.exit_code == ExitCode.DONE, result.stderr
    (warning,) = (line for line in result.stderr.splitlines() if line.startswith("warning: "))
    return warning


@pytest.mark.parametrize("case", DARK)
@pytest.mark.parametrize("mode", ["vertex", "refined"])
def test_results_are_zero_and_a_warning_says_why(tmp_path, case, mode):
    prims, told, baked = DARK[case]
    source, output = write_stage(tmp_path / "stage.usda", *prims), tmp_path / "out.usda"
    report = tmp_path / "report.json"
    result = isolux("solve", source, "-o", output, "--output-mode", mode, "--report", report)
    assert all(words in warning_of(result) for words in (*told, "stage.usda"))
    stage = Usd.Stage.Open(str(output))
    illuminance = {
        str(prim.GetPath()): np.array(prim.GetAttribute("primvars:isolux:illuminance").Get(1.0))
        for prim in stage.Traverse()
        if prim.HasAttribute("primvars:isolux:illuminance")
    }
    assert list(illuminance) == baked
    assert all(values.size and not values.any() for values in illuminance.values())
    findings = json.loads(report.read_text())["findings"]
    assert ("/", "dark stage") in [(finding["path"], finding["kind"]) for finding in findings]
    assert isolux("info", output).exit_code == ExitCode.DONE


@pytest.mark.parametrize("case", DARK)
def test_a_check_says_what_a_solve_will_lack(tmp_path, case):
    prims, told, _ = DARK[case]
    result = isolux("check", write_stage(tmp_path / "stage.usda", *prims))
    assert all(words in warning_of(result) for words in told)
    assert "dark stage" in result.stdout


def test_a_run_without_light_can_be_replayed(tmp_path):
    source = write_stage(tmp_path / "stage.usda", FLOOR)
    assert isolux("solve", source, "-o", tmp_path / "a.usda").exit_code == ExitCode.DONE
    again = isolux("solve", source, "--replay", tmp_path / "a.usda", "-o", tmp_path / "b.usda")
    assert "no luminaire" in warning_of(again)


def test_a_shot_is_dark_until_its_light_comes_on(tmp_path):
    source = tmp_path / "shot.usda"
    lamp = LAMP.replace("intensity = 1000", "intensity.timeSamples = { 1: 0, 2: 1000, 3: 0 }")
    source.write_text(f"#usda 1.0\n{METRES}{FLOOR}{lamp}")
    output = tmp_path / "bake.usda"
    result = isolux(
        "solve", source, "-o", output, "--frames", "1:3", "--photons", 1000, "--stages", 1
    )
    assert "no luminaire" in warning_of(result)  # once
    stage = Usd.Stage.Open(str(output))
    baked = stage.GetPrimAtPath("/Floor").GetAttribute("primvars:isolux:illuminance")
    assert [np.any(baked.Get(frame)) for frame in (1, 2, 3)] == [False, True, False]


def test_an_unlit_stage_gives_a_picture(tmp_path):
    source, output = write_stage(tmp_path / "stage.usda", FLOOR), tmp_path / "out.usda"
    assert isolux("solve", source, "-o", output).exit_code == ExitCode.DONE
    picture = tmp_path / "picture.png"
    assert isolux("render", output, "-o", picture, "--width", 32).exit_code == ExitCode.DONE
    assert picture.stat().st_size > 0
