"""Plots of the report."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib

from validation.measured import Measured
from validation.rows import CIE_171, Row

matplotlib.use("svg")
from matplotlib import pyplot as plt

if TYPE_CHECKING:
    from validation.recorder import Case

# Text stays text, and the same figures make the same file.
matplotlib.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "isolux", "font.size": 9})
BY_REFLECTANCE = "reflectance"


def draw_plots(
    folder: Path, cases: Sequence[Case], tables: Sequence[Measured]
) -> dict[str, list[tuple[str, str]]]:
    """Write them. returns : of each section, file names and captions"""
    curves: dict[str, list[Row]] = {}
    for case in cases:
        for row in case.rows:
            if case.group == CIE_171 and row.at is not None:
                curves.setdefault(row.case, []).append(row)
    along = {name: rows for name, rows in curves.items() if rows[0].axis != BY_REFLECTANCE}
    by_reflectance = {name: rows for name, rows in curves.items() if name not in along}
    figures: dict[str, list[tuple[str, str]]] = {}
    if along:
        _draw_curves(folder / "cie_171_curves.svg", along)
        caption = "Expected (line) and got (dots) along the lines of CIE 171"
        figures.setdefault(CIE_171, []).append(("cie_171_curves.svg", caption))
    if by_reflectance:
        _draw_errors(folder / "cie_171_5_8.svg", by_reflectance)
        caption = "Error of the mean indirect illuminance of case 5.8 by reflectance"
        figures.setdefault(CIE_171, []).append(("cie_171_5_8.svg", caption))
    return figures


def _draw_curves(path: Path, curves: dict[str, list[Row]]) -> None:
    columns = 3
    lines = math.ceil(len(curves) / columns)
    figure, axes = plt.subplots(lines, columns, figsize=(10, 2.6 * lines), squeeze=False)
    for axis in axes.flat[len(curves) :]:
        axis.set_axis_off()
    for axis, (name, rows) in zip(axes.flat, curves.items(), strict=False):
        rows = sorted(rows, key=lambda row: row.at)
        at = [row.at for row in rows]
        axis.plot(at, [row.expected for row in rows], "-", color="0.6", label="expected")
        axis.plot(at, [row.got for row in rows], ".", color="C0", label="got")
        for row in rows:
            if not row.passed:
                axis.plot(row.at, row.got, "x", color="C3")
        axis.set_title(name, fontsize=8)
        axis.set_xlabel(rows[0].axis)
        axis.set_ylabel(rows[0].unit)
        axis.set_ylim(bottom=0)
    _save(figure, path)


def _draw_errors(path: Path, curves: dict[str, list[Row]]) -> None:
    figure, axis = plt.subplots(figsize=(7, 3))
    for name, rows in curves.items():
        rows = sorted(rows, key=lambda row: row.at)
        axis.plot(
            [row.at for row in rows], [100 * row.relative_error for row in rows], ".-", label=name
        )
    axis.axhline(2, color="0.7", ls="--")
    axis.axhline(-2, color="0.7", ls="--")
    axis.axhline(0, color="0.7", lw=0.5)
    axis.set_xlabel("reflectance")
    axis.set_ylabel("error, % (dashed: 2 %)")
    axis.legend(fontsize=7)
    _save(figure, path)


def _save(figure: Any, path: Path) -> None:
    figure.tight_layout()
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)
