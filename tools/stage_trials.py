"""Put every stage of a folder through `isolux check` and `isolux solve`: a Markdown table.

    python tools/stage_trials.py FOLDER [--table README.md] [--time-budget S] [--timeout S]
                                 [--light] [--pictures FOLDER]

Where there is a table with the columns `repository` and `path`, the stages are its rows, at
FOLDER/owner+name/path; else every USD file under FOLDER. With --light, a stage without a luminaire
is laid under one with a dome and a sphere of light inside its bounds, and solved as that one. With
--pictures, the results are opened again by `isolux info` and `isolux render`. Fails where a command
hangs, dies of a signal or shows a traceback.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux

SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
# As `isolux check` prints them: a finding; the summary of what was read.
FINDING = re.compile(r"^\s*/\S*\s+(skipped|approximated|repaired|noted)\s{2,}(\S.*?)\s{2,}", re.M)
SUMMARY = re.compile(r"([\d,]+) mesh(?:es)?, [\d,]+ faces?, ([\d,]+) points?, ([\d,]+) luminaires?")
COLUMNS = (
    "stage",
    "meshes",
    "points",
    "lights",
    "findings",
    "photons",
    "RMS error",
    "indirect",
    "seconds",
    "check",
    "solve",
    "picture",
    "message",
)
# cd/m² of the dome and of the sphere; of a sphere's radius, its height and the least height of
# bounds that are more than a floor, in diagonals of the bounds.
DOME_LUMINANCE, SPHERE_LUMINANCE = 100.0, 20_000.0
SPHERE_RADIUS, SPHERE_HEIGHT, FLAT = 0.02, 0.8, 0.05
PICTURE_WIDTH = 480  # fmt: skip


@dataclass(frozen=True, slots=True)
class Ending:
    """How a command ended.

    exit_code : of the process; negative for a signal; None where it passed the timeout
    seconds : wall time
    """

    exit_code: int | None
    seconds: float
    output: str
    errors: str

    @property
    def defect(self) -> str | None:
        """What no command should ever do."""
        if self.exit_code is None:
            return "HANG"
        if "Traceback" in self.errors:
            return "TRACEBACK " + self.errors.strip().splitlines()[-1]
        return f"SIGNAL {-self.exit_code}" if self.exit_code < 0 else None

    @property
    def message(self) -> str:
        """The error that the command told, else its warning that there is no light."""
        for kind in ("error: ", "warning: "):
            told = [line for line in self.errors.splitlines() if line.startswith(kind)]
            if told:
                return told[-1].removeprefix(kind)
        return ""


def run_isolux(timeout: float, *arguments: str) -> Ending:
    """Run `isolux` in a process of its own, which does not outlive the timeout."""
    started = time.perf_counter()
    try:
        done = subprocess.run(
            [sys.executable, "-m", "isolux", *arguments],
            capture_output=True,
            text=True,
            errors="replace",
            timeout=timeout,
        )
    except subprocess.TimeoutExpired:
        return Ending(None, time.perf_counter() - started, "", "")
    return Ending(done.returncode, time.perf_counter() - started, done.stdout, done.stderr)


def listed_stages(table: Path, folder: Path) -> list[Path]:
    """Stages of the Markdown table with the columns `repository` and `path`."""
    stages: list[Path] = []
    columns: list[str] = []
    for line in table.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip().strip("`") for cell in line.strip().strip("|").split("|")]
        if {"repository", "path"} <= set(cells):
            columns = cells
        elif columns and len(cells) == len(columns) and not set(cells[0]) <= set("-: "):
            row = dict(zip(columns, cells, strict=True))
            stages.append(folder / row["repository"].replace("/", "+") / row["path"])
    return stages


def lit(stage: Path, path: Path) -> Path:
    """Write a stage with the other as its sublayer, and light in it."""
    source = Usd.Stage.Open(str(stage))
    layer = Sdf.Layer.CreateNew(str(path))
    layer.subLayerPaths.append(str(stage))
    opened = Usd.Stage.Open(layer)
    UsdGeom.SetStageMetersPerUnit(opened, UsdGeom.GetStageMetersPerUnit(source))
    UsdGeom.SetStageUpAxis(opened, UsdGeom.GetStageUpAxis(source))
    for name in ("startTimeCode", "endTimeCode", "timeCodesPerSecond", "framesPerSecond"):
        if source.HasAuthoredMetadata(name):
            opened.SetMetadata(name, source.GetMetadata(name))
    purposes = [UsdGeom.Tokens.default_, UsdGeom.Tokens.render]
    bounds = UsdGeom.BBoxCache(Usd.TimeCode.EarliestTime(), purposes, True)
    box = bounds.ComputeWorldBound(opened.GetPseudoRoot()).ComputeAlignedRange()
    low, high = np.array(box.GetMin()), np.array(box.GetMax())
    if box.IsEmpty() or not np.isfinite([low, high]).all():
        low, high = np.full(3, -1.0), np.full(3, 1.0)
    up = "XYZ".index(str(UsdGeom.GetStageUpAxis(opened)))
    diagonal = float(np.linalg.norm(high - low))
    place = (low + high) / 2
    height = high[up] - low[up]
    rise = SPHERE_HEIGHT * height if height > FLAT * diagonal else FLAT * 4 * diagonal
    place[up] = low[up] + rise
    dome = UsdLux.DomeLight.Define(opened, "/TrialLight/Dome")
    dome.CreateIntensityAttr(DOME_LUMINANCE)
    sphere = UsdLux.SphereLight.Define(opened, "/TrialLight/Sphere")
    sphere.CreateIntensityAttr(SPHERE_LUMINANCE)
    sphere.CreateRadiusAttr(SPHERE_RADIUS * diagonal)
    sphere.AddTranslateOp().Set(Gf.Vec3d(*map(float, place)))
    layer.Save()
    return path


def picture(results: Path, path: Path, timeout: float) -> tuple[str, str | None]:
    """Open results again, as text and as a picture: how that ended, and what should not be."""
    info = run_isolux(timeout, "info", str(results))
    path.parent.mkdir(parents=True, exist_ok=True)
    render = run_isolux(
        timeout, "render", str(results), "-o", str(path), "--width", str(PICTURE_WIDTH)
    )
    ended = "" if info.exit_code == 0 else f"info {info.exit_code}: {info.message} "
    ended += "0" if render.exit_code == 0 else f"{render.exit_code}: {render.message}"
    return ended.replace("|", "\\|"), info.defect or render.defect


def trial(stage: Path, name: str, options: argparse.Namespace) -> tuple[list[str], bool]:
    """One row of the table, and whether all commands behaved."""
    timeout = options.timeout
    with tempfile.TemporaryDirectory() as folder:
        report, results = Path(folder) / "report.json", Path(folder) / "out.usda"
        check = run_isolux(timeout, "check", str(stage))
        summary = SUMMARY.search(check.output)
        dark = options.light and summary is not None and summary.group(3) == "0"
        solved = lit(stage, Path(folder) / "lit.usda") if dark else stage
        solve = run_isolux(
            timeout, "solve", str(solved), "-o", str(results),
            "--time-budget", str(options.time_budget), "--report", str(report),
        )  # fmt: skip
        last = json.loads(report.read_text())["stages"][-1] if report.exists() else None
        shown, shown_defect = "–", None
        if options.pictures and results.exists():
            file = options.pictures / (name.replace("/", "+") + ".png")
            shown, shown_defect = picture(results, file, timeout)

    findings = Counter(f"{action} {kind}" for action, kind in FINDING.findall(check.output))
    defect = check.defect or solve.defect or shown_defect
    message = f"**{defect}**" if defect else solve.message or ("" if dark else check.message)
    row = [
        name + (" (lit)" if dark else ""),
        *(summary.groups() if summary else ("–", "–", "–")),
        ", ".join(f"{count} {kind}" for kind, count in sorted(findings.items())) or "none",
        f"{last['photons']:,}" if last else "–",
        percent(last["rms_error"]) if last else "–",
        percent(last["rms_error_indirect"]) if last else "–",
        f"{solve.seconds:.1f}",
        str(check.exit_code),
        str(solve.exit_code),
        shown,
        message.removeprefix(f"{solved}: ").replace("|", "\\|"),
    ]
    return row, defect is None


def percent(ratio: float | None) -> str:
    """A relative error; None where it isn't finite, 0 where there is no such light."""
    return f"{ratio:.2%}" if ratio else "–"


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--table", type=Path, help="else README.md in FOLDER or above it, if any")
    parser.add_argument("--time-budget", type=float, default=5.0, metavar="S")
    parser.add_argument("--timeout", type=float, default=120.0, metavar="S", help="of each command")
    parser.add_argument("--light", action="store_true", help="light stages without a luminaire")
    parser.add_argument("--pictures", type=Path, metavar="FOLDER", help="for a picture of each")
    options = parser.parse_args(arguments)

    folder = options.folder.resolve()
    readmes = [path / "README.md" for path in (folder, folder.parent)]
    table = options.table or next((path for path in readmes if path.is_file()), None)
    stages = listed_stages(table, folder) if table else []
    if not stages:
        stages = sorted(path for path in folder.rglob("*") if path.suffix in SUFFIXES)

    print(f"| {' | '.join(COLUMNS)} |\n|{'---|' * len(COLUMNS)}")
    failures = 0
    for stage in stages:
        name = str(stage.relative_to(folder))
        row, behaved = trial(stage, name, options)
        print(f"| {' | '.join(row)} |", flush=True)
        failures += not behaved
    print(f"\n{len(stages)} stages, {failures} with a hang, a signal or a traceback")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
