"""The picture of error against time of several programs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.ticker import LogLocator, NullFormatter

from peers.time_to_error import Place

COLOURS = {
    "isolux": "black",
    "mitsuba": "tab:blue",
    "cycles": "tab:orange",
    "luxcore": "tab:red",
    "radiance": "tab:olive",
    "radiance-cached": "tab:green",
}


def plot_errors(
    path: Path,
    curves: dict[str, dict[str, Sequence[Sequence[Place]]]],
    names: dict[str, str],
    titles: dict[str, str],
    subtitle: str,
) -> None:
    """A panel a scene, both axes logarithmic; errors in per cent.

    curves : of each scene and program a line a seed, its places in the order of their seconds
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
        for program, lines in programs.items():
            for number, places in enumerate(lines):
                panel.loglog(
                    [place.seconds for place in places], [100 * place.error for place in places],
                    ".-", color=COLOURS.get(program, "0.5"), ms=5,
                    lw=1.6 if program == "isolux" else 1.2,
                    alpha=1.0 if number == 0 else 0.4,
                    label=names.get(program, program) if number == 0 else None,
                )  # fmt: skip
        for goal in (5, 2, 1):
            panel.axhline(goal, color="0.75", lw=0.8, zorder=0)
        for axis, subs in ((panel.xaxis, (1,)), (panel.yaxis, (1, 2, 5))):
            axis.set_major_locator(LogLocator(subs=subs))
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(NullFormatter())
        panel.grid(which="major", alpha=0.25)
        panel.set_title(titles[scene], fontsize=10)
        panel.set_xlabel("seconds of building and solving")
        panel.set_ylabel("RMS error of the illuminance, %")
    # Where a panel is left over it stands there, beside no curve.
    panels.flat[-1].legend(
        *panels[0, 0].get_legend_handles_labels(), frameon=False, fontsize=10, loc="center left"
    )
    figure.suptitle(subtitle, fontsize=8, color="0.35")
    figure.savefig(path, dpi=130)
    plt.close(figure)
