"""What the command line shows of scenes, findings and progressive stages, as rich tables."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rich import box
from rich.console import Console
from rich.table import Table

from .output_fields import OUTPUT_FIELDS
from .scene_description import Finding, FindingAction, LuminaireDescription, SceneDescription
from .solution import ProgressiveStage

if TYPE_CHECKING:
    from .stage_check import Complaint

# Prim paths that a summary of findings shows of each kind.
_SHOWN_PATHS = 3
# Columns where no terminal tells: tables are as wide as their text, so that lines can be searched.
_WIDTH_OF_A_FILE = 1000
_ACTIONS: tuple[FindingAction, ...] = ("skipped", "approximated", "repaired", "noted")


def new_console(*, stderr: bool = False) -> Console:
    """A console that prints names as they are: nothing in them is markup."""
    console = Console(stderr=stderr, markup=False, highlight=False, emoji=False)
    if not console.is_terminal:
        console.width = _WIDTH_OF_A_FILE
    return console


def percent(ratio: float) -> str:
    """A relative error for reading; "–" where there is no light, or not enough to tell."""
    if ratio == 0 or not math.isfinite(ratio):
        return "–"
    return f"{ratio:.2%}" if ratio < 1 else f"{ratio:.0%}"


def scene_summary(scene: SceneDescription) -> str:
    """What was read, in a line."""
    parts = (
        (len(scene.meshes), "mesh", "meshes"),
        (sum(len(mesh.face_vertex_counts) for mesh in scene.meshes), "face", "faces"),
        (sum(len(mesh.points) for mesh in scene.meshes), "point", "points"),
        (len(scene.luminaires), "luminaire", "luminaires"),
    )
    counts = [f"{count:,} {one if count == 1 else more}" for count, one, more in parts]
    flux = scene.luminous_flux
    from_afar = sum(light.luminous_flux for light in scene.luminaires if light.is_infinite)
    if flux > 0 or not from_afar:
        counts.append(f"{_lumens(flux)} lm")
    if from_afar:
        counts.append(f"{_lumens(from_afar)} lm/m² from afar")
    return ", ".join(counts)


def prims_table(scene: SceneDescription) -> Table:
    """What became of the prims, by their type."""
    actions = ("read", "skipped", "approximated", "repaired")
    table = _table("type", *(f"#{action}" for action in actions))
    for type_name, counts in scene.prim_counts.items():
        if any(action in counts for action in actions):
            cells = (f"{counts[action]:,}" if action in counts else "–" for action in actions)
            table.add_row(type_name, *cells)
    return table


def findings_summary(findings: Iterable[Finding]) -> Table:
    """A row for each action and kind: how many, and the first of the prims."""
    groups: dict[tuple[FindingAction, str], list[str]] = {}
    for finding in findings:
        groups.setdefault((finding.action, finding.kind), []).append(finding.path)
    table = _table("action", "kind", "#prims", "first of them")
    for (action, kind), paths in sorted(groups.items(), key=lambda row: _rank(*row[0])):
        more = ", …" if len(paths) > _SHOWN_PATHS else ""
        table.add_row(action, kind, str(len(paths)), ", ".join(paths[:_SHOWN_PATHS]) + more)
    return table


def findings_table(findings: Iterable[Finding]) -> Table:
    """Every finding with its reason."""
    table = _table("prim", "action", "kind", "reason")
    for finding in sorted(findings, key=lambda finding: _rank(finding.action, finding.kind)):
        table.add_row(finding.path, finding.action, finding.kind, finding.reason)
    return table


def complaint_table(complaints: Iterable[Complaint]) -> Table:
    """What validators say: a row for each kind of message, with the first of its prims."""
    table = _table("severity", "validator", "#prims", "first of them", "message")
    for row in complaints:
        more = ", …" if len(row.paths) > _SHOWN_PATHS else ""
        shown = ", ".join(row.paths[:_SHOWN_PATHS]) + more
        table.add_row(row.severity, row.name, str(len(row.paths)), shown, row.message)
    return table


def luminaire_table(luminaires: Sequence[LuminaireDescription]) -> Table:
    """Shape, luminous flux and directions of each luminaire."""
    table = _table("luminaire", "shape", "#size m", "#lm", "directions")
    for luminaire in luminaires:
        diagram = luminaire.diagram
        directions = (
            "constant luminance"
            if diagram is None
            else f"diagram of {len(diagram.gamma)} γ × {len(diagram.c_angles)} C"
        )
        if luminaire.is_infinite:
            flux = f"{_lumens(luminaire.luminous_flux)}/m²"
            size = (
                f"{math.degrees(2 * luminaire.size[0]):.3g}°"
                if luminaire.shape == "distant"
                else "∞"
            )
            table.add_row(luminaire.path, luminaire.shape, size, flux, directions)
            continue
        size = " × ".join(f"{length:.3g}" for length in luminaire.size if length > 0) or "0"
        table.add_row(
            luminaire.path, luminaire.shape, size, _lumens(luminaire.luminous_flux), directions
        )
    return table


# Column, field of ProgressiveStage; "?": where no stage has any, the column is left out.
_STAGE_COUNTS = (
    ("#photons", "photons"),
    ("#shadow rays?", "shadow_rays"),
    ("#indirect rays?", "indirect_rays"),
    ("#elements", "elements"),
)


def stage_table(stages: Sequence[ProgressiveStage]) -> Table:
    """What each progressive stage cost and how far off it is; below it, when components changed."""
    counts = [
        (column.rstrip("?"), field)
        for column, field in _STAGE_COUNTS
        if not column.endswith("?") or any(getattr(stage, field) for stage in stages)
    ]
    names = [column for column, _ in counts]
    table = _table("#stage", "component", *names, "#seconds", "#RMS error", "#indirect")
    for stage in stages:
        table.add_row(
            str(stage.index),
            stage.component,
            *(f"{getattr(stage, field):,}" for _, field in counts),
            f"{stage.elapsed:.2f}",
            percent(stage.rms_error),
            percent(stage.rms_error_indirect),
        )
    table.caption = _switchovers(stages[-1]) if stages else None
    table.caption_justify = "left"
    return table


def _switchovers(stage: ProgressiveStage) -> str | None:
    """T1 and T2 [Volevich 2000, §3.2] as far as the run has come; None before T1."""
    if stage.switchover_time == 0:
        return None
    text = f"T1 {stage.switchover_time:.2f} s, {stage.switchover_photons:,} photons"
    if stage.second_switchover_time > 0:
        text += f"; T2 {stage.second_switchover_time:.2f} s"
    return text


def field_table() -> Table:
    """The primvars that a solution is written as."""
    table = _table("primvar", "unit", "meaning")
    for field in OUTPUT_FIELDS:
        table.add_row(field.name, field.unit, field.meaning)
    return table


def provenance_table(provenance: Mapping[str, Any]) -> Table:
    """What a run can be replayed from, a row a value."""
    table = Table(box=None, show_header=False, pad_edge=False)
    for key, value in _flat(provenance):
        table.add_row(key, value)
    return table


def _lumens(luminous_flux: float) -> str:
    return f"{luminous_flux:,.0f}" if luminous_flux >= 1000 else f"{luminous_flux:.4g}"


def _flat(values: Mapping[str, Any], prefix: str = "") -> Iterable[tuple[str, str]]:
    for key, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{key}.")
        elif isinstance(value, list):
            yield f"{prefix}{key}", ", ".join(str(item) for item in value)
        else:
            yield f"{prefix}{key}", str(value)


def _rank(action: FindingAction, kind: str) -> tuple[int, str]:
    """Light or surfaces lost come first."""
    return _ACTIONS.index(action), kind


def _table(*columns: str) -> Table:
    """Columns of numbers, flushed right, are marked by "#"."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, header_style="bold")
    for column in columns:
        number = column.startswith("#")
        table.add_column(column.lstrip("#"), justify="right" if number else "left", overflow="fold")
    return table
