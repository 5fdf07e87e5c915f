"""Reads a USD stage into a `SceneDescription`: world space, metres, lumens, prim paths kept.

Everything that a stage holds and the solver does not take as it stands becomes a `Finding`.
"""

from __future__ import annotations

import hashlib
import math
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
from pxr import Ar, Sdf, Usd, UsdGeom, UsdLux, UsdUtils

from .errors import SceneError, SettingsError
from .gprim_reader import read_gprim
from .instancing import InstanceWalk
from .light_linking import link_luminaires
from .light_reader import read_light
from .materials import MaterialReader
from .mesh_lights import mesh_luminaires, with_light
from .mesh_reader import read_mesh
from .old_lights import note_old_inputs
from .reading_context import ReadingContext
from .scene_description import (
    InstancedPrim,
    LuminaireDescription,
    MeshDescription,
    SceneDescription,
)
from .settings import SolverSettings, settings_from_stage
from .stage_opening import AS_IT_STANDS, StageOpening, open_noisily
from .unreadable_prims import is_in_reach, skipped_where_unreadable
from .usd_messages import usd_message

# Bytes of a layer hashed at a time: little memory, and few turns with the thread that reads.
HASHED_PIECE = 1 << 22
# Unloaded payloads are no part of the default predicate, and would go unseen.
DEFINED_PRIMS = Usd.PrimIsActive & Usd.PrimIsDefined & ~Usd.PrimIsAbstract


def read_stage(
    stage: Usd.Stage | str | Path,
    time_code: float | None = None,
    settings: SolverSettings | None = None,
) -> SceneDescription:
    """Read meshes, their reflectance and the luminaires of a stage.

    stage : an open stage, or the file of one
    time_code : at which attributes are read; None: the stage's startTimeCode where it has one,
        else the earliest sample of each attribute
    settings : how geometry is read; None: as the stage's own settings say
    Raises SceneError where the stage can't be opened, holds the results of an earlier run (their
    displayColor is no reflectance) or a reflectance is impossible, PhotometryError where a
    photometric file can't be used, and SettingsError where the stage's own settings can't be.
    """
    _, scene, _ = read_source(
        stage, time_code, lambda opened: settings or settings_from_stage(opened)
    )
    return scene


def read_source(
    stage: Usd.Stage | str | Path,
    time_code: float | None,
    choose_settings: Callable[[Usd.Stage], SolverSettings],
    opening: StageOpening = AS_IT_STANDS,
) -> tuple[Usd.Stage, SceneDescription, SolverSettings]:
    """Open a stage, choose the settings, and read it by them; raises as `read_stage`.

    time_code : as for `read_stage`
    choose_settings : by the open stage, such as settings_from_stage
    opening : of a file; a stage that is open stays as it is
    """
    started = time.perf_counter()
    if time_code is not None and not math.isfinite(time_code):  # USD would read no sample at all
        raise SettingsError("time", f"{time_code:g}", "a finite time code")
    diagnostics = UsdUtils.CoalescingDiagnosticDelegate()  # keeps USD from writing to stderr
    try:
        opened = stage if isinstance(stage, Usd.Stage) else open_noisily(str(stage), opening)
        _require_no_results(opened)
        settings = choose_settings(opened)
        start = None
        if time_code is None and opened.HasAuthoredMetadata("startTimeCode"):
            start = opened.GetStartTimeCode()
            time_code = start if math.isfinite(start) else None
        context = ReadingContext(opened, time_code, settings)
        if start is not None and time_code is None:
            reason = f"startTimeCode = {start:g}: read at the earliest time"
            context.note(Sdf.Path.absoluteRootPath, "startTimeCode", "repaired", reason)
        with _hashed_beside(opened.GetUsedLayers()) as source_hash:
            _note_composition_errors(opened, context)
            _note_parts_left_out(opened, context)
            up_axis = _up_axis(opened, context)
            # What overflows becomes infinite, and is told by whoever reads it.
            with np.errstate(all="ignore"):
                meshes, luminaires, instanced = _read_prims(opened, context)
            _note_diagnostics(diagnostics, context)
        scene = SceneDescription(
            meshes=tuple(meshes),
            luminaires=tuple(luminaires),
            findings=tuple(context.findings),
            meters_per_unit=context.meters_per_unit,
            up_axis=up_axis,
            time_code=time_code,
            source_hash=source_hash.result(),
            read_seconds=time.perf_counter() - started,
            prim_counts=context.prim_counts(),
            instanced=tuple(instanced),
        )
        return opened, scene, settings
    finally:
        diagnostics.TakeUncoalescedDiagnostics()  # those left would be written at its deletion


def _require_no_results(stage: Usd.Stage) -> None:
    for layer in stage.GetUsedLayers():
        if "isolux" in layer.customLayerData:
            raise SceneError(
                stage.GetRootLayer().identifier,
                f"results of an earlier run in {layer.identifier}",
                "the stage alone",
            )


def _read_prims(
    stage: Usd.Stage, context: ReadingContext
) -> tuple[list[MeshDescription], list[LuminaireDescription], list[InstancedPrim]]:
    meshes: list[MeshDescription] = []
    luminaires: list[LuminaireDescription] = []
    sources: dict[str, str] = {}
    materials = MaterialReader(context)
    walk = InstanceWalk(context, meshes, lambda prim: _skip_subtree(prim, context))
    for placed in walk.prims(stage, DEFINED_PRIMS):
        prim = placed.prim
        if prim.HasAPI(UsdLux.LightAPI):
            note_old_inputs(prim, context)
            with skipped_where_unreadable(prim, context):
                luminaire = read_light(prim, context)
                if luminaire and is_in_reach(luminaire, prim, context):
                    sources[placed.path] = placed.source_path
                    luminaires.append(replace(luminaire, path=placed.path))
                    context.count_read(prim)
        if placed.again:
            continue
        if prim.GetTypeName() and not prim.IsA(Usd.Typed):
            reason = "a type of prim that this USD does not know"
            context.note(prim, str(prim.GetTypeName()), "skipped", reason)
        if not prim.IsA(UsdGeom.Gprim) or not context.selection.is_rendered(prim):
            continue
        read_shape = read_mesh if prim.IsA(UsdGeom.Mesh) else read_gprim
        with skipped_where_unreadable(prim, context):
            mesh = read_shape(prim, context, materials)
            if mesh:
                meshes.append(placed.mesh(with_light(prim, mesh, context)))
                context.count_read(prim)
    luminaires += mesh_luminaires(meshes)
    sources.update((mesh.path, mesh.source_path) for mesh in meshes if mesh.source_path)
    return meshes, link_luminaires(stage, luminaires, meshes, sources, context), walk.instanced


def _skip_subtree(prim: Usd.Prim, context: ReadingContext) -> bool:
    """Whether nothing at or below a prim is read; the reason becomes a finding."""
    if not prim.IsLoaded():
        context.note(prim, "payload", "skipped", "its payload is not loaded")
        return True
    if context.selection.leaves_out(prim):
        return True
    visibility = context.value(prim, "visibility", UsdGeom.Tokens.inherited)
    if visibility == UsdGeom.Tokens.invisible:
        contents = _contents(prim)
        if contents:
            context.note(prim, "visibility", "skipped", f"invisible: {contents}")
            context.note_changing_visibility(prim)
        return True
    context.note_changing_visibility(prim)
    return False


def _contents(prim: Usd.Prim) -> str:
    """What renders at and below a prim, instances included: "3 meshes, 1 light"; "" for nothing."""
    counts = {"mesh": 0, "other shape": 0, "light": 0, "point instancer": 0}
    within = Usd.PrimRange(prim, Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate))
    for inner in within:
        if inner.IsA(UsdGeom.Mesh):
            counts["mesh"] += 1
        elif inner.IsA(UsdGeom.Gprim):
            counts["other shape"] += 1
        elif inner.IsA(UsdGeom.PointInstancer):
            counts["point instancer"] += 1
        if inner.HasAPI(UsdLux.LightAPI):
            counts["light"] += 1
    plural = {"mesh": "meshes"}
    return ", ".join(
        f"{count} {kind if count == 1 else plural.get(kind, kind + 's')}"
        for kind, count in counts.items()
        if count
    )


def _note_composition_errors(stage: Usd.Stage, context: ReadingContext) -> None:
    """References and payloads that lead nowhere leave parts of the stage missing."""
    for error in stage.GetCompositionErrors():
        context.note(error.rootSite.path, "composition", "skipped", " ".join(str(error).split()))


def _up_axis(stage: Usd.Stage, context: ReadingContext) -> str:
    """ "Y" or "Z"."""
    axis = str(UsdGeom.GetStageUpAxis(stage))
    if axis in (UsdGeom.Tokens.y, UsdGeom.Tokens.z):
        return axis
    instead = str(UsdGeom.GetFallbackUpAxis())
    reason = f"{axis!r} is neither Y nor Z: taken as {instead}"
    context.note(Sdf.Path.absoluteRootPath, "upAxis", "repaired", reason)
    return instead


def _note_parts_left_out(stage: Usd.Stage, context: ReadingContext) -> None:
    mask = stage.GetPopulationMask()
    if not mask.Includes(Sdf.Path.absoluteRootPath) or not mask.IncludesSubtree("/"):
        paths = ", ".join(str(path) for path in mask.GetPaths())
        reason = f"all of the stage but {paths}"
        context.note(Sdf.Path.absoluteRootPath, "population mask", "skipped", reason)
    for layer in stage.GetMutedLayers():
        reason = f"{layer} is muted"
        context.note(Sdf.Path.absoluteRootPath, "muted layer", "skipped", reason)


def _note_diagnostics(
    diagnostics: UsdUtils.CoalescingDiagnosticDelegate, context: ReadingContext
) -> None:
    """Warnings of USD itself, apart from the composition errors, which know their prim."""
    messages = [usd_message(d) for d in diagnostics.TakeUncoalescedDiagnostics()]
    for message in dict.fromkeys(messages):
        if "ing stage on stage @" not in message:
            context.note(Sdf.Path.absoluteRootPath, "USD", "noted", message)


@contextmanager
def _hashed_beside(layers: Iterable[Sdf.Layer]) -> Iterator[Future[str]]:
    """sha256 over what layers hold, whatever their order and place; found while others read.

    Waits for it, even where reading fails: then the layers go at once, in the midst of hashing.
    """
    with ThreadPoolExecutor(1) as thread:
        yield thread.submit(_source_hash, layers)


def _source_hash(layers: Iterable[Sdf.Layer]) -> str:
    return hashlib.sha256(b"".join(sorted(_layer_digest(layer) for layer in layers))).hexdigest()


def _layer_digest(layer: Sdf.Layer) -> bytes:
    if layer.anonymous or layer.dirty:
        return hashlib.sha256(layer.ExportToString().encode()).digest()
    path = Path(str(layer.resolvedPath))
    if path.is_file():
        digest = hashlib.sha256()
        with path.open("rb") as file:
            while piece := file.read(HASHED_PIECE):
                digest.update(piece)
        return digest.digest()
    in_package = Ar.GetResolver().OpenAsset(layer.resolvedPath)
    contents = in_package.GetBuffer() if in_package else layer.ExportToString().encode()
    return hashlib.sha256(contents).digest()
