"""The scenes of `coverage.py`, with what is known of the light at their vertices."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from reference import DIRECT, INDIRECT, path_traced_reference

from isolux import _core
from isolux.core_scene import build_core_scene
from isolux.scene_description import (
    GoniometricDiagram,
    LuminaireDescription,
    MeshDescription,
    SceneDescription,
)
from isolux.settings import SolverSettings
from isolux.solved_mesh import SolvedMesh
from isolux.stage_reader import read_stage

sys.path.insert(0, str(Path(__file__).parents[1]))  # the scene generators
from usd_scenes.box_room.generate import generate as generate_box_room
from usd_scenes.cornell_box.generate import generate as generate_cornell_box
from usd_scenes.shapes import Shape, rectangle
from usd_scenes.study.generate import generate as generate_study

LAMP_HEIGHT, BLOCKER_HEIGHT = 3.0, 1.5  # m

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Case:
    """A scene and its light at the vertices.

    core : as it stands, of V vertices, with which radiosity begins
    solved : its large elements divided, as for all other methods
    direct, indirect : (V,) lx, photometric; nan where there is no light to know
    direct_noise, indirect_noise : (V,) lx, standard errors of these
    """

    scene: SceneDescription
    core: _core.Scene
    solved: _core.Scene
    direct: Array
    indirect: Array
    direct_noise: Array
    indirect_noise: Array

    @property
    def places(self) -> NDArray[np.int64]:
        """(V,) of the scene's vertices in what is solved."""
        solved = SolvedMesh(self.scene, self.solved)
        return solved.at_scene(np.arange(self.solved.vertex_count))


def shadowed_floor(folder: Path, cache: Path | None) -> Case:
    """A black floor under a point lamp of 1000 cosθ cd, with a blocker's shadow: closed form."""
    gamma = np.radians(np.arange(0.0, 90.5, 0.5))
    lamp = LuminaireDescription(
        path="/Lamp",
        shape="sphere",
        origin=np.array([0.0, 0.0, LAMP_HEIGHT]),
        axes=np.eye(3),
        size=np.array([1e-5, 0.0]),
        colour=np.ones(3),
        luminous_flux=1000 * np.pi,
        diagram=GoniometricDiagram(gamma, np.zeros(1), np.cos(gamma)[None]),
    )
    meshes = (
        _mesh("/Floor", rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0), 0.1), 0.0),
        _mesh(
            "/Blocker",
            rectangle((-0.46, -0.46, BLOCKER_HEIGHT), (0.89, 0, 0), (0, 0.67, 0), 0.2),
            0.0,
        ),
    )
    scene = SceneDescription(meshes, (lamp,), (), 1.0, "Z", None)
    core = build_core_scene(scene, SolverSettings(), 1)
    at = core.receiver_positions
    height = LAMP_HEIGHT - at[:, 2]
    across = at[:, :2] * ((LAMP_HEIGHT - BLOCKER_HEIGHT) / LAMP_HEIGHT)
    hidden = (np.abs(across - [-0.015, -0.125]) < [0.445, 0.335]).all(axis=1) & (at[:, 2] < 0.1)
    squared = (at[:, :2] ** 2).sum(axis=1) + height**2
    direct = np.where(hidden, 0.0, 1000 * height**2 / squared**2)
    none = np.zeros(len(direct))
    return Case(scene, core, _divided(scene), direct, none, none, none)


def _traced(
    generate: Callable[[Path], None], strata: int, batches: int = 16
) -> Callable[[Path, Path | None], Case]:
    """A generated stage; the truth is path-traced at all of its vertices."""

    def make(folder: Path, cache: Path | None) -> Case:
        path = folder / "stage.usdc"
        generate(path)
        scene = read_stage(path)
        core = build_core_scene(scene, SolverSettings(), 1)
        count = int(core.vertex_count)
        truth = path_traced_reference(scene, core, count, batches, strata, cache=cache)
        parts = []
        for part in (DIRECT, INDIRECT):
            for values in truth.luminance_pair(part):
                full = np.full(count, np.nan)
                full[truth.vertices] = values
                parts.append(full)
        return Case(scene, core, _divided(scene), parts[0], parts[2], parts[1], parts[3])

    return make


def _divided(scene: SceneDescription) -> _core.Scene:
    return build_core_scene(scene, SolverSettings(), 1, divide=True)


def _mesh(path: str, shape: Shape, reflectance: float) -> MeshDescription:
    return MeshDescription(
        path=path,
        points=np.asarray(shape.points, np.float64),
        face_vertex_counts=np.asarray(shape.counts, np.int32),
        face_vertex_indices=np.asarray(shape.indices, np.int32),
        corner_normals=None,
        hole_faces=np.zeros(0, np.int32),
        reflectance=np.full((1, 3), reflectance, np.float32),
        double_sided=False,
        flip_winding=False,
    )


CASES: dict[str, Callable[[Path, Path | None], Case]] = {
    "shadowed_floor": shadowed_floor,
    "box_room": _traced(lambda path: generate_box_room(path, 0.5, cells=8), 24),
    "cornell_small": _traced(lambda path: generate_cornell_box(path, density=0.1), 32, 128),
    "study": _traced(lambda path: generate_study(path, step=0.3), 20, 160),
}
