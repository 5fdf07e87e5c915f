"""Speed against error of the solver's methods, by the path-traced reference.

    python tools/method_curves.py STAGE... [--methods M,M] [--seeds N] [--time-budget S]
        [--threads N] [--filter-accuracy A] [--cpu-time] [--csv FILE] [--figure FILE]
        [--cache FOLDER]
    python tools/method_curves.py --from CSV [--figure FILE]

Prints where the composite is above the lower envelope of the other methods by more than 10 %, the
times to 5 % and 2 % with the share of each component, and how well the methods agree on the
indirect light in the end. With --cpu-time seconds are those of the processor: on one thread, what a
machine without other work would need.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
from bench_report import commit, cpu_name, print_table
from convergence import (
    CurvePoint,
    error_curve,
    errors_at,
    plot_curve,
    read_curve,
    runs,
    seconds_to,
    write_curve,
)
from reference import INDIRECT, REFERENCE_NOISE, TOTAL, path_traced_reference

from isolux.core_scene import build_core_scene
from isolux.settings import Method, SolverSettings
from isolux.stage_reader import read_stage

METHODS: tuple[Method, ...] = ("composite", "dept", "ddl+idept", "ddl+hpr")
GOALS = (0.05, 0.02)
WITHIN = 1.1  # of the lower envelope


def measure(
    stages: Sequence[Path],
    methods: Sequence[Method],
    seeds: int,
    settings: SolverSettings,
    cpu_time: bool,
    cache: Path,
) -> list[CurvePoint]:
    """Runs of every method and seed, the methods in turns."""
    clock = time.process_time if cpu_time else time.perf_counter
    points: list[CurvePoint] = []
    for stage in stages:
        scene = read_stage(stage)
        core = build_core_scene(scene, settings, -1)
        reference = path_traced_reference(scene, core, noise=REFERENCE_NOISE, cache=cache)
        print(
            f"{stage.stem}: {core.element_count:,} triangles, {core.vertex_count:,} vertices; "
            f"reference noise {reference.noise(TOTAL):.1%}, indirect "
            f"{reference.noise(INDIRECT):.1%}",
            flush=True,
        )
        for seed in range(seeds):
            for method in methods:
                of_run = replace(settings, method=method, seed=seed)
                points += error_curve(stage.stem, scene, reference, of_run, clock)
                print(f"  {method}, seed {seed}: {points[-1].true_error:.2%}", flush=True)
    return points


def print_curves(points: Sequence[CurvePoint]) -> None:
    """The progressive stages of the first seed."""
    rows = [
        [
            point.scene, point.method, point.component,
            f"{point.build_seconds + point.seconds:.2f}", f"{point.photons:,}",
            f"{point.true_error:.2%} ± {point.error_bar:.2%}", f"{point.reported_error:.2%}",
            f"{point.median_error:.2%}", f"{point.percentile_95_error:.2%}",
            f"{point.true_error_indirect:.2%} ± {point.error_bar_indirect:.2%}",
            f"{point.reported_error_indirect:.2%}",
        ]
        for point in points
        if point.seed == points[0].seed
    ]  # fmt: skip
    columns = [
        "scene", "method", "made by", "s", "photons", "total", "reported", "median", "95 %",
        "indirect", "reported",
    ]  # fmt: skip
    print_table("RMS error over time, first seed", columns, rows)


def print_envelope(points: Sequence[CurvePoint]) -> None:
    """Where the composite is above the lower envelope of the other methods."""
    rows = []
    for scene in dict.fromkeys(point.scene for point in points):
        of_composite = runs(points, scene, "composite")
        others = {p.method for p in points if p.scene == scene} - {"composite"}
        if not of_composite or not others:
            continue
        last = max(p.build_seconds + p.seconds for p in points if p.scene == scene)
        first = min(p.build_seconds + p.seconds for p in points if p.scene == scene)
        seconds = np.geomspace(first, last, 400)

        def mean(of: Sequence[Sequence[CurvePoint]], error: str) -> np.ndarray:
            errors = np.array([errors_at(run, seconds, error) for run in of])  # noqa: B023
            return np.exp(np.log(errors).mean(axis=0))

        for part in ("true_error", "true_error_indirect"):
            envelope = np.full(len(seconds), np.inf)
            best = np.full(len(seconds), "", object)
            for method in sorted(others):
                errors = mean(runs(points, scene, method), part)
                lower = errors < envelope
                envelope[lower], best[lower] = errors[lower], method
            composite = mean(of_composite, part)
            late = np.isnan(composite) & np.isfinite(envelope)
            known = ~np.isnan(composite) & np.isfinite(envelope)
            ratio = np.where(known, composite / envelope, 0.0)
            above = np.flatnonzero(ratio > WITHIN)
            worst = int(np.argmax(ratio))
            rows.append(
                [
                    scene,
                    "indirect" if "indirect" in part else "total",
                    f"{len(above) / max(1, known.sum()):.0%}",
                    f"{seconds[above[0]]:.2f}–{seconds[above[-1]]:.2f}" if len(above) else "–",
                    f"{ratio[worst]:.2f} at {seconds[worst]:.2f} s ({best[worst]})",
                    f"{seconds[late][-1]:.2f}" if late.any() else "–",
                ]
            )
    columns = [
        "scene", "light", f"share of log time above {WITHIN:g}", "s",
        "largest composite / envelope", "others alone until, s",
    ]  # fmt: skip
    print_table("The composite against the lower envelope of the other methods", columns, rows)


def print_agreement(points: Sequence[CurvePoint]) -> None:
    """The indirect light of each method after its whole run, beside the path-traced reference."""
    rows = []
    for scene in dict.fromkeys(point.scene for point in points):
        for method in dict.fromkeys(p.method for p in points if p.scene == scene):
            ends = [run[-1] for run in runs(points, scene, method)]
            best = min(ends, key=lambda point: point.true_error_indirect)
            worst = max(ends, key=lambda point: point.true_error_indirect)
            rows.append(
                [
                    scene, method, best.component, f"{best.seconds:.0f}", f"{best.photons:,}",
                    f"{best.indirect_rays:,}",
                    f"{best.true_error_indirect:.2%} ± {best.error_bar_indirect:.2%}",
                    f"{worst.true_error_indirect:.2%} ± {worst.error_bar_indirect:.2%}",
                    f"{best.reported_error_indirect:.2%}",
                ]
            )  # fmt: skip
    columns = [
        "scene", "method", "made by", "s", "photons", "gathered rays", "best seed", "worst seed",
        "reported",
    ]  # fmt: skip
    print_table("Indirect light against path tracing: relative RMS, last stage", columns, rows)


def print_times(points: Sequence[CurvePoint]) -> None:
    """Times to the goals, and which component they went to."""
    rows = []
    for scene in dict.fromkeys(point.scene for point in points):
        for method in dict.fromkeys(p.method for p in points if p.scene == scene):
            of = runs(points, scene, method)
            for goal in GOALS:
                times = [seconds_to(run, goal, "true_error") for run in of]
                reached = sorted(t for t in times if t is not None)
                best = min(p.true_error for run in of for p in run if p.true_error > 0)
                text = f"never; best {best:.1%}"
                shares = ""
                if len(reached) == len(times):
                    text = f"{np.median(reached):.2f} ({reached[0]:.2f}–{reached[-1]:.2f})"
                    shares = component_shares(of, float(np.median(reached)))
                rows.append([scene, method, f"{goal:.0%}", text, shares])
    columns = ["scene", "method", "to", "s, median (range of seeds)", "of which"]
    print_table("Time to an RMS error of the total light", columns, rows)


def component_shares(of: Sequence[Sequence[CurvePoint]], until: float) -> str:
    """How the time went to the components until then, mean of the runs."""
    seconds: dict[str, float] = {}
    for run in of:
        before = 0.0
        steps = [("build", run[0].build_seconds)]
        steps += [(point.component, point.build_seconds + point.seconds) for point in run]
        for component, end in steps:
            spent = max(0.0, min(end, until) - before)
            seconds[component] = seconds.get(component, 0.0) + spent
            before = end
    whole = sum(seconds.values())
    return ", ".join(f"{name} {spent / whole:.0%}" for name, spent in seconds.items() if spent > 0)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("stages", type=Path, nargs="*")
    parser.add_argument("--methods", default=",".join(METHODS), help="comma-separated")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--time-budget", type=float, default=30.0, help="s of each run")
    parser.add_argument("--stages", type=int, default=10, dest="count", help="progressive stages")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--filter-accuracy", type=float, default=SolverSettings().filter_accuracy)
    parser.add_argument("--cpu-time", action="store_true", help="count the processor's seconds")
    folder = Path(__file__).parents[1] / "build/bench"
    parser.add_argument("--csv", type=Path, default=folder / "method_curves.csv")
    parser.add_argument("--figure", type=Path, default=folder / "method_curves.png")
    parser.add_argument("--cache", type=Path, default=folder, help="folder of references")
    parser.add_argument("--from", type=Path, dest="known", help="CSV of an earlier run")
    options = parser.parse_args(arguments)
    methods = options.methods.split(",")
    if unknown := set(methods) - set(get_args(Method)):
        parser.error(f"no method {', '.join(unknown)}; there are {', '.join(METHODS)}")
    for path in (options.csv, options.figure):
        path.parent.mkdir(parents=True, exist_ok=True)
    if options.known:
        points = read_curve(options.known)
        title = options.known.name
    else:
        settings = SolverSettings(
            threads=options.threads, stages=options.count, filter_accuracy=options.filter_accuracy
        )
        settings = settings.with_budget(time_budget=options.time_budget)
        seconds = "processor" if options.cpu_time else "wall"
        provenance = {
            "commit": commit(),
            "cpu": cpu_name(),
            "threads": options.threads,
            "clock": seconds,
            "time_budget": options.time_budget,
            "filter_accuracy": options.filter_accuracy,
        }
        points = measure(
            options.stages, methods, options.seeds, settings, options.cpu_time, options.cache
        )
        write_curve(options.csv, points, provenance)
        title = (
            f"{provenance['cpu']}, {options.threads} threads, {seconds} seconds, "
            f"{options.seeds} seeds, commit {provenance['commit']}"
        )
    print_curves(points)
    print_envelope(points)
    print_times(points)
    print_agreement(points)
    plot_curve(options.figure, points, title)
    print(f"\n{options.csv}\n{options.figure}")


if __name__ == "__main__":
    main()
