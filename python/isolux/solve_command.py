"""The command `isolux solve`: one run from a stage to its results layer, with progress."""

from __future__ import annotations

import os
import shlex
import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from signal import Signals
from typing import TYPE_CHECKING, Any

from rich.console import Console

from . import __version__
from .dark_stages import warnings_of
from .display_view import DisplayView
from .errors import IsoluxError, SceneError, SettingsError
from .interrupt import StopRequest, stop_on_signal
from .preview_layer import preview_path, write_preview
from .progress import SolveProgress
from .report import PhaseSeconds, read_replay, write_report
from .results import ResultsWriter
from .scene_description import Finding, SceneDescription
from .schedule import StagePlan
from .settings import SolverSettings, override_settings, settings_from_stage
from .solution import ProgressiveStage
from .solver import ProgressiveSolver
from .stage_opening import AS_IT_STANDS, StageOpening
from .stage_reader import read_source
from .tables import findings_summary, new_console, percent, scene_summary, stage_table

if TYPE_CHECKING:
    from rich.progress import Progress


def solve_stage(
    source: Path,
    output: Path,
    options: dict[str, Any],
    time_code: float | None,
    report: Path | None,
    replay: Path | None = None,
    preview: bool = False,
    opening: StageOpening = AS_IT_STANDS,
) -> Signals | None:
    """Solve the stage at `source` and write each progressive stage to `output`.

    options : fields of SolverSettings that override the stage's own
    report : JSON file to write at the end
    replay : results of an earlier run, to be made again by its settings and counts
    preview : write the preview layer too
    opening : variants, payloads and part of the stage
    returns : the signal that ended the run early, after the stage in progress was written
    raises : IsoluxError; KeyboardInterrupt at a second signal
    """
    messages = new_console(stderr=True)
    # A wrong option fails before the stage is read.
    DisplayView.of(override_settings(SolverSettings(), options))
    require_output(output)
    if preview:
        require_place(preview_path(output))
    require_report(report)

    started = time.perf_counter()
    steps: tuple[StagePlan, ...] = ()
    recorded: SolverSettings | None = None
    solved_hash = ""
    if replay is not None:
        recorded, steps, solved_hash = _replayed(replay, options)
    stage, scene, settings = read_source(
        source,
        time_code,
        lambda opened: override_settings(recorded or settings_from_stage(opened), options),
        opening,
    )
    if replay is not None and solved_hash != scene.source_hash:
        messages.print(f"{replay}: the stage has changed since, so its light may differ")
    read_seconds = time.perf_counter() - started
    messages.print(f"{source}: {scene_summary(scene)}", soft_wrap=True)
    _print_findings(messages, scene, source)

    provenance = provenance_of(settings) | opening.record()
    writer = ResultsWriter(
        stage,
        output,
        scene,
        provenance,
        DisplayView.of(settings),
        settings.output_mode,
        settings.instances,
    )
    solver = ProgressiveSolver(scene, settings)
    with stop_on_signal() as stop:
        stages, write_seconds = _solve_and_write(solver, writer, output, stop, messages, steps)
        late_findings = solver.findings() + tuple(writer.findings)
        if preview and stages:
            late_findings += tuple(write_preview(output))
        if late_findings:
            messages.print(findings_summary(late_findings))
            print_warnings(messages, late_findings, source)
        seconds = PhaseSeconds(
            read=read_seconds,
            build=solver.build_seconds,
            solve=stages[-1].elapsed if stages else 0.0,
            write=write_seconds,
        )
        if report is not None:
            scene = replace(scene, findings=scene.findings + late_findings)
            write_report(report, scene, stages, provenance, seconds)
    _print_outcome(new_console(), output, stages, seconds, report)
    if preview and stages:
        new_console().print(f"preview: {preview_path(output)}", soft_wrap=True)
    if stop.signal is not None:
        messages.print(f"interrupted: {_kept(stages, output)}", soft_wrap=True)
    return stop.signal


def _replayed(
    results: Path, options: dict[str, Any]
) -> tuple[SolverSettings, tuple[StagePlan, ...], str]:
    """Settings, steps and source of an earlier run; only the threads may be given anew."""
    given = [name for name, value in options.items() if value is not None and name != "threads"]
    if given:
        names = ", ".join("--" + name.replace("_", "-") for name in given)
        raise SettingsError("--replay", f"{names} beside it", "no other setting than --threads")
    return read_replay(results)


def require_place(path: Path) -> None:
    """Raise SceneError where a file can't be written: before the work, not after."""
    if path.is_dir():
        raise SceneError(str(path), "a folder", "a file to write")
    if not (path.parent.is_dir() and os.access(path.parent, os.W_OK)):
        raise SceneError(str(path), f"no writable folder {path.parent}", "a file to write")


def require_output(path: Path) -> None:
    """Raise where results can't be written to a file of this name."""
    _require_suffix(path, (".usda", ".usd", ".usdc"))
    require_place(path)


def require_report(path: Path | None) -> None:
    """Raise where a report is wanted and can't be written."""
    if path is not None:
        _require_suffix(path, (".json",))
        require_place(path)


def _require_suffix(path: Path, suffixes: Sequence[str]) -> None:
    if path.suffix not in suffixes:
        raise SettingsError(str(path), f"the suffix '{path.suffix}'", " or ".join(suffixes))


def provenance_of(settings: SolverSettings) -> dict[str, Any]:
    """What is needed to make a run again."""
    return {
        "version": __version__,
        "seed": settings.seed,
        "threads": settings.threads or len(os.sched_getaffinity(0)),
        "settings": asdict(settings),
    }


def _solve_and_write(
    solver: ProgressiveSolver,
    writer: ResultsWriter,
    output: Path,
    stop: StopRequest,
    messages: Console,
    replay: Sequence[StagePlan],
) -> tuple[list[ProgressiveStage], float]:
    """The stages that were written, and the seconds of writing them."""
    stages: list[ProgressiveStage] = []
    write_seconds = 0.0
    try:
        with _StageDisplay(messages, solver.settings, stop) as display:
            for solution in solver.stages(display.update, lambda: stop.signal is not None, replay):
                started = time.perf_counter()
                writer.write(solution)
                write_seconds += time.perf_counter() - started
                stages.append(solution.stage)
                display.complete(solution.stage)
    except (IsoluxError, KeyboardInterrupt):
        messages.print(f"stopped: {_kept(stages, output)}", soft_wrap=True)
        raise
    return stages, write_seconds


class _StageDisplay:
    """A live line on a terminal; elsewhere a line a stage."""

    def __init__(self, console: Console, settings: SolverSettings, stop: StopRequest) -> None:
        self._console = console
        self._stop = stop
        bounded = settings.photons > 0 or settings.time_budget > 0
        self._of_stages = f"/{settings.stages}" if bounded else ""
        self._live: Progress | None = None

    def __enter__(self) -> _StageDisplay:
        if self._console.is_terminal:
            from rich.progress import BarColumn, Progress, TextColumn  # 0.01 s to load

            text = TextColumn("{task.description}")
            self._live = Progress(BarColumn(), text, console=self._console, transient=True)
            self._live.add_task("tracing the first photons", total=1.0)
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live:
            self._live.stop()

    def update(self, progress: SolveProgress) -> None:
        """Show how far the run has come."""
        if not self._live:
            return
        parts = [
            f"stage {progress.stage}{self._of_stages}",
            progress.component,
            f"{progress.photons:,} photons",
        ]
        if progress.rms_error is not None:
            parts.append(f"RMS error {percent(progress.rms_error)}")
        if self._stop.signal is not None:
            parts.append("finishing this stage")
        elif progress.time_left is not None:
            parts.append(f"{progress.time_left:.0f} s left")
        description = " · ".join(parts)
        (task,) = self._live.task_ids
        self._live.update(task, completed=progress.fraction, description=description)

    def complete(self, stage: ProgressiveStage) -> None:
        """Say that a stage is written."""
        if not self._live:
            self._console.print(
                f"stage {stage.index}{self._of_stages}: {stage.component}, "
                f"{stage.photons:,} photons, "
                f"RMS error {percent(stage.rms_error)}, {stage.elapsed:.2f} s",
                soft_wrap=True,
            )


def _print_findings(console: Console, scene: SceneDescription, source: Path) -> None:
    if scene.findings:
        console.print(findings_summary(scene.findings))
        console.print(f"reasons: isolux check {shlex.quote(str(source))}", soft_wrap=True)


def print_warnings(console: Console, findings: Iterable[Finding], source: Path) -> None:
    """Results without any light are told of aloud."""
    for warning in warnings_of(findings):
        console.print(f"warning: {source}: {warning}", soft_wrap=True)


def _print_outcome(
    console: Console,
    output: Path,
    stages: Sequence[ProgressiveStage],
    seconds: PhaseSeconds,
    report: Path | None,
) -> None:
    if stages:
        console.print(stage_table(stages))
        times = ", ".join(f"{phase} {taken:.2f} s" for phase, taken in asdict(seconds).items())
        console.print(times, soft_wrap=True)
        console.print(f"results: {output}", soft_wrap=True)
    if report is not None:
        console.print(f"report: {report}", soft_wrap=True)
    if stages:
        console.print(f"next: isolux render {shlex.quote(str(output))}", soft_wrap=True)


def _kept(stages: Sequence[ProgressiveStage], output: Path) -> str:
    if not stages:
        return "before the first stage; nothing written"
    return f"{len(stages)} {'stage' if len(stages) == 1 else 'stages'} kept in {output}"
