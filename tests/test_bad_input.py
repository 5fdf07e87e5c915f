"""What can't be solved: one line that names prim or file, an exit code, and nothing left behind."""

import shutil
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
from pxr import Usd
from typer.testing import CliRunner

from isolux.cli import ExitCode, app
from isolux.report import read_report
from small_room import FLOOR, LAMP, WALLS, write_room, write_stage

IES = Path(__file__).parents[1] / "usd_scenes" / "photometry" / "downlight.ies"
PHOTOMETRIC_LAMP = LAMP.replace(
    '"Lamp" {',
    '"Lamp" ( prepend apiSchemas = ["ShapingAPI"] ) {\n asset inputs:shaping:ies:file = @lamp.ies@',
)


def solve(source, *options, photons=1000):
    arguments = ["solve", str(source), "--photons", str(photons), *map(str, options)]
    return CliRunner().invoke(app, arguments)


def error_line(result):
    """The last line on stderr, the only one that says error."""
    *before, last = result.stderr.splitlines()
    assert last.startswith("error: ")
    assert not any(line.startswith("error") or "Traceback" in line for line in before)
    return last


@pytest.fixture
def here(tmp_path, monkeypatch):
    """An empty current folder; stages lie beside it."""
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


def moved(mesh, transform):
    operations = f"""
        matrix4d xformOp:transform = {transform}
        uniform token[] xformOpOrder = ["xformOp:transform"]
    }}
"""
    return mesh.rstrip().removesuffix("}") + operations


NAN_POINTS = FLOOR.replace("(2, 2, 0)", "(nan, 2, 0)")
SINGULAR = moved(FLOOR, "((1, 0, 0, 0), (0, 0, 0, 0), (0, 0, 0, 0), (0, 0, 0, 1))")
TOO_WHITE = FLOOR.replace(
    "point3f", "color3f[] primvars:displayColor = [(1.2, 1.2, 1.2)]\n point3f"
)

# Prims of the stage, exit code, what the error line tells, what the lines before it tell.
UNSOLVABLE = {
    "reflectance above 1": ([TOO_WHITE, LAMP], ExitCode.STAGE, ["/World/Floor", "1.2"], []),
}


@pytest.mark.parametrize("case", UNSOLVABLE)
@pytest.mark.parametrize("command", ["solve", "check"])
def test_stages_without_a_solution(here, case, command):
    prims, code, told, told_before = UNSOLVABLE[case]
    source = write_stage(here.parent / "stage.usda", *prims)
    result = CliRunner().invoke(app, [command, str(source)])
    assert result.exit_code == code
    assert all(words in error_line(result) for words in told)
    assert all(words in result.output for words in told_before)
    assert list(here.iterdir()) == []


@pytest.mark.parametrize("broken", [NAN_POINTS, SINGULAR])
def test_a_broken_mesh_among_others_is_skipped_by_name(here, broken):
    source = write_stage(here.parent / "stage.usda", broken, WALLS, LAMP)
    result = solve(source)
    assert result.exit_code == ExitCode.DONE
    (line,) = (line for line in result.stderr.splitlines() if "/World/Floor" in line)
    assert line.split()[0] == "skipped"


@pytest.mark.parametrize(
    ("name", "contents"),
    [
        ("missing.usda", None),
        ("text.usda", b"no stage at all"),
        ("noise.usdc", bytes(range(256))),
        ("half.usda", b'#usda 1.0\ndef Mesh "A" {\n    int[] faceVertexCounts = [4'),
        ("picture.png", b"\x89PNG"),
    ],
)
@pytest.mark.parametrize("command", ["solve", "check", "info", "render"])
def test_files_that_are_no_stage(here, name, contents, command):
    source = here.parent / name
    if contents is not None:
        source.write_bytes(contents)
    result = CliRunner().invoke(app, [command, str(source)])
    assert result.exit_code == ExitCode.STAGE
    assert name in error_line(result)
    assert list(here.iterdir()) == []


def absurd_angles(_):
    return IES.read_bytes().replace(b"1 1000 1 19 1 1 2", b"1 1000 1 1000000000 1000000000 1 2")


@pytest.mark.parametrize(
    ("case", "contents"),
    [
        ("missing", None),
        ("truncated", lambda ies: ies[: len(ies) // 2]),
        ("empty", lambda ies: b""),
        ("another format", lambda ies: b"\x89PNG\r\n\x1a\n" + bytes(1000)),
        ("absurd counts", absurd_angles),
        ("candela that are no numbers", lambda ies: ies.replace(b"355.62", b"nan")),
    ],
)
def test_photometric_files_that_cannot_be_used(here, case, contents):
    if contents is not None:
        (here.parent / "lamp.ies").write_bytes(contents(IES.read_bytes()))
    source = write_stage(here.parent / "stage.usda", FLOOR, PHOTOMETRIC_LAMP)
    started = time.monotonic()
    result = solve(source)
    assert result.exit_code == ExitCode.PHOTOMETRY
    assert "lamp.ies" in error_line(result)
    assert list(here.iterdir()) == []
    assert time.monotonic() - started < 5


def test_a_photometric_file_of_absurd_size(here):
    with (here.parent / "lamp.ies").open("wb") as file:
        file.truncate(1 << 34)  # takes no space on disk
    source = write_stage(here.parent / "stage.usda", FLOOR, PHOTOMETRIC_LAMP)
    result = solve(source)
    assert result.exit_code == ExitCode.PHOTOMETRY
    assert "lamp.ies" in error_line(result)


def test_a_name_that_is_no_utf_8(here):
    result = CliRunner().invoke(app, ["check", "\udcff.usda"])
    assert result.exit_code == ExitCode.USAGE
    assert "UTF-8" in result.stderr


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--time-budget", "5"], "--photons and --time-budget"),
        (["--target-error", "0.1"], "--photons and --target-error"),
        (["--seed", "-1"], "seed"),
        (["--stages", "0"], "stages"),
        (["--threads", "-2"], "threads"),
        (["-o", "out.png"], "out.png"),
        (["--report", "run.txt"], "run.txt"),
    ],
)
def test_options_that_cannot_be(here, options, told):
    result = solve(write_room(here.parent / "room.usda"), *options)
    assert result.exit_code == ExitCode.USAGE
    assert told in error_line(result)
    assert list(here.iterdir()) == []


def test_no_stopping_criterion_is_left_by_zero_photons(here):
    result = solve(write_room(here.parent / "room.usda"), photons=0)
    assert result.exit_code == ExitCode.USAGE
    assert "photons" in error_line(result)


def test_a_setting_on_the_stage_out_of_its_range(here):
    source = write_room(here.parent / "room.usda", "int isolux:stages = 0")
    result = CliRunner().invoke(app, ["check", str(source)])
    assert result.exit_code == ExitCode.USAGE
    assert "/Render.isolux:stages" in error_line(result)


@pytest.mark.parametrize("option", ["-o", "--report"])
@pytest.mark.parametrize("place", ["missing/out", "folder"])
def test_outputs_without_a_place_are_refused_before_solving(here, option, place):
    suffix = {"-o": ".usda", "--report": ".json"}[option]
    output = here.parent / f"{place}{suffix}"
    (here.parent / f"folder{suffix}").mkdir()
    result = solve(write_room(here.parent / "room.usda"), option, output, photons=10**12)
    assert result.exit_code == ExitCode.STAGE
    assert output.name in error_line(result)
    assert list(here.iterdir()) == []


def test_the_source_is_never_the_output(here):
    source = write_room(here / "room.usda")
    before = source.read_bytes()
    result = solve(source, "-o", "room.usda")
    assert result.exit_code == ExitCode.STAGE
    assert "room.usda" in error_line(result)
    assert source.read_bytes() == before
    assert list(here.iterdir()) == [source]


def test_results_are_no_source(here):
    assert solve(write_room(here / "room.usda")).exit_code == ExitCode.DONE
    result = solve("room.isolux.usda")
    assert result.exit_code == ExitCode.STAGE
    assert "room.isolux.usda" in error_line(result)
    assert not (here / "room.isolux.isolux.usda").exists()


def test_results_of_an_earlier_run_survive_an_error(here):
    source = write_room(here / "room.usda")
    solve(source)
    before = {path.name: path.read_bytes() for path in here.iterdir() if path != source}
    write_stage(source, TOO_WHITE, LAMP)
    assert solve(source).exit_code == ExitCode.STAGE
    assert {path.name: path.read_bytes() for path in here.iterdir() if path != source} == before


@pytest.mark.parametrize(
    ("options", "code", "told"),
    [
        (["--camera", "/World/Nobody"], ExitCode.STAGE, "/World/Nobody"),
        (["-o", "x.jpg"], ExitCode.USAGE, "x.jpg"),
        (["-o", "missing/x.png"], ExitCode.STAGE, "missing/x.png"),
        (["-o", "x.exr", "--exposure", "3"], ExitCode.USAGE, "x.exr"),
        (["--width", "0"], ExitCode.USAGE, "width"),
    ],
)
def test_pictures_that_cannot_be(here, options, code, told):
    solve(write_room(here / "room.usda"))
    before = sorted(here.iterdir())
    result = CliRunner().invoke(app, ["render", "room.isolux.usda", *options])
    assert result.exit_code == code
    assert told in error_line(result)
    assert sorted(here.iterdir()) == before


def test_a_stage_that_was_never_solved_gives_no_picture(here):
    write_room(here.parent / "room.usda")
    result = CliRunner().invoke(app, ["render", "../room.usda"])
    assert result.exit_code == ExitCode.STAGE
    assert "room.usda" in error_line(result)


@contextmanager
def mounted_disk(folder, options):
    """A file system of its own on `folder`; skips where that needs rights that we lack."""
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(folder)]
    if shutil.which("mount") is None or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("mounting a disk takes root")
    try:
        yield
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def test_a_read_only_disk_is_refused_before_solving(here):
    source = write_room(here.parent / "room.usda")
    with mounted_disk(here / "disk", "ro"):
        result = solve(source, "-o", "disk/out.usda", photons=10**12)
        assert result.exit_code == ExitCode.STAGE
        assert "disk/out.usda" in error_line(result)


@pytest.mark.parametrize("filled", [1.0, 0.95])
def test_a_disk_that_is_full_from_the_start_keeps_nothing(here, filled):
    source, disk = write_room(here.parent / "room.usda"), here / "disk"
    with mounted_disk(disk, "size=64k"):
        (disk / "filler").write_bytes(bytes(int(filled * 65536) // 4096 * 4096))
        result = solve(source, "-o", disk / "out.usda")
        assert result.exit_code == ExitCode.STAGE
        assert str(disk) in error_line(result)
        assert "nothing written" in result.stderr
        assert [path.name for path in disk.iterdir()] == ["filler"]


def test_a_disk_that_fills_up_keeps_the_stages_before(here):
    corners = [(x, y, 0) for i in range(0, 200, 2) for x in (i, i + 1) for y in (0, 1)]
    tiles = (
        FLOOR.replace("[4]", str([4] * 100))
        .replace("[0, 1, 2, 3]", str([i + j for i in range(0, 400, 4) for j in (0, 2, 3, 1)]))
        .replace("[(-2, -2, 0), (2, -2, 0), (2, 2, 0), (-2, 2, 0)]", str(corners))
    )
    source, disk = write_stage(here.parent / "tiles.usda", tiles, LAMP), here / "disk"
    with mounted_disk(disk, "size=64k"):
        result = solve(source, "-o", disk / "out.usda", photons=10**6)
        assert result.exit_code == ExitCode.STAGE
        assert str(disk / "out.results.usdc") in error_line(result)
        _, stages = read_report(disk / "out.usda")
        assert 1 <= len(stages) < 8
        assert f"stopped: {len(stages)} stage" in result.stderr
        assert sorted(path.name for path in disk.iterdir()) == ["out.results.usdc", "out.usda"]


def test_a_killed_run_leaves_its_last_complete_stage(here):
    write_room(here.parent / "room.usda")
    options = ["--photons", str(10**12), "--stages", "40"]
    run = subprocess.Popen(
        [sys.executable, "-m", "isolux", "solve", "../room.usda", *options],
        cwd=here,
        stderr=subprocess.PIPE,
        text=True,
    )
    until = time.monotonic() + 20
    while not (here / "room.isolux.usda").exists() and time.monotonic() < until:
        time.sleep(0.01)
    time.sleep(0.2)
    run.send_signal(signal.SIGKILL)
    _, messages = run.communicate(timeout=20)
    _, stages = read_report(here / "room.isolux.usda")
    announced = sum("RMS error" in line for line in messages.splitlines())
    assert len(stages) in (announced, announced + 1)
    opened = Usd.Stage.Open(str(here / "room.isolux.usda"))
    walls = opened.GetPrimAtPath("/World/Walls").GetAttribute("primvars:isolux:illuminance")
    assert walls.GetTimeSamples() == [stage.index for stage in stages]
    # Killed while writing, the file in the making stays behind, hidden and under no name of ours.
    shown = sorted(path.name for path in here.iterdir() if not path.name.startswith("."))
    assert shown == ["room.isolux.results.usdc", "room.isolux.usda"]
