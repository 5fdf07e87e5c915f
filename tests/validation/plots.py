"""Plots of the report."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib

from validation.measured import CONVERGENCE, COVERAGE, COVERED_WITHIN, Measured
from validation.rows import CIE_171, Row

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.ticker import LogLocator, NullFormatter

if TYPE_CHECKING:
    from validation.recorder import Case

matplotlib.rcParams.update({"font.size": 9})
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
        _draw_curves(folder / "cie_171_curves.png", along)
        caption = "Expected (line) and got (dots) along the lines of CIE 171"
        figures.setdefault(CIE_171, []).append(("cie_171_curves.png", caption))
    if by_reflectance:
        _draw_errors(folder / "cie_171_5_8.png", by_reflectance)
        caption = "Error of the mean indirect illuminance of case 5.8 by reflectance"
        figures.setdefault(CIE_171, []).append(("cie_171_5_8.png", caption))
    for table in tables:
        if table.section == COVERAGE and table.has("case", "component", "quantity", "covered"):
            _draw_coverage(folder / f"{table.name}.png", table)
            caption = "Share of vertices within the reported 95 % interval, by photons"
            figures.setdefault(COVERAGE, []).append((f"{table.name}.png", caption))
        if table.section == CONVERGENCE and table.has(
            "scene", "method", "photons", "rms", "reported"
        ):
            _draw_convergence(folder / f"{table.name}.png", table)
            caption = "RMS error (solid), as reported (dotted), and bias (dashed) by photons"
            figures.setdefault(CONVERGENCE, []).append((f"{table.name}.png", caption))
    return figures


def _draw_coverage(path: Path, table: Measured) -> None:
    """One panel a case, a line a component, dashed with other settings than the default.

    What needs no photons stands in the table alone.
    """
    rows = [row for row in table.rows if row["quantity"] == "vertex" and float(row["photons"]) > 0]
    cases = list(dict.fromkeys(row["case"] for row in rows))
    colours = {name: f"C{i}" for i, name in enumerate(dict.fromkeys(r["component"] for r in rows))}
    figure, axes = _panels(len(cases))
    handles: dict[str, Any] = {}
    for axis, case in zip(axes, cases, strict=False):
        lines: dict[tuple[str, str], list[tuple[float, float]]] = {}
        for row in rows:
            if row["case"] == case:
                key = row["component"], row.get("settings", "default")
                lines.setdefault(key, []).append((float(row["photons"]), float(row["covered"])))
        for (component, settings), points in lines.items():
            label = component if settings == "default" else f"{component}, {settings}"
            style = ".-" if settings == "default" else ".--"
            (handles[label],) = axis.plot(
                *zip(*sorted(points), strict=True), style, color=colours[component], lw=1
            )
        axis.axhspan(0.95 - COVERED_WITHIN, 0.95 + COVERED_WITHIN, color="0.9")
        axis.set(title=case, xscale="log", xlabel="photons", ylim=(0.8, 1.0))
    below = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0), "ncol": 5, "frameon": False}
    figure.legend(handles.values(), handles.keys(), fontsize=7, **below)
    _save(figure, path)


def _draw_convergence(path: Path, table: Measured) -> None:
    """One panel a scene, three lines a method."""
    scenes = list(dict.fromkeys(row["scene"] for row in table.rows))
    figure, axes = _panels(len(scenes))
    for axis, scene in zip(axes, scenes, strict=False):
        of_scene = [row for row in table.rows if row["scene"] == scene]
        for i, method in enumerate(dict.fromkeys(row["method"] for row in of_scene)):
            rows = [row for row in of_scene if row["method"] == method]
            rows.sort(key=lambda row: float(row["photons"]))
            at = [float(row["photons"]) for row in rows]
            for column, style in (("rms", ".-"), ("reported", ":"), ("bias", ".--")):
                values = [100 * abs(float(row[column])) for row in rows]
                axis.plot(at, values, style, color=f"C{i}", label=f"{method}, {column}")
        axis.set(title=scene, xscale="log", yscale="log", xlabel="photons", ylabel="%")
        axis.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.yaxis.set_major_formatter("{x:g}")
        axis.yaxis.set_minor_formatter(NullFormatter())
        axis.legend(fontsize=6)
    _save(figure, path)


def _panels(count: int) -> tuple[Any, list[Any]]:
    """A figure with so many axes, three in a line."""
    columns = 3
    lines = math.ceil(count / columns)
    figure, axes = plt.subplots(lines, columns, figsize=(10, 2.6 * lines), squeeze=False)
    for axis in axes.flat[count:]:
        axis.set_axis_off()
    return figure, list(axes.flat)


def _draw_curves(path: Path, curves: dict[str, list[Row]]) -> None:
    figure, axes = _panels(len(curves))
    for axis, (name, rows) in zip(axes, curves.items(), strict=False):
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
    figure, axis = plt.subplots(figsize=(9, 3))
    for name, rows in curves.items():
        rows = sorted(rows, key=lambda row: row.at)
        axis.plot(
            [row.at for row in rows],
            [100 * row.relative_error for row in rows],
            ".-",
            label=name.rpartition("light, ")[2],
        )
    axis.axhline(2, color="0.7", ls="--")
    axis.axhline(-2, color="0.7", ls="--")
    axis.axhline(0, color="0.7", lw=0.5)
    axis.set_xlabel("reflectance")
    axis.set_ylabel("error, % (dashed: 2 %)")
    axis.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5))
    _save(figure, path)


def _save(figure: Any, path: Path) -> None:
    figure.tight_layout()
    figure.savefig(path, dpi=80, bbox_inches="tight")
    plt.close(figure)
