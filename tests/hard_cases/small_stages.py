"""Small stages as text, solved through the reader and the progressive solver as a user's are."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from usd_scenes.shapes import Shape, rectangle

from isolux.core_scene import build_core_scene
from isolux.scene_description import Finding, SceneDescription
from isolux.settings import SolverSettings
from isolux.solution import LUMINANCE_WEIGHTS, Solution
from isolux.solver import ProgressiveSolver
from isolux.stage_reader import read_stage
from usda_stage import METRES, open_usda

PHOTONS = 40_000
CANDELA = 1000.0
FLUX = 4 * np.pi * CANDELA  # lm, of a point lamp of so many candela
UP = (0.0, 0.0, 1.0)
FLOOR = rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0), 0.5)
Array = NDArray[np.float64]


def mesh(name: str, shape: Shape, reflectance: float = 0.0, extra: str = "") -> str:
    """A shape as a prim. extra : more lines, instead of a line of the same attribute as well"""
    lines = {
        "faceVertexCounts": f"int[] faceVertexCounts = {shape.counts.tolist()}",
        "faceVertexIndices": f"int[] faceVertexIndices = {shape.indices.tolist()}",
        "points": f"point3f[] points = {[tuple(point) for point in shape.points.tolist()]}",
        "subdivisionScheme": 'uniform token subdivisionScheme = "none"',
        "displayColor": f"color3f[] primvars:displayColor = [({reflectance}, {reflectance}, "
        f"{reflectance})]",
    }
    body = "\n".join(line for name, line in lines.items() if name not in extra)
    return f'def Mesh "{name}" {{\n{body}\n{extra}\n}}\n'


def polygons(points: ArrayLike, faces: list[list[int]]) -> Shape:
    """A shape of these faces, whatever their number of corners."""
    counts = np.array([len(face) for face in faces], np.int32)
    return Shape(np.array(points, float), counts, np.concatenate(faces).astype(np.int32))


def sphere_light(
    luminance: float, radius: float, at: ArrayLike, name: str = "Lamp", extra: str = ""
) -> str:
    """luminance : cd/m²"""
    body = f"float inputs:intensity = {luminance}\nfloat inputs:radius = {radius}\n{extra}"
    return placed(f'def SphereLight "{name}"', body, at)


def rect_light(
    luminance: float, size: tuple[float, float], at: ArrayLike, name: str = "Lamp", extra: str = ""
) -> str:
    """Shines down. luminance : cd/m²"""
    body = f"""float inputs:intensity = {luminance}
        float inputs:width = {size[0]}\nfloat inputs:height = {size[1]}\n{extra}"""
    return placed(f'def RectLight "{name}"', body, at)


def point_light(
    luminous_flux: float, at: ArrayLike, name: str = "Lamp", extra: str = "", radius: float = 0.0
) -> str:
    """Alike to all sides. luminous_flux : lm"""
    head = f'def SphereLight "{name}" ( prepend apiSchemas = ["IsoluxLuminaireAPI"] )'
    body = f"""float inputs:isolux:luminousFlux = {luminous_flux}
        float inputs:radius = {radius}\n{extra}"""
    return placed(head, body, at)


def placed(head: str, body: str, at: ArrayLike) -> str:
    """A prim moved to a place, in units of the stage."""
    x, y, z = np.asarray(at, float).tolist()
    return f"""{head} {{\n{body}
        double3 xformOp:translate = ({x}, {y}, {z})
        uniform token[] xformOpOrder = ["xformOp:translate"]\n}}\n"""


def read(text: str, metadata: str = METRES) -> SceneDescription:
    return read_stage(open_usda(text, metadata))


def findings_at(scene: SceneDescription, path: str) -> list[Finding]:
    return [finding for finding in scene.findings if finding.path == path]


def solver_of(scene: SceneDescription | str, method: str = "dept", **settings: Any):
    """By default photons alone; photons=0: until the target error is met."""
    if isinstance(scene, str):
        scene = read(scene)
    chosen = {"photons": PHOTONS, "stages": 1, "threads": 2, "target_error": 0.0} | settings
    if chosen["photons"] == 0:
        chosen["target_error"] = 0.05
    return ProgressiveSolver(scene, SolverSettings(method=method, **chosen))


def solved(scene: SceneDescription | str, method: str = "dept", **settings: Any) -> Solution:
    """The last solution; see solver_of."""
    *_, last = solver_of(scene, method, **settings).stages()
    assert np.isfinite(last.direct).all()
    assert np.isfinite(last.indirect).all()
    assert np.isfinite(last.relative_deviation).all()
    return last


def directly_lit(scene: SceneDescription | str, **settings: Any) -> Solution:
    """By direct lighting, then radiosity where something reflects: no photons, hardly any noise."""
    return solved(scene, "ddl+hpr", photons=0, **settings)


def direct_at_receivers(solution: Solution, path: str) -> tuple[Array, Array, Array]:
    """Of a mesh's front: direct illuminance (n,), where its vertices receive it, their normals.

    That is a little inside of the mesh at its border: see core/illumination_mesh.h.
    """
    scene = build_core_scene(solution.scene, SolverSettings(), 2)
    front = solution.layout(path).front
    values = photometric(solution.direct[front])
    return values, scene.receiver_positions[front], scene.vertex_normals[front].astype(float)


def photometric(colours: NDArray[np.float32]) -> Array:
    return colours.astype(float) @ LUMINANCE_WEIGHTS


def at_corners(solution: Solution, path: str, *, back: bool = False) -> Array:
    """(C,) lx, total, at the face corners in authored order."""
    return photometric(solution.illuminance(path, back=back))


def means(solution: Solution, path: str, *, back: bool = False) -> Array:
    """Area-weighted direct and indirect illuminance of a mesh, lx."""
    light = solution.solved_light
    layout = light.layouts[path]
    side = layout.back if back else layout.front
    areas = light.vertex_areas[side]
    return np.array(
        [areas @ photometric(values[side]) / areas.sum()
         for values in (light.direct, light.indirect)]
    )  # fmt: skip


def mean_everywhere(solution: Solution) -> Array:
    """Area-weighted direct and indirect illuminance of all surfaces, lx."""
    light = solution.solved_light
    areas = light.vertex_areas
    return np.array(
        [areas @ photometric(values[: len(areas)]) / areas.sum()
         for values in (light.direct, light.indirect)]
    )  # fmt: skip


def from_point(candela: float, at: ArrayLike, points: Array, normals: ArrayLike) -> Array:
    """(n,) lx of a point of light: I cosθ / d²."""
    towards = np.asarray(at, float) - points
    distance = np.linalg.norm(towards, axis=1)
    return candela * np.maximum((towards * normals).sum(axis=1), 0.0) / distance**3
