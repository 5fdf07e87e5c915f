"""The solver's report: read back from a results layer, and as a JSON file."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from pxr import Sdf, Tf

from .atomic_file import replace_atomically
from .errors import SceneError
from .results import REPORT_ATTRIBUTES
from .scene_description import SceneDescription
from .schedule import StagePlan, recorded_steps
from .settings import SolverSettings
from .solution import ProgressiveStage


@dataclass(frozen=True, slots=True)
class PhaseSeconds:
    """Wall time of each phase of a run, s."""

    read: float
    build: float
    solve: float
    write: float


def read_report(path: str | Path) -> tuple[dict[str, Any], list[ProgressiveStage]]:
    """Provenance and stages that a results file tells about itself; the source isn't opened.

    path : the root layer that a solve made, or its results layer
    returns : what the writer was given to replay the run, with sourceHash, steps and
        reportPrim (path of the prim with the report); the stages by time code, of results of many
        frames the last stage of each frame
    raises : SceneError where the file is no USD or holds no results
    """
    for layer in _layers(Path(path)):
        provenance = layer.customLayerData.get("isolux")
        if provenance:
            prim = Sdf.Path(provenance["reportPrim"])
            frames = [Path(path).parent / asset for asset in provenance.get("frameLayers", ())]
            layers = [_open(frame) for frame in frames] if frames else [layer]
            return _plain(provenance), [stage for part in layers for stage in _stages(part, prim)]
    raise SceneError(str(path), "no Isolux results", "a file that `isolux solve` wrote")


def read_replay(path: str | Path) -> tuple[SolverSettings, tuple[StagePlan, ...], str]:
    """What makes the same run again, bit for bit: its settings, its steps, the source's hash.

    path : as for `read_report`
    raises : SceneError where the file holds no results that can be replayed
    """
    provenance, _ = read_report(path)
    if "frames" in provenance:
        layer = provenance["frameLayers"][0]
        raise SceneError(str(path), "results of many frames", f"those of one, such as {layer}")
    try:
        steps = recorded_steps(provenance["steps"])
        settings = recorded_settings(provenance)
    except (KeyError, TypeError, ValueError) as error:
        raise SceneError(
            str(path), f"no steps to replay ({error})", "results of this version of Isolux"
        ) from None
    return settings, steps, provenance["sourceHash"]


def recorded_settings(provenance: Mapping[str, Any]) -> SolverSettings:
    """The settings of an earlier run; the defaults for those that its version didn't have."""
    known = {field.name for field in fields(SolverSettings)}
    recorded = provenance.get("settings", {})
    return SolverSettings(**{name: value for name, value in recorded.items() if name in known})


def write_report(
    path: str | Path,
    scene: SceneDescription,
    stages: Sequence[ProgressiveStage],
    provenance: Mapping[str, Any],
    seconds: PhaseSeconds,
) -> None:
    """Write the run as one JSON object; numbers that are not finite become null.

    provenance : version, seed, threads, settings, as given to the results writer
    raises : SceneError where the file can't be written
    """
    report = {
        **provenance,
        "source_hash": scene.source_hash,
        "meshes": len(scene.meshes),
        "luminaires": len(scene.luminaires),
        "prims": {kind: dict(counts) for kind, counts in scene.prim_counts.items()},
        "luminous_flux_lm": scene.luminous_flux,
        "seconds": asdict(seconds),
        "stages": [_stage_object(stage) for stage in stages],
        "findings": [asdict(finding) for finding in scene.findings],
    }
    text = json.dumps(_finite(report), indent=2, allow_nan=False, ensure_ascii=False)
    with replace_atomically(Path(path)) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def _open(path: Path) -> Sdf.Layer:
    """A private copy: the cached layer of an earlier look would hide a newer file."""
    if not path.is_file():
        raise SceneError(str(path), "no such file", "a file that `isolux solve` wrote")
    try:
        layer = Sdf.Layer.OpenAsAnonymous(str(path))
    except Tf.ErrorException:
        layer = None
    if layer is None:
        raise SceneError(str(path), "no USD file", "a file that `isolux solve` wrote")
    return layer


def _layers(path: Path) -> Iterator[Sdf.Layer]:
    """The root layer, then its sublayers, strongest first."""
    root = _open(path)
    yield root
    for asset in root.subLayerPaths:
        sublayer = path.parent / asset
        if sublayer.is_file():
            yield _open(sublayer)


def _stages(layer: Sdf.Layer, prim: Sdf.Path) -> list[ProgressiveStage]:
    attributes = {
        field: prim.AppendProperty(name) for field, (name, _) in REPORT_ATTRIBUTES.items()
    }
    times = layer.ListTimeSamplesForPath(attributes["component"])
    return [
        ProgressiveStage(
            index=int(time),
            **{field: layer.QueryTimeSample(path, time) for field, path in attributes.items()},
        )
        for time in times
    ]


def _stage_object(stage: ProgressiveStage) -> dict[str, Any]:
    units = {"elapsed": "elapsed_seconds"}
    return {units.get(name, name): value for name, value in asdict(stage).items()}


def _plain(value: Any) -> Any:
    """A layer's dictionary in plain Python types."""
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    return value if isinstance(value, bool | int | float | str) else list(value)


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
