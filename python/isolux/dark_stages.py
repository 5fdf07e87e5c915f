"""Stages without anything to light, or without light: their results are valid, and all 0."""

from __future__ import annotations

from collections.abc import Iterable

from .scene_description import Finding, SceneDescription

# Kind of the finding: no prim's type, since there is no such prim.
DARK_STAGE = "dark stage"


def what_is_dark(scene: SceneDescription) -> Finding | None:
    """What a scene lacks for any light to be in its results; None: nothing.

    Where it lacks nothing, light may still miss it: see `no_light_arrives`.
    """
    if scene.meshes and scene.luminaires:
        return None
    lacks = []
    if not scene.meshes:
        lacks.append("no visible mesh to light")
    if not scene.luminaires:
        lacks.append("no luminaire: no visible light or emissive mesh that gives light")
    skipped = ", ".join(sorted({f.kind for f in scene.findings if f.action == "skipped"}))
    but = f" (skipped: {skipped})" if skipped else ""
    results = "its results are 0" if scene.meshes else "its results are empty"
    return _finding(f"{' and '.join(lacks)}{but}: {results}")


def no_light_arrives() -> Finding:
    """Of a scene whose luminaires all shine past its meshes, from infinitely far."""
    return _finding("no light arrives from any luminaire: its results are 0")


def _finding(reason: str) -> Finding:
    return Finding("/", DARK_STAGE, "noted", reason)


def warnings_of(findings: Iterable[Finding]) -> list[str]:
    """What to tell aloud, beside the table of findings: results without any light."""
    return [finding.reason for finding in findings if finding.kind == DARK_STAGE]
