"""Measures speed and error of the solver on the demo's office at two densities: `make bench`.

    python tools/benchmark.py [--quick] [--only rates,run,filter,slopes] [--threads N]

rates   photon surface events against Embree's bare closest hits of diffuse rays on the same tree,
        slice by slice in turns, and the filter's time after one second of photon tracing; shadow
        rays of direct light against Embree's bare occlusion of rays to the same luminaires
run     phases of a run, time to the first results on disk, memory
slopes  how costs grow with elements, luminaires and photons (tools/cost_slopes.py)
filter  true error of buckets, paper filter and corrected filter by number of photons

Ratios within one run are what counts: on a shared machine the rates themselves come and go.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from bench_report import commit, cpu_name, print_table
from convergence import (
    bucket_illuminance,
    trace,
)
from cost_slopes import FULL as FULL_RANGES
from cost_slopes import QUICK as QUICK_RANGES
from cost_slopes import measure_slopes
from numpy.typing import NDArray
from reference import INDIRECT, TOTAL, PathTracedReference, path_traced_reference
from solve_runs import phase_seconds, run_solve, seconds_of

from isolux import _core, _ray_rate
from isolux.core_scene import build_core_scene
from isolux.scene_description import SceneDescription
from isolux.settings import SolverSettings
from isolux.stage_reader import read_stage

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "build/bench"
sys.path.insert(0, str(ROOT))  # the scene generators
from usd_scenes.office.generate import generate  # noqa: E402

WORTH_A_LOOK = 0.15  # RMS error of a picture that tells how the room will look
RAY_SEED = 1
DIRECT_ACCURACY = 0.01
MEASURES = ("rates", "run", "filter", "slopes")


@dataclass(frozen=True, slots=True)
class Effort:
    """How long each measure takes.

    densities : of the office: 1 has about 100,000 triangles, 3.45 has 1,000,000
    slice_rays : rays and photon events of a slice, of about 0.1 s
    budget : s, of the run whose phases are shown
    photons : of the run whose memory is compared: as many rays, whatever the mesh or the machine
    filter_photons : of the rows of the filter table
    reference_batches : of the path-traced reference
    """

    densities: tuple[float, ...]
    slice_rays: int
    slices: int
    budget: float
    photons: int
    filter_photons: tuple[int, ...]
    reference_batches: int


QUICK = Effort((1.0,), 100_000, 5, 2.0, 20_000, (1 << 15, 1 << 18), 2)
FULL = Effort(
    densities=(1.0, 3.45),
    slice_rays=200_000,
    slices=15,
    budget=5.0,
    photons=200_000,
    filter_photons=tuple(1 << k for k in (14, 16, 18, 20, 22)),
    reference_batches=8,
)


@dataclass(frozen=True, slots=True)
class BenchmarkScene:
    """A stage as read and built: the tree that all measures share."""

    name: str
    path: Path
    scene: SceneDescription
    core: _core.Scene

    @classmethod
    def read(cls, name: str, path: Path, threads: int) -> BenchmarkScene:
        scene = read_stage(path)
        return cls(name, path, scene, build_core_scene(scene, SolverSettings(), threads))

    def reference(self, effort: Effort) -> PathTracedReference:
        """Of the light at the vertices; kept beside the figures."""
        return path_traced_reference(
            self.scene, self.core, batches=effort.reference_batches, cache=FOLDER
        )


def spread(values: NDArray[np.float64]) -> str:
    """Median and quartiles."""
    low, middle, high = np.percentile(values, (25, 50, 75))
    return f"{middle:.2f} ({low:.2f}–{high:.2f})"


def seconds_or_never(seconds: float | None) -> str:
    return "never" if seconds is None else f"{seconds:.2f}"


def filter_buckets(
    core: _core.Scene,
    buckets: _core.PhotonBuckets,
    photon_filter: _core.IlluminationFilter,
    paper: bool,
    threads: int,
) -> dict[str, Any]:
    """Direct and indirect light filtered by the default settings, but for the interval."""
    settings = SolverSettings()
    result: dict[str, Any] = photon_filter.filter(
        core, buckets, settings.filter_accuracy, settings.filter_sharing, paper, threads
    )
    return result


class RateMeter:
    """Rates of bare rays and of photon events on one scene, in slices of about the same length."""

    def __init__(self, core: _core.Scene, slice_rays: int) -> None:
        self._core = core
        self._slice_rays = slice_rays
        self._rays = _ray_rate.IncoherentRays(core, slice_rays, RAY_SEED)
        self._buckets = _core.PhotonBuckets(core)
        self._photons = slice_rays
        self.photon_rate(1)  # touches the memory and tells how many events a photon has
        self._photons = slice_rays * slice_rays // self._events()

    def _events(self) -> int:
        ends = self._buckets.ends
        return int(ends["rays"] - ends["escaped"])

    def bare_rate(self, threads: int) -> float:
        """Closest hits, 1/s."""
        return self._slice_rays / seconds_of(lambda: self._rays.shoot(threads))

    def photon_rate(self, threads: int) -> float:
        """Photon surface events, 1/s."""
        before = self._events()
        first = self._buckets.ends["emitted"]
        seconds = seconds_of(
            lambda: _core.trace_photons(self._core, self._buckets, 0, first, self._photons, threads)
        )
        return (self._events() - before) / seconds


def shadow_ray_rates(
    core: _core.Scene, slices: int, threads: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Direct light at all vertices, alone, and bare occlusion, in turns.

    returns : shadow rays of direct light, 1/s; bare ones, 1/s; direct light, s
    """
    bare = _ray_rate.ShadowRays(core, RAY_SEED)
    receivers = core.receiver_positions, core.vertex_normals, np.zeros(0, np.float32), threads
    lighting = _core.DirectLighting(core, 0, DIRECT_ACCURACY)
    rays = lighting.illuminate(*receivers)["shadow_rays"]
    seconds = np.array(
        [
            (
                seconds_of(lambda: lighting.illuminate(*receivers)),
                seconds_of(lambda: bare.shoot(threads)),
            )
            for _ in range(slices)
        ]
    )
    return rays / seconds[:, 0], bare.count / seconds[:, 1], seconds[:, 0]


def filter_ratio(core: _core.Scene, threads: int) -> tuple[float, int]:
    """Time of filtering direct and indirect light once over that of tracing for a second.

    returns : the ratio; the photons traced
    """
    buckets = _core.PhotonBuckets(core)
    count, seconds = 1 << 12, 0.0
    while seconds < 1.0:
        first = buckets.ends["emitted"]
        seconds += seconds_of(
            lambda: _core.trace_photons(core, buckets, 0, first, count, threads)  # noqa: B023
        )
    photon_filter = _core.IlluminationFilter(core)
    filtering = seconds_of(lambda: filter_buckets(core, buckets, photon_filter, False, threads))
    return filtering / seconds, buckets.ends["emitted"]


def measure_rates(scenes: Sequence[BenchmarkScene], effort: Effort, threads: int) -> None:
    """Photon tracing against bare rays, filter against photon tracing, threads against one."""
    counts = sorted({1, threads}, reverse=True)
    columns = []
    for scene in scenes:
        meter = RateMeter(scene.core, effort.slice_rays)
        bare: dict[int, list[float]] = {count: [] for count in counts}
        photon: dict[int, list[float]] = {count: [] for count in counts}
        for _ in range(effort.slices):
            for count in counts:  # in turns: a machine that slows down favours neither
                bare[count].append(meter.bare_rate(count))
                photon[count].append(meter.photon_rate(count))
        ratio, photons = filter_ratio(scene.core, threads)
        direct, occlusion, direct_seconds = shadow_ray_rates(scene.core, effort.slices, threads)
        columns.append(
            [
                *(spread(np.divide(photon[count], bare[count])) for count in counts),
                f"{ratio:.2f}",
                f"{photons:,}",
                spread(np.divide(photon[threads], photon[1])),
                spread(np.divide(bare[threads], bare[1])),
                spread(np.divide(photon[threads], 1e6)),
                spread(np.divide(bare[threads], 1e6)),
                spread(direct / occlusion),
                spread(occlusion / 1e6),
                spread(direct_seconds),
            ]
        )
    names = [
        *(f"photon events / bare rays, {count} of {threads} threads" for count in counts),
        "filter / one second of photon tracing",
        "photons of that second",
        f"photon events, {threads} threads / 1",
        f"bare rays, {threads} threads / 1",
        f"photon events, {threads} threads, 10⁶/s",
        f"bare rays, {threads} threads, 10⁶/s",
        f"shadow rays of direct light / bare occlusion, {threads} threads",
        f"bare occlusion, {threads} threads, 10⁶/s",
        f"direct light at all vertices to {DIRECT_ACCURACY:.0%}, {threads} threads, s",
    ]
    print_table(
        "Rates: median (quartiles)",
        ["", *(f"{scene.core.element_count:,} triangles" for scene in scenes)],
        list(zip(names, *columns, strict=True)),
    )


def measure_runs(scenes: Sequence[BenchmarkScene], effort: Effort, threads: int) -> None:
    """Shares of time, time to the first results and memory."""
    columns, peaks = [], []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for scene in scenes:
            phases = phase_seconds(scene.path, effort.budget, threads, folder)
            run = run_solve(scene.path, f"--time-budget={effort.budget:g}", threads, folder)
            to_end = run_solve(scene.path, f"--photons={effort.photons}", threads, folder)
            whole = sum(phases.values())
            peaks.append((run.peak_memory, to_end.peak_memory))
            columns.append(
                [
                    *(f"{seconds / whole:.1%}" for seconds in phases.values()),
                    str(len(run.appeared)),
                    f"{run.appeared[0]:.2f}",
                    f"{run.errors[0]:.1%}, {run.errors_indirect[0]:.1%}",
                    seconds_or_never(run.seconds_to(WORTH_A_LOOK, run.errors)),
                    seconds_or_never(run.seconds_to(WORTH_A_LOOK, run.errors_indirect)),
                    f"{run.errors[-1]:.1%}, {run.errors_indirect[-1]:.1%}",
                    f"{run.seconds:.2f}",
                    f"{run.peak_memory / 2**20:.0f}",
                    f"{to_end.peak_memory / 2**20:.0f}",
                ]
            )
    names = [
        *(f"share of {phase}" for phase in phases),
        "progressive stages",
        "process start to first results on disk, s",
        "their RMS error, indirect",
        f"to results with RMS error below {WORTH_A_LOOK:.0%}, s",
        f"to results with indirect RMS error below {WORTH_A_LOOK:.0%}, s",
        "last RMS error, indirect",
        "whole process, s",
        "peak memory, MiB",
        f"the same of {effort.photons:,} photons, gathered to the end",
    ]
    print_table(
        f"`isolux solve --time-budget {effort.budget:g}`",
        ["", *(f"{scene.core.element_count:,} triangles" for scene in scenes)],
        list(zip(names, *columns, strict=True)),
    )
    if len(scenes) > 1:
        more = scenes[-1].core.element_count - scenes[0].core.element_count
        timed, counted = (
            (last - first) / more for first, last in zip(peaks[0], peaks[-1], strict=True)
        )
        print(f"\nMemory a further triangle: {timed:.0f} and {counted:.0f} bytes")


def measure_filter(scene: BenchmarkScene, effort: Effort, threads: int) -> None:
    """True errors of the filter's two intervals beside those of the buckets."""
    core = scene.core
    reference = scene.reference(effort)
    photon_filter = _core.IlluminationFilter(core)
    rows = []
    for photons in effort.filter_photons:
        buckets = trace(core, photons, 0, threads)
        candidates = [bucket_illuminance(core, buckets)]
        seconds = []
        for paper in (True, False):
            started = time.perf_counter()
            result = filter_buckets(core, buckets, photon_filter, paper, threads)
            seconds.append(time.perf_counter() - started)
            candidates.append((result["direct"], result["indirect"]))
        rows.append(
            [
                f"{photons:,}",
                f"{buckets.hit_counts.sum() / core.vertex_count:.2f}",
                *(f"{reference.error(*c, TOTAL).rms:.1%}" for c in candidates),
                f"{result['rms_error']:.1%}",
                *(f"{reference.error(*c, INDIRECT).rms:.1%}" for c in candidates),
                f"{result['rms_error_indirect']:.1%}",
                *(f"{s:.2f}" for s in seconds),
            ]
        )
    columns = ["photons", "hits a vertex"]
    for part in ("total", "indirect"):
        columns += [f"{part}: buckets", "paper", "corrected", "reported"]
    columns += ["s: paper", "corrected"]
    print_table(
        f"True RMS error of {scene.name} at its vertices, by path tracing; what the corrected "
        "filter reports; filter time",
        columns,
        rows,
    )


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument(
        "--quick", action="store_true", help="the smaller office only, about a minute in all"
    )
    parser.add_argument("--only", default=",".join(MEASURES), help="measures, comma-separated")
    parser.add_argument("--threads", type=int, default=len(os.sched_getaffinity(0)))
    options = parser.parse_args(arguments)
    only = options.only.split(",")
    if unknown := set(only) - set(MEASURES):
        parser.error(f"no measure {', '.join(unknown)}; there are {', '.join(MEASURES)}")
    effort = QUICK if options.quick else FULL
    FOLDER.mkdir(parents=True, exist_ok=True)

    threads = options.threads
    print(f"{cpu_name()}, {threads} threads, commit {commit()}")
    offices = []
    for density in effort.densities if {"rates", "run"} & set(only) else effort.densities[:1]:
        path = FOLDER / f"office_{density:g}.usdc"
        generate(path, density)
        offices.append(BenchmarkScene.read("office", path, threads))
    if "rates" in only:
        measure_rates(offices, effort, threads)
    if "run" in only:
        measure_runs(offices, effort, threads)
    if "filter" in only:
        measure_filter(offices[0], effort, threads)
    if "slopes" in only:
        measure_slopes(QUICK_RANGES if options.quick else FULL_RANGES, threads)


if __name__ == "__main__":
    main()
