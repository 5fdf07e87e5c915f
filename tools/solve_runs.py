"""Runs of the solver with a watch in hand: the command as a user starts it, and its phases."""

from __future__ import annotations

import compileall
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import isolux
from isolux.report import read_report
from isolux.results import ResultsWriter
from isolux.settings import SolverSettings
from isolux.solver import ProgressiveSolver
from isolux.stage_opening import open_stage
from isolux.stage_reader import read_stage


def seconds_of(work: Callable[[], object]) -> float:
    started = time.perf_counter()
    work()
    return time.perf_counter() - started


@dataclass(frozen=True, slots=True)
class Run:
    """`isolux solve` as a user starts it.

    appeared : s from the start of the process to each progressive stage on disk
    seconds : s, of the whole process
    peak_memory : bytes, resident
    errors, errors_indirect : RMS error of each stage, as reported
    """

    appeared: list[float]
    seconds: float
    peak_memory: int
    errors: list[float]
    errors_indirect: list[float]

    def seconds_to(self, error: float, errors: Sequence[float]) -> float | None:
        """When results with an error below the given one were on disk; None for never."""
        times = zip(self.appeared, errors, strict=False)
        return next((seconds for seconds, reached in times if reached < error), None)


def peak_resident(pid: int) -> int:
    """Bytes so far; 0 once the process has ended.

    The resource usage of a child counts what its parent held when it started it.
    """
    status = Path(f"/proc/{pid}/status")
    try:
        lines = status.read_text(encoding="utf-8").splitlines()
    except (FileNotFoundError, ProcessLookupError):
        return 0
    return next((int(line.split()[1]) * 1024 for line in lines if line.startswith("VmHWM")), 0)


def run_solve(stage: Path, bound: str, threads: int, folder: Path) -> Run:
    """Run the command and watch each progressive stage replace the results on disk.

    bound : the option that ends it, such as --time-budget=5
    """
    # As pip leaves an installed package: in a checkout Python may not be let keep its bytecode.
    compileall.compile_dir(Path(isolux.__file__).parent, quiet=1)
    output = folder / f"{stage.stem}.isolux.usda"
    output.unlink(missing_ok=True)
    command = [
        sys.executable, "-m", "isolux", "solve", str(stage), "-o", str(output),
        bound, "--threads", str(threads),
    ]  # fmt: skip
    appeared: list[float] = []
    seen, peak_memory, running = 0, 0, True
    started = time.perf_counter()
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as process:
        while running:
            running = process.poll() is None
            peak_memory = max(peak_memory, peak_resident(process.pid))
            written = output.stat().st_mtime_ns if output.exists() else 0
            if written != seen:
                appeared.append(time.perf_counter() - started)
                seen = written
            time.sleep(0.002)
        if process.returncode != 0:
            raise SystemExit(process.stderr.read().decode() if process.stderr else "solve failed")
    seconds = time.perf_counter() - started
    _, stages = read_report(output)
    return Run(
        appeared,
        seconds,
        peak_memory,
        [stage.rms_error for stage in stages],
        [stage.rms_error_indirect for stage in stages],
    )


def phase_seconds(path: Path, budget: float, threads: int, folder: Path) -> dict[str, float]:
    """Wall time of each phase of a run of the composite, s.

    The solver's are those of its stages; a finer pass over direct light, which is no stage of its
    own, counts with the gather that follows it.
    """
    started = time.perf_counter()
    stage = open_stage(path)
    scene = read_stage(stage)
    read = time.perf_counter() - started
    settings = SolverSettings(threads=threads).with_budget(time_budget=budget)
    solver = ProgressiveSolver(scene, settings)
    writer = ResultsWriter(stage, folder / "phases.usda", scene, {})
    solving = {"DEPT": 0.0, "DDL": 0.0, "gather": 0.0}
    writing = elapsed = 0.0
    for solution in solver.stages():
        solving[solution.stage.component] += solution.stage.elapsed - elapsed
        elapsed = solution.stage.elapsed
        writing += seconds_of(lambda: writer.write(solution))  # noqa: B023
    return {
        "read": read,
        "build": solver.build_seconds,
        "photons and filter": solving["DEPT"],
        "direct light": solving["DDL"],
        "gather": solving["gather"],
        "write": writing,
    }
