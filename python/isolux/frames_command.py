"""`isolux solve --frames`: one solution a frame of a shot, each in a layer of its own."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from pathlib import Path
from signal import Signals
from typing import Any

from pxr import Usd
from rich.console import Console

from .display_view import DisplayView
from .errors import IsoluxError, SettingsError
from .frames import FramesWriter, frame_label
from .interrupt import StopRequest, stop_on_signal
from .preview_layer import preview_path, write_preview
from .report import PhaseSeconds, write_report
from .scene_description import Finding
from .settings import SolverSettings, override_settings, settings_from_stage
from .solution import Solution
from .solve_command import (
    print_warnings,
    provenance_of,
    require_output,
    require_place,
    require_report,
)
from .solver import ProgressiveSolver
from .stage_opening import AS_IT_STANDS, StageOpening, open_stage
from .stage_reader import read_source
from .tables import findings_summary, new_console, percent, scene_summary

# A slip of the keyboard, not a shot: a day at 30 frames a second is 2.6 million.
MOST_FRAMES = 100_000


@dataclass(frozen=True, slots=True)
class FramesOutcome:
    """How a run over frames ended.

    failures : the error of each frame that could not be solved
    signal : that ended the run early; None: none did
    """

    failures: tuple[IsoluxError, ...]
    signal: Signals | None


def parse_frames(text: str) -> list[float]:
    """Time codes from "A:B" or "A:B:S", B included; raises SettingsError."""
    wanted = "A:B or A:B:S, finite, A no later than B, S above 0"
    try:
        numbers = [float(part) for part in text.split(":")]
    except ValueError:
        raise SettingsError("--frames", repr(text), wanted) from None
    if len(numbers) not in (2, 3) or not all(math.isfinite(number) for number in numbers):
        raise SettingsError("--frames", repr(text), wanted)
    first, last = numbers[:2]
    step = numbers[2] if len(numbers) == 3 else 1.0
    if step <= 0 or last < first:
        raise SettingsError("--frames", repr(text), wanted)
    # The last one is met although steps such as 0.1 are no binary fractions.
    count = math.floor((last - first) / step * (1 + 1e-12) + 1e-9) + 1
    if count > MOST_FRAMES:
        raise SettingsError("--frames", f"{count} frames", f"at most {MOST_FRAMES}")
    return [first + index * step for index in range(count)]


def solve_frames(
    source: Path,
    output: Path,
    options: dict[str, Any],
    frames: list[float],
    report: Path | None = None,
    opening: StageOpening = AS_IT_STANDS,
    preview: bool = False,
) -> FramesOutcome:
    """Solve a stage at each time code; a frame that fails doesn't end the run.

    options : fields of SolverSettings that override the stage's own
    report : one JSON file a frame, named after it
    preview : write the preview layer too
    raises : IsoluxError where the stage can't be opened or an option can't be
    """
    messages = new_console(stderr=True)
    DisplayView.of(override_settings(SolverSettings(), options))
    require_output(output)
    require_report(report)
    if preview:
        require_place(preview_path(output))
    stage = open_stage(source, opening)
    settings = override_settings(settings_from_stage(stage), options)
    if settings.output_mode != "vertex":
        raise SettingsError(
            "--frames", f"output_mode {settings.output_mode}", "vertex: frames share the meshes"
        )
    run = _Run(stage, source, output, settings, report, opening, messages)
    failures: list[IsoluxError] = []
    with stop_on_signal() as stop:
        for index, frame in enumerate(frames):
            label = f"frame {frame:g} ({index + 1}/{len(frames)})"
            try:
                finished = run.solve(frame, label, stop)
            except IsoluxError as error:
                messages.print(f"{label}: error: {error}", soft_wrap=True)
                failures.append(error)
                run.writer.leave_out(frame)
                continue
            if not finished:
                break
    if run.done:
        new_console().print(f"results: {output}, {run.done} frames", soft_wrap=True)
        if preview:
            run.tell(tuple(write_preview(output)))
            new_console().print(f"preview: {preview_path(output)}", soft_wrap=True)
    if stop.signal is not None:
        kept = f"{run.done} frames kept in {output}" if run.done else "nothing written"
        messages.print(f"interrupted: {kept}", soft_wrap=True)
    return FramesOutcome(tuple(failures), stop.signal)


class _Run:
    def __init__(
        self,
        stage: Usd.Stage,
        source: Path,
        output: Path,
        settings: SolverSettings,
        report: Path | None,
        opening: StageOpening,
        messages: Console,
    ) -> None:
        self._stage = stage
        self._source = source
        self._settings = settings
        self._report = report
        self._opening = opening
        self._messages = messages
        self._known: set[tuple[str, str, str]] = set()
        self.writer = FramesWriter(stage, output, settings)
        self.done = 0

    def solve(self, frame: float, label: str, stop: StopRequest) -> bool:
        """Solve and write one frame; False: stopped before it was finished, nothing written."""
        started = time.perf_counter()
        _, scene, _ = read_source(self._stage, frame, lambda _: self._settings)
        read_seconds = time.perf_counter() - started
        if not self._known and self.done == 0:
            self._messages.print(f"{self._source}: {scene_summary(scene)}", soft_wrap=True)
        self.tell(scene.findings)
        solver = ProgressiveSolver(scene, self._settings)
        solutions: list[Solution] = []
        stages = []
        for solution in solver.stages(None, lambda: stop.signal is not None):
            solutions = [solution]  # the last one is the frame's: the others go
            stages.append(solution.stage)
        if stop.signal is not None or not solutions:
            return False
        provenance = provenance_of(self._settings) | self._opening.record()
        started = time.perf_counter()
        clip = self.writer.write(frame, scene, solutions[0], provenance)
        seconds = PhaseSeconds(
            read_seconds, solver.build_seconds, stages[-1].elapsed, time.perf_counter() - started
        )
        late = solver.findings()
        self.tell(late)
        if self._report is not None:
            path = self._report.with_suffix(f".{frame_label(frame)}.json")
            scene = replace(scene, findings=scene.findings + late)
            write_report(path, scene, stages, provenance, seconds)
        last = stages[-1]
        self._messages.print(
            f"{label}: {clip.name}, {len(stages)} stages, {last.photons:,} photons, "
            f"RMS error {percent(last.rms_error)}, {last.elapsed:.2f} s",
            soft_wrap=True,
        )
        self.done += 1
        return True

    def tell(self, findings: tuple[Finding, ...]) -> None:
        """Those that no earlier frame had."""
        new = [f for f in findings if (f.path, f.kind, f.action) not in self._known]
        self._known |= {(f.path, f.kind, f.action) for f in new}
        if new:
            self._messages.print(findings_summary(new))
            print_warnings(self._messages, new, self._source)
