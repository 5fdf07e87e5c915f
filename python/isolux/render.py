"""A picture of the baked illuminance: what a camera sees of a results stage.

Surfaces reflect by Lambert's law, L = reflectance * E / pi, from the primvars alone: no light is
traced here. Luminaires are shown as shapes of their mean luminance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from .baked_prims import BakedPrims
from .cage_results import cage_corner_values, cage_face_means
from .camera import Camera, framing_candidates, stage_camera
from .core_scene import mesh_triangles
from .errors import SceneError, SettingsError
from .luminaire_shapes import dome_luminance, luminaire_triangles, mean_luminance
from .mesh_topology import MeshTopology
from .refined_results import SOURCE_FACE
from .report import recorded_settings
from .scene_description import LuminaireDescription, MeshDescription, SceneDescription
from .settings import SolverSettings
from .stage_reader import read_stage
from .visible_surfaces import Surface, VisibleSurfaces

FRONT_PRIMVAR = "isolux:illuminance"
BACK_PRIMVAR = "isolux:backIlluminance"

# Rays at a time: bounds the memory, some 50 MB.
_RAYS_AT_ONCE = 1 << 18

_WANTED = "a results stage; run `isolux solve` first"

# Steps between the samples of a pixel: with 1 / n the other way, even for any number n of them.
_GOLDEN_RATIO = (np.sqrt(5) - 1) / 2

# Grid on which a candidate camera is judged.
_SKETCH = (32, 18)
# Cells along each side of the scene's bounds, to tell its places apart.
_PLACES = 10


@dataclass(frozen=True, slots=True)
class Picture:
    """Luminance seen by a camera.

    rgb : (H, W, 3) float32, cd/m² by channel (linear Rec. 709), weighted by coverage
    coverage : (H, W) float32, share of the pixel that shows a surface or a dome, 0 to 1
    camera : prim path; empty where the camera was framed on the interior
    time : time code of the shown progressive stage; None: the default time
    """

    rgb: NDArray[np.float32]
    coverage: NDArray[np.float32]
    camera: str
    time: float | None


def render_picture(
    stage: Usd.Stage,
    *,
    camera: str | None = None,
    time: float | None = None,
    width: int = 960,
    samples: int = 4,
) -> Picture:
    """Ray-cast the baked illuminance of a results stage.

    camera : prim path; None: the first on the stage, or one framed on the interior
    time : time code of the progressive stage; None: the last
    width : pixels; the height follows from the camera
    samples : rays a pixel
    raises : SceneError where the stage has no baked illuminance or no such camera;
        SettingsError for a width or samples below 1
    """
    for name, value in (("width", width), ("samples", samples)):
        if value < 1:
            raise SettingsError(name, str(value), "at least 1")
    scene = _refined_scene(stage, _read_solved_scene(stage, time))
    baked = BakedPrims(stage, scene)
    last = _last_time(baked, scene)
    time = last if time is None else time
    surfaces = VisibleSurfaces(_surfaces(baked, scene, time))
    seen_by = stage_camera(stage, camera, scene.time_code)
    if seen_by is None:
        seen_by = frame_interior(surfaces, scene.up_axis)
    height = max(1, round(width / seen_by.aspect_ratio))
    domes = [light for light in scene.luminaires if light.shape == "dome"]
    rgb, coverage = _cast_picture(surfaces, seen_by, width, height, samples, domes)
    return Picture(rgb, coverage, seen_by.path, time)


def frame_interior(surfaces: VisibleSurfaces, up_axis: str) -> Camera:
    """The camera, of many in and around the surfaces, that shows most of what is lit."""
    low, high = surfaces.low, surfaces.high
    area = surfaces.areas.sum()
    target = surfaces.areas @ surfaces.middles / area if area > 0 else (low + high) / 2
    candidates = framing_candidates(low, high, target, up_axis)
    return max(candidates, key=lambda camera: _lit_places(surfaces, camera))


def _lit_places(surfaces: VisibleSurfaces, camera: Camera) -> float:
    """How many places of the scene a camera shows lit, times their share of the picture."""
    columns, rows = _SKETCH
    origins, directions = camera.rays(*_pixel_places(columns, rows, slice(0, rows), 1))
    sight = surfaces.see(origins, directions)
    lit = surfaces.luminance(sight).max(axis=1) > 0
    hits = origins[lit] + sight.distance[lit, None] * directions[lit]
    low, high = surfaces.low, surfaces.high
    # A flat scene has one layer of places.
    sides = np.maximum(high - low, 1e-3 * (high - low).max())
    places = np.floor(_PLACES * (hits - low) / sides)
    return float(lit.mean()) * len(np.unique(places, axis=0))


def _cast_picture(
    surfaces: VisibleSurfaces,
    camera: Camera,
    width: int,
    height: int,
    samples: int,
    domes: Sequence[LuminaireDescription],
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    rgb = np.zeros((height, width, 3), np.float32)
    coverage = np.zeros((height, width), np.float32)
    rows_at_once = max(1, _RAYS_AT_ONCE // (width * samples))
    for first in range(0, height, rows_at_once):
        rows = slice(first, min(first + rows_at_once, height))
        origins, directions = camera.rays(*_pixel_places(width, height, rows, samples))
        sight = surfaces.see(origins, directions)
        by_pixel = (rows.stop - rows.start, width, samples)
        luminance = surfaces.luminance(sight)
        if domes:
            beyond = sight.side < 0
            luminance[beyond] = dome_luminance(domes, directions[beyond])
        rgb[rows] = luminance.reshape(*by_pixel, 3).mean(axis=2)
        covered = (sight.side >= 0) | bool(domes)
        coverage[rows] = covered.reshape(by_pixel).mean(axis=2)
    return rgb, coverage


def _pixel_places(
    width: int, height: int, rows: slice, samples: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Places x, y of all samples of some rows, row by row, pixel by pixel, in [0, 1]."""
    index = np.arange(samples) + 0.5
    shift_x, shift_y = index / samples, (index * _GOLDEN_RATIO) % 1.0
    if samples == 1:
        shift_y = shift_x
    row = np.arange(rows.start, rows.stop)
    shape = (len(row), width, samples)
    x = np.broadcast_to((np.arange(width)[:, None] + shift_x) / width, shape)
    y = np.broadcast_to((row[:, None, None] + shift_y) / height, shape)
    return x.ravel(), y.ravel()


def _read_solved_scene(stage: Usd.Stage, time: float | None) -> SceneDescription:
    """The scene as it was solved: without the colours and the time range that the results add.

    time : of results of many frames, the frame; None: the last
    """
    source = Usd.Stage.Open(stage.GetRootLayer(), stage.GetSessionLayer())
    solved_at = Usd.TimeCode.EarliestTime().GetValue()
    settings = SolverSettings()
    for layer in stage.GetUsedLayers():
        provenance = layer.customLayerData.get("isolux")
        if provenance is not None and layer != stage.GetRootLayer():
            solved_at = provenance.get("timeCode", solved_at)
            if "frames" in provenance:
                solved_at = max(provenance["frames"]) if time is None else time
            settings = recorded_settings(provenance)
            source.MuteLayer(layer.identifier)
    return read_stage(source, solved_at, settings)


def _refined_scene(stage: Usd.Stage, scene: SceneDescription) -> SceneDescription:
    """The scene with the triangles that the results put in place of authored faces."""
    time = Usd.TimeCode.EarliestTime() if scene.time_code is None else Usd.TimeCode(scene.time_code)
    transforms = UsdGeom.XformCache(time)
    meshes = []
    for mesh in scene.meshes:
        prim = stage.GetPrimAtPath(mesh.path)
        parents = UsdGeom.PrimvarsAPI(prim).GetPrimvar(SOURCE_FACE) if prim else None
        if parents and parents.HasAuthoredValue():
            to_world = np.array(transforms.GetLocalToWorldTransform(prim)) * scene.meters_per_unit
            mesh = _refined_mesh(mesh, UsdGeom.Mesh(prim), np.array(parents.Get()), to_world)
        meshes.append(mesh)
    return replace(scene, meshes=tuple(meshes))


def _refined_mesh(
    mesh: MeshDescription,
    shown: UsdGeom.Mesh,
    parents: NDArray[np.int32],
    to_world: NDArray[np.float64],
) -> MeshDescription:
    """The mesh as the results show it, each triangle as reflective as the face it is a part of.

    parents : (T,) int32, that face
    to_world : (4, 4) float64, local space to metres, for row vectors
    """
    reflectance, face_count = mesh.reflectance, len(mesh.face_vertex_counts)
    if mesh.cage is not None:
        face_count = len(mesh.cage.topology.counts)
        reflectance = cage_face_means(mesh.cage, reflectance)
    if parents.max(initial=-1) >= face_count:
        raise SceneError(
            mesh.path,
            f"a refinement of face {parents.max()}",
            f"{face_count} faces; the mesh has changed since `isolux solve`",
        )
    points = np.asarray(shown.GetPointsAttr().Get(), np.float64)
    return replace(
        mesh,
        cage=None,
        points=points @ to_world[:3, :3] + to_world[3, :3],
        face_vertex_counts=np.array(shown.GetFaceVertexCountsAttr().Get()),
        face_vertex_indices=np.array(shown.GetFaceVertexIndicesAttr().Get()),
        corner_normals=None,
        hole_faces=np.zeros(0, np.int32),
        reflectance=reflectance[parents] if len(reflectance) > 1 else reflectance,
        emission=mesh.emission
        if mesh.emission is None or len(mesh.emission) == 1
        else mesh.emission[parents],
    )


def _surfaces(baked: BakedPrims, scene: SceneDescription, time: float | None) -> list[Surface]:
    when = Usd.TimeCode.Default() if time is None else Usd.TimeCode(time)
    lit = [_lit_mesh(baked, mesh, when) for mesh in scene.meshes]
    lamps = [_lamp(luminaire) for luminaire in scene.luminaires]
    return lit + [lamp for lamp in lamps if len(lamp.triangles)]


def _lit_mesh(baked: BakedPrims, mesh: MeshDescription, when: Usd.TimeCode) -> Surface:
    corners, faces = mesh_triangles(mesh)
    reflectance = np.broadcast_to(mesh.reflectance, (len(mesh.face_vertex_counts), 3))[faces]

    own = np.zeros((1, 1, 3), np.float32)
    if mesh.emission is not None:
        own = np.broadcast_to(mesh.emission, (len(mesh.face_vertex_counts), 3))[faces][:, None, :]

    def luminance(primvar: str) -> NDArray[np.float32]:
        illuminance = _corner_illuminance(baked, primvar, mesh, when)
        return own + reflectance[:, None, :] * illuminance[corners] / np.float32(np.pi)

    return Surface(
        mesh.points,
        mesh.face_vertex_indices[corners],
        luminance(FRONT_PRIMVAR),
        luminance(BACK_PRIMVAR) if mesh.double_sided else None,
    )


def _lamp(luminaire: LuminaireDescription) -> Surface:
    points, triangles = luminaire_triangles(luminaire)
    if len(triangles) == 0:
        return Surface(points, triangles, np.zeros((0, 3, 3), np.float32))
    luminance = mean_luminance(luminaire).astype(np.float32)
    return Surface(points, triangles, np.broadcast_to(luminance, (len(triangles), 3, 3)))


def _corner_illuminance(
    baked: BakedPrims, name: str, mesh: MeshDescription, when: Usd.TimeCode
) -> NDArray[np.float32]:
    """(C, 3) float32, lx by channel, at the mesh's face corners."""
    found = baked.values(mesh.path, name, when)
    if found is None:
        raise SceneError(mesh.path, f"no primvar {name}", "one; run `isolux solve` again")
    values, interpolation = found
    topology = MeshTopology(mesh.face_vertex_counts, mesh.face_vertex_indices, len(mesh.points))
    on_cage = mesh.cage is not None and interpolation != "constant"
    if mesh.cage is not None and on_cage:
        topology = mesh.cage.topology
    if not topology.has_values(values, interpolation):
        raise SceneError(
            mesh.path,
            f"{len(values)} {interpolation} values of {name}",
            f"{topology.value_count(interpolation)}; the mesh has changed since `isolux solve`",
        )
    if mesh.cage is None or not on_cage:
        return topology.to_corners(values, interpolation)
    indices = None
    if interpolation == "faceVarying":
        values, indices = baked.indexed(mesh.path, name, when)
    return cage_corner_values(mesh.cage, values, interpolation, indices)


def _last_time(baked: BakedPrims, scene: SceneDescription) -> float | None:
    """Time code of the last progressive stage; None where the illuminance has no time samples."""
    prims = {prim.GetPath(): prim for prim in (baked.prim(m.path) for m in scene.meshes) if prim}
    attributes = [prim.GetAttribute(f"primvars:{FRONT_PRIMVAR}") for prim in prims.values()]
    lit = [attribute for attribute in attributes if attribute and attribute.HasValue()]
    if not lit:
        raise SceneError(baked.name, "no baked illuminance", _WANTED)
    times = [attribute.GetTimeSamples() for attribute in lit]
    return max((samples[-1] for samples in times if samples), default=None)
