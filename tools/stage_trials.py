"""Put every stage of a folder through `isolux check` and `isolux solve`: a Markdown table.

    python tools/stage_trials.py FOLDER [--table README.md] [--time-budget S] [--timeout S]

Where there is a table with the columns `repository` and `path`, the stages are its rows, at
FOLDER/owner+name/path; else every USD file under FOLDER. Fails where a command hangs, dies of a
signal or shows a traceback.
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

SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
# As `isolux check` prints them: a finding; the summary of what was read.
FINDING = re.compile(r"^\s*/\S*\s+(skipped|approximated|repaired|noted)\s{2,}(\S.*?)\s{2,}", re.M)
SUMMARY = re.compile(r"([\d,]+) mesh(?:es)?, [\d,]+ faces?, ([\d,]+) points?, ([\d,]+) luminaires?")
COLUMNS = (
    "stage", "meshes", "points", "lights", "findings", "photons", "RMS error", "indirect",
    "seconds", "check", "solve", "message",
)  # fmt: skip


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
        """The error that the command told."""
        told = [line for line in self.errors.splitlines() if line.startswith("error: ")]
        return told[-1].removeprefix("error: ") if told else ""


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


def trial(stage: Path, name: str, time_budget: float, timeout: float) -> tuple[list[str], bool]:
    """One row of the table, and whether both commands behaved."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        check = run_isolux(timeout, "check", str(stage))
        solve = run_isolux(
            timeout, "solve", str(stage), "-o", f"{folder}/out.usda",
            "--time-budget", str(time_budget), "--report", str(report),
        )  # fmt: skip
        last = json.loads(report.read_text())["stages"][-1] if report.exists() else None

    summary = SUMMARY.search(check.output)
    findings = Counter(f"{action} {kind}" for action, kind in FINDING.findall(check.output))
    defect = check.defect or solve.defect
    message = f"**{defect}**" if defect else solve.message or check.message
    row = [
        name,
        *(summary.groups() if summary else ("–", "–", "–")),
        ", ".join(f"{count} {kind}" for kind, count in sorted(findings.items())) or "none",
        f"{last['photons']:,}" if last else "–",
        percent(last["rms_error"]) if last else "–",
        percent(last["rms_error_indirect"]) if last else "–",
        f"{solve.seconds:.1f}",
        str(check.exit_code),
        str(solve.exit_code),
        message.removeprefix(f"{stage}: ").replace("|", "\\|"),
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
        row, behaved = trial(stage, name, options.time_budget, options.timeout)
        print(f"| {' | '.join(row)} |", flush=True)
        failures += not behaved
    print(f"\n{len(stages)} stages, {failures} with a hang, a signal or a traceback")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
