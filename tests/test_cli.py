"""The command line as its user meets it: what is written, printed and returned."""

import json
import math
import signal
import subprocess
import sys
import time
from importlib.metadata import version

import numpy as np
import OpenEXR
import pytest
from PIL import Image
from pxr import Usd
from typer.testing import CliRunner

from isolux.cli import ExitCode, app
from isolux.output_fields import OUTPUT_FIELDS
from isolux.report import read_report
from small_room import FLOOR, LAMP, WALLS, write_room, write_stage


def isolux(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def illuminance(results, mesh, time):
    stage = Usd.Stage.Open(str(results))
    values = stage.GetPrimAtPath(mesh).GetAttribute("primvars:isolux:illuminance").Get(time)
    return np.array(values)


def names_in(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.fixture
def here(tmp_path, monkeypatch):
    """An empty current folder beside the folder of the room's stage."""
    (tmp_path / "scenes").mkdir()
    write_room(tmp_path / "scenes" / "room.usda")
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


@pytest.fixture
def solved(here):
    result = isolux("solve", "../scenes/room.usda", "--photons", 20000)
    assert result.exit_code == ExitCode.DONE, result.stderr
    return here / "room.isolux.usda"


def test_solve_writes_into_the_current_folder_and_says_what_comes_next(here):
    source = (here / "../scenes/room.usda").read_bytes()
    result = isolux("solve", "../scenes/room.usda", "--photons", 20000)
    assert result.exit_code == ExitCode.DONE
    assert names_in(here) == ["room.isolux.results.usdc", "room.isolux.usda"]
    assert result.stdout.endswith("next: isolux render room.isolux.usda\n")
    assert (here / "../scenes/room.usda").read_bytes() == source
    assert names_in(here / "../scenes") == ["room.usda"]


def test_solve_tells_what_it_read_and_each_stage(here):
    result = isolux(
        "solve", "../scenes/room.usda", "--method", "dept", "--photons", 20000, "--stages", 3
    )
    assert "2 meshes, 6 faces, 12 points, 1 luminaire, 394.8 lm" in result.stderr
    assert [line.split(", ")[0] for line in result.stderr.splitlines() if "RMS" in line] == [
        "stage 1/3: DEPT",
        "stage 2/3: DEPT",
        "stage 3/3: DEPT",
    ]
    for phase in ("read ", "build ", "solve ", "write "):
        assert phase in result.stdout


@pytest.mark.parametrize(
    ("name", "output"),
    [
        ("my room.usda", "my bake.usda"),
        ("Bücherei 図書館.usda", "sub/Ergebnis.usdc"),
        ("[bold]room.usda", "room.usd"),
    ],
)
@pytest.mark.parametrize("absolute", [False, True])
def test_any_name_will_do(here, name, output, absolute):
    (here / "sub").mkdir()
    source, output = write_room(here / name), here / output
    if not absolute:
        source, output = source.relative_to(here), output.relative_to(here)
    result = isolux("solve", source, "-o", output, "--photons", 2000)
    assert result.exit_code == ExitCode.DONE, result.stderr
    assert f"results: {output}\n" in result.stdout
    assert illuminance(output, "/World/Floor", 8.0).min() > 0


@pytest.mark.parametrize(
    ("settings", "options", "expected"),
    [
        ("", ["--photons", 1000], {"photons": 1000, "target_error": 0.0, "stages": 8}),
        ("", ["--target-error", 0.5], {"photons": 0, "target_error": 0.5}),
        ("", ["--time-budget", 0.1], {"time_budget": 0.1, "target_error": 0.0}),
        ("int64 isolux:photons = 700", [], {"photons": 700, "target_error": 0.05, "seed": 0}),
        (
            "int64 isolux:photons = 700\n int isolux:seed = 5\n int isolux:stages = 2",
            ["--time-budget", 0.1, "--stages", 3],
            {"photons": 0, "time_budget": 0.1, "seed": 5, "stages": 3},
        ),
        ("", ["--photons", 900, "--seed", 9, "--threads", 1], {"seed": 9, "threads": 1}),
    ],
)
def test_options_override_the_settings_of_the_stage(here, settings, options, expected):
    source = write_room(here / "set.usda", settings)
    result = isolux("solve", source, *options)
    assert result.exit_code == ExitCode.DONE, result.stderr
    provenance, _ = read_report(here / "set.isolux.usda")
    assert {name: provenance["settings"][name] for name in expected} == expected


def test_a_run_is_replayed_from_what_its_results_tell(here):
    timed = ["--method", "composite", "--time-budget", 0.2, "--stages", 4]
    isolux("solve", "../scenes/room.usda", *timed, "-o", "a.usda")
    isolux("solve", "../scenes/room.usda", "--replay", "a.usda", "--threads", 1, "-o", "b.usda")
    stages = [read_report(here / name)[1] for name in ("a.usda", "b.usda")]
    made = [[(s.component, s.photons, s.shadow_rays, s.rms_error) for s in run] for run in stages]
    assert made[0] == made[1]
    for stage in stages[0]:
        time = float(stage.index)
        a, b = (illuminance(here / name, "/World/Walls", time) for name in ("a.usda", "b.usda"))
        assert a.any()
        np.testing.assert_array_equal(a, b)


def test_a_replay_takes_no_other_settings(solved):
    result = isolux("solve", "../scenes/room.usda", "--replay", solved, "--seed", 3)
    assert result.exit_code == ExitCode.USAGE
    assert "--seed beside it" in result.stderr


def test_the_report_tells_the_run_and_what_was_not_taken_as_it_stands(here):
    skipped = '    def Points "Ball" {\n    }\n'
    inside_out = WALLS.replace('"Walls" {', '"Hull" {\n uniform token orientation = "leftHanded"')
    source = write_stage(here / "odd.usda", FLOOR, inside_out, LAMP, skipped)
    result = isolux("solve", source, "--photons", 20000, "--threads", 2, "--report", "run.json")
    assert result.exit_code == ExitCode.DONE, result.stderr
    report = json.loads((here / "run.json").read_text())
    assert (report["version"], report["seed"], report["threads"]) == (version("isolux"), 0, 2)
    assert set(report["seconds"]) == {"read", "build", "solve", "write"}
    stages = report["stages"]
    assert [stage["index"] for stage in stages] == list(range(1, len(stages) + 1))
    assert {"DEPT", "DDL"} < {stage["component"] for stage in stages}
    assert stages[-1]["switchover_photons"] <= stages[-1]["photons"] == 20000
    found = [(f["path"], f["kind"], f["action"]) for f in report["findings"]]
    assert ("/World/Ball", "Points", "skipped") in found
    assert ("/World/Hull", "orientation", "noted") in found  # only photons can tell
    for path, kind, action in found:
        assert any(
            line.split()[:3] == [action, kind, "1"] and line.split()[3] == path
            for line in result.stderr.splitlines()
        )


def test_a_summary_shows_the_first_few_of_many_findings(here):
    balls = [f'    def Points "Ball{i}" {{\n    }}\n' for i in range(5)]
    source = write_stage(here / "balls.usda", FLOOR, LAMP, *balls)
    summary = isolux("solve", source, "--photons", 1000).stderr
    assert "/World/Ball0, /World/Ball1, /World/Ball2, …" in summary
    assert f"reasons: isolux check {source}" in summary
    everything = isolux("check", source).stdout
    assert all(f"/World/Ball{i} " in everything for i in range(5))


def test_check_shows_what_would_be_read_and_writes_nothing(here):
    result = isolux("check", "../scenes/room.usda")
    assert result.exit_code == ExitCode.DONE
    lamp = next(line for line in result.stdout.splitlines() if "/World/Lamp" in line)
    assert lamp.split() == ["/World/Lamp", "sphere", "0.1", "394.8", "constant", "luminance"]
    assert "2 meshes, 6 faces, 12 points" in result.stdout
    assert names_in(here) == []


def test_check_and_the_report_count_prims_by_what_became_of_them(here):
    prims = (FLOOR, WALLS, LAMP, *(f'    def Points "P{i}" {{\n    }}\n' for i in range(3)))
    source = write_stage(here / "some.usda", *prims, '    def Sphere "Ball" {\n    }\n')
    shown = [line.split() for line in isolux("check", source).stdout.splitlines()]
    for row in (
        ["Mesh", "2", "–", "–", "–"],
        ["Points", "–", "3", "–", "–"],
        ["Sphere", "1", "–", "1", "–"],
        ["SphereLight", "1", "–", "–", "–"],
    ):
        assert row in shown
    isolux("solve", source, "--photons", 1000, "--report", "run.json")
    assert json.loads((here / "run.json").read_text())["prims"] == {
        "Mesh": {"read": 2},
        "Points": {"skipped": 3},
        "Sphere": {"read": 1, "approximated": 1},
        "SphereLight": {"read": 1},
    }


def test_info_tells_the_stages_from_the_file_itself(solved):
    (solved.parent / "../scenes/room.usda").unlink()
    result = isolux("info", solved)
    assert result.exit_code == ExitCode.DONE
    _, stages = read_report(solved)
    lines = [line.split() for line in result.stdout.splitlines()]
    for stage in stages:
        assert any(
            line[:3] == [str(stage.index), stage.component, f"{stage.photons:,}"] for line in lines
        )
    for field in OUTPUT_FIELDS:
        assert any(line[:2] == [field.name, field.unit] for line in lines)
    assert ["version", version("isolux")] in lines


def test_render_makes_a_png_in_the_current_folder_and_says_how(solved):
    result = isolux("render", solved, "--width", 64, "--samples", 1)
    assert result.exit_code == ExitCode.DONE, result.stderr
    with Image.open("room.isolux.png") as picture:
        assert picture.size == (64, 36)
        assert np.asarray(picture).std() > 1
    last = read_report(solved)[1][-1].index
    assert result.stdout.startswith(
        f"room.isolux.png: 64 × 36, camera framed on the interior, stage {last}, exposure "
    )


def test_render_keeps_cd_per_m2_in_an_exr(solved):
    result = isolux("render", solved, "-o", "x.exr", "--width", 32, "--time", 2)
    assert result.exit_code == ExitCode.DONE, result.stderr
    assert "stage 2, cd/m²" in result.stdout
    assert OpenEXR.File("x.exr").parts[0].channels["RGBA"].pixels.shape == (18, 32, 4)


def test_a_given_exposure_is_the_one_used(solved):
    result = isolux("render", solved, "--width", 32, "--exposure", 4.5)
    assert "exposure 4.50 EV" in result.stdout


def test_version_and_exit_codes_are_told():
    assert isolux("--version").stdout.startswith(f"isolux {version('isolux')} (USD ")
    told = " ".join(isolux("--help").stdout.split())
    for code in ExitCode:
        assert f" {code.value} " in told


def start_solve(folder, *options):
    """A run of its own that takes long enough to be interrupted, after its first stage."""
    command = [sys.executable, "-m", "isolux", "solve", "../scenes/room.usda", *options]
    run = subprocess.Popen(
        command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    until = time.monotonic() + 20
    while not (folder / "room.isolux.usda").exists() and time.monotonic() < until:
        time.sleep(0.02)
    return run


@pytest.mark.parametrize(
    ("sent", "code"),
    [(signal.SIGINT, ExitCode.INTERRUPTED), (signal.SIGTERM, ExitCode.TERMINATED)],
)
def test_an_interrupted_run_keeps_the_photons_traced_so_far(here, sent, code):
    run = start_solve(
        here, "--method", "dept", "--photons", str(10**12), "--stages", "30", "--report", "run.json"
    )
    time.sleep(0.3)
    run.send_signal(sent)
    _, messages = run.communicate(timeout=20)
    assert run.returncode == code
    _, stages = read_report(here / "room.isolux.usda")
    assert messages.endswith(f"interrupted: {len(stages)} stages kept in room.isolux.usda\n")
    assert "Traceback" not in messages
    last = stages[-1]
    assert stages[-2].photons < last.photons <= math.ceil(10**12 / 2 ** (30 - last.index))
    assert last.absorbed + last.back_absorbed + last.escaped == last.photons
    assert len(json.loads((here / "run.json").read_text())["stages"]) == len(stages)
    assert names_in(here) == ["room.isolux.results.usdc", "room.isolux.usda", "run.json"]


def test_a_reader_who_goes_away_causes_no_noise(here):
    command = f"{sys.executable} -m isolux check ../scenes/room.usda | true"
    done = subprocess.run(["sh", "-c", command], cwd=here, capture_output=True, timeout=20)
    assert (done.stdout, done.stderr) == (b"", b"")
