"""Solve a stage and show each progressive stage, output modes vertex and refined side by side.

    python tools/stage_pictures.py STAGE SHEET.png [--time-budget S] [--camera PATH] [--width W]

Both modes show the same run: vertex mode leaves the light at the vertices of the adaptive mesh out.
All pictures have the exposure of the last, so that brightness can be compared.
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from contact_sheet import contact_sheet
from PIL import Image
from pxr import Usd

from isolux.atomic_file import replace_atomically
from isolux.colour import display_colours, log_average_exposure
from isolux.render import Picture, render_picture
from isolux.results import ResultsWriter
from isolux.settings import SolverSettings
from isolux.solution import ProgressiveStage, Solution
from isolux.solver import ProgressiveSolver
from isolux.stage_opening import open_stage
from isolux.stage_reader import read_stage

MODES = ("vertex", "refined")


def at_vertices(solution: Solution) -> Solution:
    """What vertex mode writes of a solution."""
    count = (
        len(solution.vertex_areas) if solution.refined is None else solution.refined.vertex_count
    )
    return replace(
        solution,
        refined=None,
        direct=solution.direct[:count],
        indirect=solution.indirect[:count],
        relative_deviation=solution.relative_deviation[:count],
        support_radius=solution.support_radius[:count],
        vertex_areas=solution.vertex_areas[:count],
    )


def solve(
    source: Path, settings: SolverSettings, clock: Callable[[], float], folder: Path
) -> list[ProgressiveStage]:
    """One run, written in both modes. returns : its progressive stages"""
    stage = open_stage(source)
    scene = read_stage(stage)
    writers = [ResultsWriter(stage, folder / f"{mode}.usda", scene, {}) for mode in MODES]
    stages = []
    for solution in ProgressiveSolver(scene, settings, clock).stages():
        writers[0].write(at_vertices(solution))
        writers[1].write(solution)
        stages.append(solution.stage)
    return stages


def caption(stages: Sequence[ProgressiveStage], i: int) -> str:
    """Two lines: what made a stage, and how good it is after how long."""
    stage = stages[i]
    made_by = f"{stage.index}   {stage.component}, {stage.elapsed:.2f} s"
    if stage.component == "DDL":
        if i == 0 or stages[i - 1].component != "DDL":
            made_by += f", from T1 = {stage.switchover_time:.2f} s"
        if stages[min(i + 1, len(stages) - 1)].component != "DDL":
            made_by += f", to T2 = {stage.second_switchover_time:.2f} s"
    error = "unknown" if math.isnan(stage.rms_error) else f"{100 * stage.rms_error:.3g} %"
    return f"{made_by}\nRMS error {error}, {stage.elements:,} triangles"


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("stage", type=Path)
    parser.add_argument("sheet", type=Path)
    parser.add_argument("--time-budget", type=float, default=20.0, help="s")
    parser.add_argument("--threads", type=int, default=0)
    parser.add_argument("--cpu-time", action="store_true", help="count the processor's seconds")
    parser.add_argument("--camera", help="prim path; else the first, or one framed on the interior")
    parser.add_argument("--width", type=int, default=480, help="pixels of each picture")
    parser.add_argument("--pairs", type=int, default=2, help="stages in a row of the sheet")
    options = parser.parse_args(arguments)

    settings = SolverSettings(method="composite", output_mode="refined", threads=options.threads)
    settings = settings.with_budget(time_budget=options.time_budget)
    clock = time.process_time if options.cpu_time else time.perf_counter
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        stages = solve(options.stage, settings, clock, folder)
        seen: dict[str, list[Picture]] = {}
        for mode in MODES:
            results = Usd.Stage.Open(str(folder / f"{mode}.usda"))
            seen[mode] = [
                render_picture(
                    results, camera=options.camera, time=float(stage.index), width=options.width
                )
                for stage in stages
            ]
    last = seen["refined"][-1]
    exposure = log_average_exposure(last.rgb, last.coverage)
    pictures, captions = [], []
    for i in range(len(stages)):
        for mode in MODES:
            picture = display_colours(seen[mode][i].rgb, exposure)
            pictures.append(Image.fromarray(picture))
            captions.append(f"{mode}: {caption(stages, i)}")
    sheet = contact_sheet(pictures, captions, 2 * min(options.pairs, len(stages)))
    with replace_atomically(options.sheet) as temporary:
        sheet.save(temporary, "PNG")


if __name__ == "__main__":
    main()
