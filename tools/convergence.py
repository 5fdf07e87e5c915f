"""How far solutions are from the truth: a reference of many photons, and true RMS errors by it.

All errors are relative, area-weighted over the illumination vertices, of luminance alone: as
ProgressiveStage.rms_error estimates them without a reference.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from numpy.typing import NDArray

from isolux import _core
from isolux.scene_description import SceneDescription
from isolux.settings import SolverSettings
from isolux.solution import LUMINANCE_WEIGHTS
from isolux.solver import ProgressiveSolver

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.ticker import LogLocator, NullFormatter

# No run that is measured has it.
REFERENCE_SEED = 2**31 - 1
CALL_PHOTONS = 1 << 18
TOTAL, INDIRECT = slice(0, 2), slice(1, 2)


def bucket_illuminance(
    core: _core.Scene, buckets: _core.PhotonBuckets
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Unfiltered illuminance of each vertex, and its variance by Poisson's law.

    returns : (V, 2) float64 each, lx and lx^2: direct, indirect; 0 where a vertex has no area
    """
    photon_flux = core.luminous_flux / buckets.ends["emitted"]
    areas = core.vertex_areas
    per_hit = np.divide(photon_flux, areas, out=np.zeros_like(areas), where=areas > 0)[:, None]
    illuminance = buckets.hit_counts * per_hit
    return illuminance, illuminance * per_hit


def trace(core: _core.Scene, photons: int, seed: int, threads: int) -> _core.PhotonBuckets:
    """Buckets of the first photons of a seed."""
    buckets = _core.PhotonBuckets(core)
    for first in range(0, photons, CALL_PHOTONS):
        count = min(CALL_PHOTONS, photons - first)
        _core.trace_photons(core, buckets, seed, first, count, threads)
    return buckets


class Reference:
    """Unbiased illuminance from photons of another seed, its own variance known.

    The variance is subtracted from squared differences, so that few times the photons of what is
    measured are enough.
    """

    def __init__(self, core: _core.Scene, photons: int, threads: int) -> None:
        self.photons = photons
        self.areas: NDArray[np.float64] = core.vertex_areas
        self._illuminance, self._variance = bucket_illuminance(
            core, trace(core, photons, REFERENCE_SEED, threads)
        )

    def rms_error(self, illuminance: NDArray[np.float64], part: slice) -> float:
        """True relative RMS error.

        illuminance : (V, 2) float64, lx: direct, indirect
        part : TOTAL or INDIRECT
        """
        truth = self._illuminance[:, part].sum(axis=1)
        difference = illuminance[:, part].sum(axis=1) - truth
        square = self.areas @ (difference**2 - self._variance[:, part].sum(axis=1))
        mean = self.areas @ truth / self.areas.sum()
        return float(np.sqrt(max(0.0, square / self.areas.sum())) / mean) if mean > 0 else 0.0


def luminance_pair(
    direct: NDArray[np.float32], indirect: NDArray[np.float32]
) -> NDArray[np.float64]:
    """(V, 2) float64, lx: direct and indirect of (V, 3) colours."""
    return np.stack([direct @ LUMINANCE_WEIGHTS, indirect @ LUMINANCE_WEIGHTS], axis=1)


@dataclass(frozen=True, slots=True)
class CurvePoint:
    """One progressive stage of one run: seconds of solving, errors as ratios."""

    scene: str
    triangles: int
    seed: int
    photons: int
    seconds: float
    filter_seconds: float
    reported_error: float
    true_error: float
    reported_error_indirect: float
    true_error_indirect: float


def error_curve(
    name: str,
    scene: SceneDescription,
    core: _core.Scene,
    settings: SolverSettings,
    reference_factor: float,
) -> list[CurvePoint]:
    """Reported and true errors of the stages of one run."""
    traced = 0.0

    def remember(progress: Any) -> None:
        nonlocal traced
        traced = progress.elapsed

    stages, illuminances = [], []
    for solution in ProgressiveSolver(scene, settings).stages(remember):
        stages.append((solution.stage, solution.stage.elapsed - traced))
        illuminances.append(luminance_pair(solution.direct, solution.indirect))
    photons = int(reference_factor * stages[-1][0].photons)
    reference = Reference(core, photons, settings.threads or -1)
    return [
        CurvePoint(
            scene=name,
            triangles=core.element_count,
            seed=settings.seed,
            photons=stage.photons,
            seconds=stage.elapsed,
            filter_seconds=filter_seconds,
            reported_error=stage.rms_error,
            true_error=reference.rms_error(illuminance, TOTAL),
            reported_error_indirect=stage.rms_error_indirect,
            true_error_indirect=reference.rms_error(illuminance, INDIRECT),
        )
        for (stage, filter_seconds), illuminance in zip(stages, illuminances, strict=True)
    ]


def write_curve(
    path: Path, points: Sequence[CurvePoint], provenance: dict[str, str | int | float]
) -> None:
    """One CSV row a stage; the columns of the provenance come first."""
    columns = [*provenance, *(field.name for field in fields(CurvePoint))]
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.DictWriter(file, columns)
        rows.writeheader()
        rows.writerows({**provenance, **asdict(point)} for point in points)


def plot_curve(path: Path, points: Sequence[CurvePoint], title: str) -> None:
    """Error against time, a panel a scene, both axes logarithmic."""
    scenes = list(dict.fromkeys(point.scene for point in points))
    figure, panels = plt.subplots(
        1, len(scenes), figsize=(1 + 5.2 * len(scenes), 4.6), squeeze=False, layout="constrained"
    )
    lines = (
        ("true_error", "total, true", "tab:blue", "-"),
        ("reported_error", "total, as reported", "tab:blue", "--"),
        ("true_error_indirect", "indirect, true", "tab:orange", "-"),
        ("reported_error_indirect", "indirect, as reported", "tab:orange", "--"),
    )
    for panel, scene in zip(panels[0], scenes, strict=True):
        of_scene = [point for point in points if point.scene == scene]
        seconds = np.array([point.seconds for point in of_scene])
        for name, label, colour, style in lines:
            errors = 100 * np.array([getattr(point, name) for point in of_scene])
            shown = errors > 0
            panel.loglog(
                seconds[shown], errors[shown], style, color=colour, marker="o", ms=4,
                mfc=colour if style == "-" else "white", label=label,
            )  # fmt: skip
        panel.set_title(f"{scene}, {of_scene[0].triangles:,} triangles", fontsize=11)
        panel.set_xlabel("seconds of solving")
        panel.set_ylabel("relative RMS error, %")
        for axis in (panel.xaxis, panel.yaxis):
            axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(NullFormatter())
        panel.grid(which="both", alpha=0.25)
        panel.legend(frameon=False, fontsize=9)
    figure.suptitle(title, fontsize=9, color="0.35")
    figure.savefig(path, dpi=160)
    plt.close(figure)
