"""Bias and variance of the solution against photons, by the path-traced reference.

    python tools/bias_and_variance.py STAGE... [--methods M,M] [--photons N,N] [--seeds S]
        [--threads N] [--cache FOLDER] [--tables FOLDER]

Each seed is a run of its own, stopped at so many photons. The mean of the runs differs from the
truth by the bias, the runs differ from their mean by the noise; both are relative RMS errors over
the area, of the total light. What the reference's own noise and the few seeds add to the bias is
taken away, so it may come out below what can be told, which stands beside it.

The slope is that of the RMS error in log-log between the first and the last count. With --tables
the two tables of the validation report are written.
"""

from __future__ import annotations

import argparse
import csv
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import get_args

import numpy as np
from bench_report import commit, cpu_name, print_table
from numpy.typing import NDArray
from reference import TOTAL, PathTracedReference, path_traced_reference

from isolux.core_scene import build_core_scene
from isolux.scene_description import SceneDescription
from isolux.settings import Method, SolverSettings
from isolux.solution import LUMINANCE_WEIGHTS
from isolux.solver import ProgressiveSolver
from isolux.stage_reader import read_stage

Array = NDArray[np.float64]
PHOTONS = (100, 1_000, 10_000, 100_000, 1_000_000)
SLOPE, FLOOR = -0.45, 0.005  # what is asked for: at most
# Of the reference, so that a bias of as much can be told.
BATCHES = 64


@dataclass(frozen=True, slots=True)
class Spread:
    """Of runs of as many photons; relative errors.

    rms : true error of a run
    bias, least_bias : of the mean of the runs; what is below the latter can't be told from 0
    noise : standard deviation of a run
    reported : error that the runs tell
    seconds : s of the processor, a run
    """

    scene: str
    method: str
    photons: int
    rms: float
    bias: float
    least_bias: float
    noise: float
    reported: float
    seconds: float


def spread(
    scene: SceneDescription, reference: PathTracedReference, settings: SolverSettings,
    seeds: int, name: str,
) -> Spread:  # fmt: skip
    """Runs of the first seeds."""
    values: list[Array] = []
    squares: list[float] = []
    started = time.process_time()
    for seed in range(seeds):
        solver = ProgressiveSolver(scene, replace(settings, seed=seed))
        *_, last = solver.stages()
        total = (last.direct + last.indirect)[reference.vertices]
        values.append(total @ LUMINANCE_WEIGHTS)
        squares.append(last.stage.rms_error**2)
    seconds = (time.process_time() - started) / seeds
    truth, truth_error = reference.luminance_pair(TOTAL)
    weights, mean = reference.weights, reference.mean(TOTAL)
    runs = np.array(values)
    variance = runs.var(axis=0, ddof=1)
    chance = truth_error**2 + variance / seeds
    bias = weights @ ((runs.mean(axis=0) - truth) ** 2 - chance)
    # The square that chance alone leaves varies by this much: χ² of one degree a vertex.
    least = np.sqrt(2 * weights**2 @ chance**2)
    rms = weights @ (((runs - truth) ** 2).mean(axis=0) - truth_error**2)

    def relative(square: float) -> float:
        return float(np.sqrt(max(0.0, square)) / mean)

    return Spread(
        scene=name,
        method=settings.method,
        photons=settings.photons,
        rms=relative(rms),
        bias=relative(bias),
        least_bias=relative(2 * least),
        noise=relative(weights @ variance),
        reported=float(np.sqrt(np.mean(squares))),
        seconds=seconds,
    )


@dataclass(frozen=True, slots=True)
class Convergence:
    """Of a method on a scene, over all counts of photons. bias : at the last one

    slope_by_seconds : of the RMS error, too; next to no photons still take the least rays a vertex
    """

    scene: str
    method: str
    slope: float
    slope_by_seconds: float
    bias: float
    least_bias: float

    @property
    def passed(self) -> bool:
        return self.slope <= SLOPE and self.bias <= max(FLOOR, self.least_bias)


def convergence(of: Sequence[Spread]) -> Convergence:
    first, last = of[0], of[-1]
    slope, by_seconds = (
        float(np.log(last.rms / first.rms) / np.log(ratio))
        for ratio in (last.photons / first.photons, last.seconds / first.seconds)
    )
    return Convergence(first.scene, first.method, slope, by_seconds, last.bias, last.least_bias)


def write_table(path: Path, prose: str, rows: Sequence[dict[str, str]]) -> None:
    """As the validation report takes it: prose behind #, then CSV."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        file.writelines(f"# {line}\n" for line in prose.splitlines())
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def write_tables(folder: Path, spreads: Sequence[Spread], ends: Sequence[Convergence],
                 seeds: int) -> None:  # fmt: skip
    origin = {"seeds": str(seeds), "commit": commit(), "machine": cpu_name()}
    write_table(
        folder / "convergence.csv",
        f"Slope of the RMS error against photons (asked: at most {SLOPE}); against seconds of the "
        "processor, as next to no photons still take the least rays; and the bias left at the "
        f"last count (asked: at most {FLOOR:.1%}, or what can't be told from 0).\n"
        "`python tools/bias_and_variance.py`",
        [
            {
                "scene": end.scene, "method": end.method, "slope": f"{end.slope:.2f}",
                "slope by seconds": f"{end.slope_by_seconds:.2f}",
                "bias": f"{end.bias:.2%}", "least bias told": f"{end.least_bias:.2%}",
                **origin, "pass": "yes" if end.passed else "no",
            }
            for end in ends
        ],
    )  # fmt: skip
    write_table(
        folder / "convergence_by_photons.csv",
        "Bias and noise by the number of photons, relative RMS errors of the total light.",
        [
            {
                name: f"{value:.4g}" if isinstance(value, float) else str(value)
                for name, value in asdict(row).items()
            } | origin
            for row in spreads
        ],
    )  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("stages", nargs="+", type=Path)
    parser.add_argument("--methods", default="composite", help=",".join(get_args(Method)))
    parser.add_argument("--photons", default=",".join(map(str, PHOTONS)))
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--threads", type=int, default=0)
    parser.add_argument("--cache", type=Path, default=Path("build/references"))
    parser.add_argument("--tables", type=Path, help="folder")
    arguments = parser.parse_args()
    counts = [int(count) for count in arguments.photons.split(",")]
    spreads: list[Spread] = []
    ends: list[Convergence] = []
    for stage in arguments.stages:
        scene = read_stage(stage)
        core = build_core_scene(scene, SolverSettings(), -1)
        reference = path_traced_reference(scene, core, batches=BATCHES, cache=arguments.cache)
        for method in arguments.methods.split(","):
            of: list[Spread] = []
            for photons in counts:
                settings = SolverSettings(method=method, threads=arguments.threads)
                of.append(
                    spread(scene, reference, settings.with_budget(photons=photons),
                           arguments.seeds, stage.stem)
                )  # fmt: skip
                print(of[-1], flush=True)
            spreads += of
            ends.append(convergence(of))
    rows = [
        [
            row.scene, row.method, f"{row.photons:,}", f"{row.rms:.2%}", f"{row.bias:.2%}",
            f"{row.least_bias:.2%}", f"{row.noise:.2%}", f"{row.reported:.2%}",
            f"{row.seconds:.1f}",
        ]
        for row in spreads
    ]  # fmt: skip
    columns = ["scene", "method", "photons", "RMS", "bias", "least told", "noise", "reported", "s"]
    print_table(f"Bias and noise of {arguments.seeds} runs", columns, rows)
    for end in ends:
        print(f"{end.scene}, {end.method}: slope {end.slope:.2f}, by seconds "
              f"{end.slope_by_seconds:.2f}, bias {end.bias:.2%}, "
              f"{'passes' if end.passed else 'fails'}")  # fmt: skip
    if arguments.tables:
        write_tables(arguments.tables, spreads, ends, arguments.seeds)


if __name__ == "__main__":
    main()
