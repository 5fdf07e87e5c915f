"""Error against time of several programs, and when each reaches a goal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.ticker import LogLocator, NullFormatter

COLOURS = {
    "isolux": "black",
    "mitsuba": "tab:blue",
    "cycles": "tab:orange",
    "radiance": "tab:olive",
    "radiance-cached": "tab:green",
}
# Their error halves with four times the work; the others' has a floor of its own.
MONTE_CARLO = ("mitsuba", "cycles", "radiance")


@dataclass(frozen=True, slots=True)
class Place:
    """One run: s, and the error as a ratio."""

    seconds: float
    error: float


@dataclass(frozen=True, slots=True)
class Reached:
    """When an error was reached.

    extrapolated : past the last run, by error ∝ seconds^-1/2
    """

    seconds: float
    extrapolated: bool = False

    def __str__(self) -> str:
        digits = max(0, 1 - math.floor(math.log10(self.seconds)))
        return f"{'~' if self.extrapolated else ''}{self.seconds:,.{digits}f}"


def time_to(goal: float, places: Sequence[Place], program: str) -> Reached | None:
    """First time at a goal by log-log interpolation; None where it is not known.

    places : in the order of their seconds
    """
    for before, after in zip([None, *places[:-1]], places, strict=True):
        if after.error > goal:
            continue
        if before is None:
            return Reached(after.seconds)
        share = math.log(before.error / goal) / math.log(before.error / after.error)
        return Reached(before.seconds * (after.seconds / before.seconds) ** share)
    if program not in MONTE_CARLO or not places:
        return None
    last = places[-1]
    return Reached(last.seconds * (last.error / goal) ** 2, extrapolated=True)


def plot_errors(
    path: Path,
    curves: dict[str, dict[str, Sequence[Place]]],
    names: dict[str, str],
    titles: dict[str, str],
    subtitle: str,
) -> None:
    """A panel a scene, both axes logarithmic; errors in per cent.

    curves : of each scene and program, the runs in the order of their seconds
    """
    count = len(curves)
    columns = min(count, 3)
    rows = math.ceil(count / columns)
    figure, panels = plt.subplots(
        rows, columns, figsize=(0.6 + 4.4 * columns, 0.8 + 3.7 * rows), squeeze=False,
        layout="constrained",
    )  # fmt: skip
    for panel in panels.flat[count:]:
        panel.axis("off")
    for panel, (scene, programs) in zip(panels.flat, curves.items(), strict=False):
        for program, places in programs.items():
            seconds = [place.seconds for place in places]
            errors = [100 * place.error for place in places]
            panel.loglog(
                seconds, errors, ".-", color=COLOURS.get(program, "0.5"), ms=5,
                lw=2 if program == "isolux" else 1.2, label=names.get(program, program),
            )  # fmt: skip
        panel.axhline(5, color="0.75", lw=0.8, zorder=0)
        panel.axhline(2, color="0.75", lw=0.8, zorder=0)
        for axis, subs in ((panel.xaxis, (1,)), (panel.yaxis, (1, 2, 5))):
            axis.set_major_locator(LogLocator(subs=subs))
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(NullFormatter())
        panel.grid(which="major", alpha=0.25)
        panel.set_title(titles[scene], fontsize=10)
        panel.set_xlabel("seconds of building and solving")
        panel.set_ylabel("RMS error of the illuminance, %")
    panels[0, 0].legend(frameon=False, fontsize=8)
    figure.suptitle(subtitle, fontsize=8, color="0.35")
    figure.savefig(path, dpi=130)
    plt.close(figure)
