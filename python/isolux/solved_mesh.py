"""The mesh that is solved on, and what solutions tell of it at the scene's own vertices."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _core
from .components import Array
from .core_scene import mesh_layouts
from .illumination import Illumination, relative_deviation
from .mesh_division import MeshDivision, scene_layouts
from .scene_description import SceneDescription
from .schedule import StagePlan
from .solution import DividedLight, ProgressiveStage, RefinedMesh, Solution


class SolvedMesh:
    """Large elements may be divided, so that N vertices are solved for the V of the scene.

    layouts, scene_layouts : where vertices lie, by mesh path, among the N and among the V
    areas, scene_areas : (N,) and (V,) float64, m^2, of which each vertex tells the light
    """

    def __init__(self, scene: SceneDescription, core_scene: _core.Scene) -> None:
        self._scene = scene
        self._vertex_areas: NDArray[np.float64] = core_scene.vertex_areas
        self._division = MeshDivision.of(core_scene)
        self.layouts = mesh_layouts(scene, core_scene)
        self.areas: NDArray[np.float64] = core_scene.told_areas
        self.scene_layouts = scene_layouts(self.layouts) if self._division else self.layouts
        self.scene_areas = self.at_scene(self.areas)

    def at_scene(self, values: NDArray[Any]) -> NDArray[Any]:
        """Of the N values those of the scene's own vertices."""
        return values if self._division is None else values[self._division.vertices]

    def solution(
        self,
        stage: ProgressiveStage,
        steps: Sequence[StagePlan],
        light: Illumination,
        adaptive: tuple[RefinedMesh, Array, Array] | None,
        with_elements: bool,
    ) -> Solution:
        """What is told of the light after a stage.

        adaptive : the adaptive mesh with direct light and its error there; None: not yet
        with_elements : the solution brings its elements with it, adaptive or not
        """
        refined, direct, direct_error = adaptive or (None, light.direct, light.direct_error)
        if refined is None and self._division and with_elements:
            refined = self._division.unsplit()
        indirect, indirect_error = light.indirect, light.indirect_error
        if refined is not None:
            indirect = refined.interpolate(indirect)
            indirect_error = refined.interpolate(indirect_error)
        divided = None
        if self._division is not None:
            divided = DividedLight(
                self.layouts,
                light.direct,
                light.indirect,
                relative_deviation(light.total, light.direct_error, light.indirect_error),
                self._vertex_areas,
            )
            order = self._division.order(refined)
            direct, direct_error = direct[order], direct_error[order]
            indirect, indirect_error = indirect[order], indirect_error[order]
            refined = refined and self._division.over_scene(refined)
        return Solution(
            stage=stage,
            scene=self._scene,
            layouts=self.scene_layouts,
            direct=direct,
            indirect=indirect,
            relative_deviation=relative_deviation(direct + indirect, direct_error, indirect_error),
            support_radius=self.at_scene(light.support_radius),
            vertex_areas=self.scene_areas,
            refined=refined,
            divided=divided,
            steps=tuple(steps),
        )
