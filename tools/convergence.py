"""How far solutions are from the truth over time, by the path-traced reference.

All errors are relative, area-weighted over the illumination vertices, of luminance alone: as
ProgressiveStage.rms_error estimates them without a reference.
"""

from __future__ import annotations

import csv
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, get_type_hints

import matplotlib
import numpy as np
from numpy.typing import NDArray
from reference import INDIRECT, TOTAL, PathTracedReference

from isolux import _core
from isolux.scene_description import SceneDescription
from isolux.settings import SolverSettings
from isolux.solver import ProgressiveSolver

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.ticker import LogLocator, NullFormatter

CALL_PHOTONS = 1 << 18
Array = NDArray[np.float64]


def bucket_illuminance(core: _core.Scene, buckets: _core.PhotonBuckets) -> tuple[Array, Array]:
    """Unfiltered direct and indirect illuminance of each vertex.

    returns : (V, 3) float64 each, lx, grey; 0 where a vertex has no area
    """
    photon_flux = core.luminous_flux / buckets.ends["emitted"]
    areas = core.vertex_areas
    per_hit = np.divide(photon_flux, areas, out=np.zeros_like(areas), where=areas > 0)
    direct, indirect = (buckets.hit_counts * per_hit[:, None]).T
    return np.repeat(direct[:, None], 3, axis=1), np.repeat(indirect[:, None], 3, axis=1)


def trace(core: _core.Scene, photons: int, seed: int, threads: int) -> _core.PhotonBuckets:
    """Buckets of the first photons of a seed."""
    buckets = _core.PhotonBuckets(core)
    for first in range(0, photons, CALL_PHOTONS):
        count = min(CALL_PHOTONS, photons - first)
        _core.trace_photons(core, buckets, seed, first, count, threads)
    return buckets


@dataclass(frozen=True, slots=True)
class CurvePoint:
    """One progressive stage of one run; errors as ratios.

    build_seconds : s before the first stage
    seconds : s of solving
    error_bar, error_bar_indirect : standard errors of the true errors
    median_error, percentile_95_error : of the vertices' absolute errors, relative to the mean
    switchover, second_switchover : T1 and T2, s of solving; 0: not yet, or none
    """

    scene: str
    triangles: int
    method: str
    seed: int
    index: int
    component: str
    photons: int
    shadow_rays: int
    indirect_rays: int
    elements: int
    build_seconds: float
    seconds: float
    reported_error: float
    true_error: float
    error_bar: float
    median_error: float
    percentile_95_error: float
    reported_error_indirect: float
    true_error_indirect: float
    error_bar_indirect: float
    switchover: float
    second_switchover: float


def error_curve(
    name: str,
    scene: SceneDescription,
    reference: PathTracedReference,
    settings: SolverSettings,
    clock: Callable[[], float] = time.perf_counter,
) -> list[CurvePoint]:
    """Reported and true errors of the stages of one run."""
    solver = ProgressiveSolver(scene, settings, clock)
    triangles = sum(int((mesh.face_vertex_counts - 2).sum()) for mesh in scene.meshes)
    points = []
    for solution in solver.stages():
        stage = solution.stage
        total = reference.error(solution.direct, solution.indirect, TOTAL)
        indirect = reference.error(solution.direct, solution.indirect, INDIRECT)
        points.append(
            CurvePoint(
                scene=name,
                triangles=triangles,
                method=settings.method,
                seed=settings.seed,
                index=stage.index,
                component=stage.component,
                photons=stage.photons,
                shadow_rays=stage.shadow_rays,
                indirect_rays=stage.indirect_rays,
                elements=stage.elements,
                build_seconds=solver.build_seconds,
                seconds=stage.elapsed,
                reported_error=stage.rms_error,
                true_error=total.rms,
                error_bar=total.error_bar,
                median_error=total.median,
                percentile_95_error=total.percentile_95,
                reported_error_indirect=stage.rms_error_indirect,
                true_error_indirect=indirect.rms,
                error_bar_indirect=indirect.error_bar,
                switchover=stage.switchover_time,
                second_switchover=stage.second_switchover_time,
            )
        )
    return points


def write_curve(
    path: Path, points: Sequence[CurvePoint], provenance: Mapping[str, str | int | float]
) -> None:
    """One CSV row a stage; the columns of the provenance come first."""
    columns = [*provenance, *(field.name for field in fields(CurvePoint))]
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.DictWriter(file, columns)
        rows.writeheader()
        rows.writerows({**provenance, **asdict(point)} for point in points)


def read_curve(path: Path) -> list[CurvePoint]:
    """What `write_curve` wrote."""
    kinds = get_type_hints(CurvePoint)
    with path.open(newline="", encoding="utf-8") as file:
        return [
            CurvePoint(**{name: kind(row[name]) for name, kind in kinds.items()})
            for row in csv.DictReader(file)
        ]


def runs(points: Sequence[CurvePoint], scene: str, method: str) -> list[list[CurvePoint]]:
    """The points of each seed."""
    of = [point for point in points if (point.scene, point.method) == (scene, method)]
    seeds = dict.fromkeys(point.seed for point in of)
    return [[point for point in of if point.seed == seed] for seed in seeds]


def errors_at(run: Sequence[CurvePoint], seconds: Array, error: str) -> Array:
    """An error of a run by log-log interpolation; nan before its first stage.

    After the last stage the error stays as it is.
    """
    known = [point for point in run if getattr(point, error) > 0]
    if not known:
        return np.full(len(seconds), np.nan)
    log_seconds = np.log([point.build_seconds + point.seconds for point in known])
    log_errors = np.log([getattr(point, error) for point in known])
    return np.exp(np.interp(np.log(seconds), log_seconds, log_errors, left=np.nan))


def seconds_to(run: Sequence[CurvePoint], goal: float, error: str) -> float | None:
    """When an error was first reached, by log-log interpolation; None for never."""
    before: tuple[float, float] | None = None
    for point in run:
        seconds, reached = point.build_seconds + point.seconds, getattr(point, error)
        if reached <= goal:
            if before is None or reached <= 0:
                return seconds
            share = math.log(before[1] / goal) / math.log(before[1] / reached)
            return before[0] * (seconds / before[0]) ** share
        before = seconds, reached
    return None


METHOD_COLOURS = {
    "composite": "black",
    "dept": "tab:blue",
    "ddl+idept": "tab:orange",
    "ddl+hpr": "tab:green",
}


def plot_curve(path: Path, points: Sequence[CurvePoint], title: str) -> None:
    """Error against time, a column a scene, total above indirect; both axes logarithmic.

    A line a method, the mean of its seeds, over the spread between them; T1 and T2 of the composite
    as vertical lines; what the composite reports of itself dashed.
    """
    scenes = list(dict.fromkeys(point.scene for point in points))
    methods = list(dict.fromkeys(point.method for point in points))
    figure, panels = plt.subplots(
        2, len(scenes), figsize=(1 + 4.6 * len(scenes), 8.2), squeeze=False, layout="constrained",
        sharex="col",
    )  # fmt: skip
    for column, scene in enumerate(scenes):
        for panel, part in zip(panels[:, column], ("", "_indirect"), strict=True):
            for method in methods:
                _plot_method(panel, runs(points, scene, method), method, part)
            for axis in (panel.xaxis, panel.yaxis):
                axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
                axis.set_major_formatter("{x:g}")
                axis.set_minor_formatter(NullFormatter())
            panel.grid(which="both", alpha=0.25)
            panel.set_ylabel(f"RMS error of the {'indirect' if part else 'total'} light, %")
        triangles = next(point.triangles for point in points if point.scene == scene)
        panels[0, column].set_title(f"{scene}, {triangles:,} triangles", fontsize=11)
        panels[1, column].set_xlabel("seconds of building and solving")
    panels[0, 0].legend(frameon=False, fontsize=9)
    figure.suptitle(title, fontsize=9, color="0.35")
    figure.savefig(path, dpi=160)
    plt.close(figure)


def _plot_method(panel: Any, of: Sequence[Sequence[CurvePoint]], method: str, part: str) -> None:
    if not of:
        return
    colour, name = METHOD_COLOURS.get(method, "0.5"), f"true_error{part}"
    first = max(run[0].build_seconds + run[0].seconds for run in of)
    last = min(run[-1].build_seconds + run[-1].seconds for run in of)
    seconds = np.geomspace(first, max(first, last), 200)
    errors = 100 * np.array([errors_at(run, seconds, name) for run in of])
    if np.isnan(errors).all():
        return
    panel.loglog(seconds, np.exp(np.log(errors).mean(axis=0)), color=colour, label=method)
    if len(of) > 1:
        panel.fill_between(
            seconds, errors.min(axis=0), errors.max(axis=0), color=colour, alpha=0.15, lw=0
        )
    for run in of:
        places = [(p.build_seconds + p.seconds, 100 * getattr(p, name)) for p in run]
        panel.plot(*np.array(places).T, ".", color=colour, ms=4, alpha=0.6)
    if method == "composite":
        reported = 100 * np.array([errors_at(run, seconds, f"reported_error{part}") for run in of])
        label = "composite, as reported"
        panel.plot(seconds, reported.mean(axis=0), "--", color=colour, lw=1, label=label)
        for label, time_of in (("T1", "switchover"), ("T2", "second_switchover")):
            times = [p.build_seconds + getattr(p, time_of) for p in (run[-1] for run in of)]
            if min(getattr(run[-1], time_of) for run in of) > 0:
                panel.axvline(float(np.median(times)), color="0.6", lw=0.8, ls=":")
                panel.annotate(
                    label, (float(np.median(times)), 1), (2, -10), color="0.4", fontsize=8,
                    xycoords=("data", "axes fraction"), textcoords="offset points",
                )  # fmt: skip
