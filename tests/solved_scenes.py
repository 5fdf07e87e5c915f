"""Small scenes from arrays, solved by the whole progressive solver."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hand_built import scene_of
from isolux.scene_description import LuminaireDescription, MeshDescription
from isolux.settings import SolverSettings
from isolux.solution import LUMINANCE_WEIGHTS, Solution
from isolux.solver import ProgressiveSolver

Array = NDArray[np.float64]


def solver_of(
    meshes: Sequence[MeshDescription], luminaires: Sequence[LuminaireDescription], **settings: Any
) -> ProgressiveSolver:
    """settings : fields of SolverSettings; photons: no other stopping criterion"""
    photons = settings.pop("photons", None)
    chosen = SolverSettings(**settings).with_budget(photons=photons)
    return ProgressiveSolver(replace(scene_of(meshes), luminaires=tuple(luminaires)), chosen)


def solved(
    meshes: Sequence[MeshDescription], luminaires: Sequence[LuminaireDescription], **settings: Any
) -> Solution:
    """The last stage."""
    *_, last = solver_of(meshes, luminaires, **settings).stages()
    return last


def photometric(solution: Solution, component: str = "total") -> Array:
    """(V,) lx. component : "direct", "indirect" or "total" """
    direct, indirect = (
        light.astype(float) @ LUMINANCE_WEIGHTS for light in (solution.direct, solution.indirect)
    )
    return {"direct": direct, "indirect": indirect, "total": direct + indirect}[component]


def mean(solution: Solution, component: str = "total", path: str | None = None) -> float:
    """Area-weighted, lx, over the front of a mesh or, without a path, all vertices."""
    of = slice(None) if path is None else solution.layout(path).front
    values = photometric(solution, component)[of]
    return float(np.average(values, weights=solution.vertex_areas[of]))
