"""Is the reported error the true error? Coverage of the reported 95 % intervals over many seeds.

    python tools/coverage.py [--cases NAME,NAME] [--seeds N] [--processes N] [--csv FILE]
        [--cache FOLDER]

Each seed solves each case from the first photons on, large elements divided as in any run (but
radiosity's); every stage is compared, at the scene's own vertices, with the illuminance at the
vertex itself: in closed form where there is one, else path-traced (`reference.py`), whose own
standard error is added to the reported one. The quantities:

- vertex, area: share of all (vertex, seed), each counting once or by its area, in which
  |value - truth| <= 1.96 times the reported standard deviation (relativeDeviation times the value);
- poisson: of unfiltered buckets, share in which the mean count expected of the bucket lies in the
  interval that the filter draws around its count, against the share that the rule has itself;
- rms: share of seeds in which the true RMS error is within a fifth of the reported one (the errors
  of a solution hang together, so that no count of vertices tells how far an RMS may stray);
  reported_over_true has the root mean squares of both over the seeds.

z is (value - truth) over the standard deviation: its RMS is 1 and |z| has the quantiles 0.67, 1.96
and 2.58 at 50, 95 and 99 % where errors are normal and rightly told.
"""

from __future__ import annotations

import argparse
import csv
import math
import os
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, fields
from functools import cache, partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from bench_report import commit, print_table
from coverage_cases import CASES, Array, Case
from numpy.typing import NDArray
from scipy.stats import poisson

from isolux import _core
from isolux.components import (
    DirectLight,
    FinalGather,
    PhotonTracing,
    Radiosity,
    photometric,
)
from isolux.composite import GATHER_RAYS_PER_PHOTON
from isolux.illumination import Illumination
from isolux.settings import SolverSettings

NOMINAL, Z95 = 0.95, 1.959964
RMS_WITHIN = 0.2  # of the reported RMS error
# Rounding of values that are exact by the reported error.
EXACT = 1e-4
PHOTONS = (300, 3_000, 30_000, 300_000)
# Of the composite and of ddl+idept.
LATE_PHOTONS = (3_000, 30_000, 300_000)
RADIOSITY_RAYS = 1 << 18
RADIOSITY_CASES = ("cornell_small",)
RADIOSITY_SEEDS = 10  # most of its error is the same for all


@dataclass(frozen=True, slots=True)
class Stage:
    """What one stage of one seed says.

    values, errors : (V,) lx of each part, photometric
    rms : relative RMS error as reported of each part that has one
    """

    name: str
    component: str
    values: dict[str, Array]
    errors: dict[str, Array]
    rms: dict[str, float]


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table; columns are those of the CSV."""

    case: str
    stage: str
    component: str
    quantity: str
    seeds: int
    nominal: float
    covered: float
    z_rms: float
    z_50: float
    z_95: float
    z_99: float
    true_rms: float
    reported_over_true: float
    photons: int
    settings: str
    commit: str


Places = NDArray[np.integer]


# --- stages --------------------------------------------------------------------------------------


def _snapshot(name: str, component: str, light: Illumination, places: Places) -> Stage:
    direct, indirect = (
        photometric(values[places]).astype(np.float64) for values in (light.direct, light.indirect)
    )
    direct_error, indirect_error = light.direct_error[places], light.indirect_error[places]
    return Stage(
        name,
        component,
        {"direct": direct, "indirect": indirect, "total": direct + indirect},
        {
            "direct": direct_error,
            "indirect": indirect_error,
            "total": np.hypot(direct_error, indirect_error),
        },
        {"total": light.rms_error, "indirect": light.rms_error_indirect},
    )


def stages(case: Case, seed: int, photon_counts: Sequence[int]) -> Iterator[tuple[Stage, int]]:
    """All stages of one seed, with their photons."""
    core, areas, places = case.solved, case.solved.told_areas, case.places
    settings = SolverSettings(seed=seed)
    reflects = bool(case.indirect.any())

    def trace(counts: Sequence[int]) -> Iterator[PhotonTracing]:
        photons = PhotonTracing(core, settings, 1)
        for count in counts:
            photons.trace(count - photons.emitted)
            yield photons

    def taken(photons: PhotonTracing, filter_settings: SolverSettings) -> Illumination:
        light = Illumination(areas)
        tracing = PhotonTracing(core, filter_settings, 1)
        tracing.buckets, tracing.emitted = photons.buckets, photons.emitted
        light.take_photons(tracing.filtered()[0])
        return light

    variants = {
        "": settings,
        ", unshared": SolverSettings(seed=seed, filter_sharing=0.0),
        ", unfiltered": SolverSettings(seed=seed, filter_accuracy=1.0, filter_sharing=0.0),
    }
    for photons in trace(photon_counts):
        count = photons.emitted
        for name, variant in variants.items():
            if name == ", unshared" and count != photon_counts[0]:
                continue
            light = taken(photons, variant)
            yield _snapshot(f"{count} photons{name}", "DEPT", light, places), count
    lighting = DirectLight(core, settings, 1)
    light = Illumination(areas)
    light.take_direct(*lighting.at_vertices(np.zeros(len(areas), np.float32), lambda share: None))
    light.leave_indirect_dark()
    yield _snapshot("vertices", "DDL", light, places), 0
    if not reflects:
        return
    gather = FinalGather(core, settings, 1)
    rays = 0
    for photons in trace([c for c in photon_counts if c in LATE_PHOTONS]):
        count = photons.emitted
        light.take_indirect_photons(photons.filtered()[0])
        yield _snapshot(f"{count} photons", "IDEPT", light, places), count
        light.take_indirect(
            gather.gather(photons, light.direct, GATHER_RAYS_PER_PHOTON * count - rays)
        )
        rays = GATHER_RAYS_PER_PHOTON * count
        yield _snapshot(f"{count} photons", "gather", light, places), count


def radiosity_stage(case: Case, seed: int) -> Stage:
    settings = SolverSettings(seed=seed)
    lighting = DirectLight(case.core, settings, 1)
    light = Illumination(case.core.vertex_areas)
    none = np.zeros(len(case.core.vertex_areas), np.float32)
    light.take_direct(*lighting.at_vertices(none, lambda share: None))
    radiosity = Radiosity(case.core, settings, 1, lighting, lambda share: None)
    while not radiosity.finished:
        light.take_indirect(radiosity.shoot(RADIOSITY_RAYS))
    return _snapshot("finished", "HPR", light, np.arange(len(none)))


# --- statistics ----------------------------------------------------------------------------------


class Coverage:
    """Of one part of one stage, summed over the seeds."""

    def __init__(self, truth: Array, noise: Array, areas: Array) -> None:
        self._known = np.isfinite(truth) & (areas > 0)
        self._truth, self._noise = truth[self._known], noise[self._known]
        self._weights = areas[self._known] / areas[self._known].sum()
        self._mean = float(self._weights @ self._truth)
        self._z: list[Array] = []
        self._squares: list[tuple[float, float]] = []  # relative, reported and true

    def add(self, values: Array, errors: Array, rms: float | None) -> None:
        off = values[self._known] - self._truth
        error = errors[self._known].astype(np.float64)
        # Of a value that is exact but for rounding, z is 0.
        off[np.abs(off) <= EXACT * self._truth] = 0.0
        bound = np.hypot(error, self._noise)
        with np.errstate(divide="ignore", invalid="ignore"):
            self._z.append(np.where(off == 0.0, 0.0, np.abs(off) / bound))
        square = max(0.0, float(self._weights @ (off**2 - self._noise**2)))
        reported = float(np.sqrt(self._weights @ error**2)) / self._mean if rms is None else rms
        self._squares.append((reported**2, square / self._mean**2))

    @property
    def seeds(self) -> int:
        return len(self._z)

    def rows(self) -> Iterator[tuple[str, dict[str, float]]]:
        z = np.array(self._z)
        inside = z <= Z95
        finite = np.minimum(z, 100.0)
        reported, true = np.sqrt(np.mean(self._squares, axis=0))
        q = dict(zip(("z_50", "z_95", "z_99"), np.quantile(finite, (0.5, 0.95, 0.99)), strict=True))
        common = {
            "z_rms": float(np.sqrt(np.mean(finite**2))),
            **q,
            "true_rms": true,
            "reported_over_true": reported / true if true > 0 else math.nan,
        }
        yield "vertex", {"covered": inside.mean(), **common}
        yield "area", {"covered": float((inside @ self._weights).mean()), **common}
        pairs = np.sqrt(self._squares)
        within = np.abs(pairs[:, 1] - pairs[:, 0]) <= RMS_WITHIN * pairs[:, 0]
        yield "rms", {"covered": within.mean(), **common}


def poisson_row(counts: NDArray[np.uint64]) -> tuple[float, float] | None:
    """Share of (seed, bucket) whose interval holds the mean of the other seeds; the rule's own.

    counts : (seeds, N) of buckets
    """
    seeds = len(counts)
    counts = counts[:, counts.sum(axis=0) > 0]
    if seeds < 20 or counts.size == 0:
        return None
    highest = int(counts.max())
    low, high = np.array([_core.poisson_interval(n, paper=False) for n in range(highest + 1)]).T
    others = (counts.sum(axis=0) - counts) / (seeds - 1)
    inside = (low[counts] <= others) & (others <= high[counts])
    mean = counts.mean(axis=0)
    n = np.arange(highest + 1)[:, None]
    own = (poisson.pmf(n, mean) * ((low[:, None] <= mean) & (mean <= high[:, None]))).sum(axis=0)
    return float(inside.mean()), float(own.mean())


@dataclass(frozen=True, slots=True)
class Told:
    """Of one seed.

    stages : each with its photons
    counts : (N, 2) hits of the buckets of direct and indirect light, by photons
    seconds : of the processor
    """

    stages: list[tuple[Stage, int]]
    counts: dict[int, NDArray[np.uint64]]
    seconds: float


@cache
def made_case(name: str, folder: Path) -> Case:
    """Once a process."""
    with tempfile.TemporaryDirectory() as temporary:
        return CASES[name](Path(temporary), folder)


def told_of_seed(seed: int, name: str, photon_counts: Sequence[int], folder: Path) -> Told:
    case = made_case(name, folder)
    started = time.process_time()
    told = list(stages(case, seed, photon_counts))
    if name in RADIOSITY_CASES and seed < RADIOSITY_SEEDS:
        told.append((radiosity_stage(case, seed), 0))
    counts = {}
    for photons in photon_counts[:2]:
        buckets = _core.PhotonBuckets(case.solved)
        _core.trace_photons(case.solved, buckets, seed, 0, photons, 1)
        counts[photons] = buckets.hit_counts
    return Told(told, counts, time.process_time() - started)


def measure(name: str, case: Case, all_told: Iterable[Told]) -> Iterator[Row]:
    made_by = commit()  # now: a long run outlasts a commit
    areas = case.solved.told_areas[case.places]
    truths = {
        "direct": (case.direct, case.direct_noise),
        "indirect": (case.indirect, case.indirect_noise),
        "total": (case.direct + case.indirect, np.hypot(case.direct_noise, case.indirect_noise)),
    }
    found: dict[tuple[str, str, str], Coverage] = {}
    photons_of: dict[str, int] = {}
    counts: dict[int, list[NDArray[np.uint64]]] = {}
    seeds = 0
    for told in all_told:
        seeds += 1
        for stage, photons in told.stages:
            photons_of[stage.name] = photons
            for part, (truth, noise) in truths.items():
                if not np.nan_to_num(truth).any() or (
                    stage.component == "DDL" and part != "direct"
                ):
                    continue
                if stage.component in ("IDEPT", "gather", "HPR") and part == "direct":
                    continue
                key = stage.name, stage.component, part
                if key not in found:
                    found[key] = Coverage(truth, noise, areas)
                found[key].add(stage.values[part], stage.errors[part], stage.rms.get(part))
        for photons, hits in told.counts.items():
            counts.setdefault(photons, []).append(hits)
    fixed = {"case": name, "nominal": NOMINAL, "commit": made_by}
    for (stage, component, part), coverage in found.items():
        settings = stage.partition(", ")[2] or "default"
        for quantity, values in coverage.rows():
            yield Row(
                stage=stage.partition(", ")[0], component=f"{component} {part}", quantity=quantity,
                seeds=coverage.seeds, photons=photons_of[stage], settings=settings,
                **(fixed | values),
            )  # fmt: skip
    for photons, all_counts in counts.items():
        for path, part in enumerate(("direct", "indirect")):
            shares = poisson_row(np.array(all_counts)[:, :, path])
            if shares is not None:
                nothing = dict.fromkeys(
                    ("z_rms", "z_50", "z_95", "z_99", "true_rms", "reported_over_true"), math.nan
                )
                yield Row(
                    stage=f"{photons} photons", component=f"bucket {part}", quantity="poisson",
                    seeds=seeds, photons=photons, settings="unfiltered", covered=shares[0],
                    **(fixed | nothing | {"nominal": shares[1]}),
                )  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--cases", default=",".join(CASES), help="comma-separated")
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    parser.add_argument("--photons", default=",".join(map(str, PHOTONS)), help="comma-separated")
    parser.add_argument("--csv", type=Path)
    folder = Path(__file__).parents[1] / "build/bench"
    parser.add_argument("--cache", type=Path, default=folder, help="folder of references")
    options = parser.parse_args(arguments)
    names = options.cases.split(",")
    if unknown := set(names) - set(CASES):
        parser.error(f"no case {', '.join(unknown)}; there are {', '.join(CASES)}")
    photons = [int(count) for count in options.photons.split(",")]
    rows: list[Row] = []
    seconds = 0.0

    def counted(all_told: Iterable[Told]) -> Iterator[Told]:
        nonlocal seconds
        for told in all_told:
            seconds += told.seconds
            yield told

    # Fresh processes: the solver's threads wouldn't outlive a fork.
    with ProcessPoolExecutor(options.processes, get_context("spawn")) as pool:
        for name in names:
            case = made_case(name, options.cache)  # here first: its reference is for all to read
            tell = partial(told_of_seed, name=name, photon_counts=photons, folder=options.cache)
            rows += measure(name, case, counted(pool.map(tell, range(options.seeds))))
            noise = np.sqrt(np.nanmean(case.direct_noise**2 + case.indirect_noise**2))
            print(
                f"{name}: {case.core.element_count} triangles, {case.core.vertex_count} vertices, "
                f"{case.solved.vertex_count} solved, "
                f"the truth known to {noise / np.nanmean(case.direct + case.indirect):.2%} "
                f"({seconds:.0f} s CPU)",
                file=sys.stderr,
            )
    if options.csv:
        with options.csv.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, [field.name for field in fields(Row)])
            writer.writeheader()
            for row in rows:
                shown = {
                    k: f"{v:.4g}" if isinstance(v, float) else v for k, v in asdict(row).items()
                }
                writer.writerow(shown)
    table: dict[tuple[str, ...], dict[str, Row]] = {}
    for row in rows:
        key = row.case, row.component, row.stage, row.settings
        table.setdefault(key, {})[row.quantity] = row
    lines = []
    for key, of in table.items():
        any_row = next(iter(of.values()))
        covered = [f"{of[q].covered:.1%}" if q in of else "" for q in ("vertex", "area", "rms")]
        own = (
            f"{of['poisson'].covered:.1%} of {of['poisson'].nominal:.1%}" if "poisson" in of else ""
        )
        numbers = [any_row.z_rms, any_row.z_50, any_row.z_95, any_row.z_99]
        lines.append(
            [
                *key, *covered, own, *(f"{x:.2f}" for x in numbers), f"{any_row.true_rms:.2%}",
                f"{any_row.reported_over_true:.2f}",
            ]
        )  # fmt: skip
    print_table(
        f"Coverage of reported 95 % intervals, {options.seeds} seeds, commit {commit()}, "
        f"{seconds:.0f} s CPU",
        ["case", "component", "stage", "settings", "vertices", "area", "rms", "poisson", "z rms",
         "z 50", "z 95", "z 99", "true RMS", "reported/true"],
        lines,
    )  # fmt: skip


if __name__ == "__main__":
    main()
