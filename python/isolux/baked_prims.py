"""Finds the baked primvars of a mesh: on its own prim, or on the instance that stands for it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from .instanced_results import instance_of_meshes
from .scene_description import SceneDescription


class BakedPrims:
    """Where a results stage keeps the light of a scene's meshes.

    scene : as it was solved
    """

    def __init__(self, stage: Usd.Stage, scene: SceneDescription) -> None:
        self.name = stage.GetRootLayer().identifier
        self._stage = stage
        self._instances = {
            path: (item.path, number if item.copies is not None else None)
            for path, (item, number) in instance_of_meshes(scene).items()
            if _keeps_instances(stage.GetPrimAtPath(item.path))
        }

    def prim(self, mesh: str) -> Usd.Prim:
        """The prim with the primvars of the mesh at a path; invalid where there is none."""
        path, _ = self._instances.get(mesh, (mesh, None))
        return self._stage.GetPrimAtPath(path)

    def values(
        self, mesh: str, name: str, when: Usd.TimeCode
    ) -> tuple[NDArray[np.float32], str] | None:
        """(n, 3) float32 of a colour and its interpolation on the mesh; None: not baked."""
        prim = self.prim(mesh)
        primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar(name) if prim else None
        baked = primvar.ComputeFlattened(when) if primvar else None
        if primvar is None or baked is None:
            return None
        values = np.asarray(baked, np.float32).reshape(-1, 3)
        _, number = self._instances.get(mesh, (mesh, None))
        if number is None:
            return values, str(primvar.GetInterpolation())
        own = values[number : number + 1]
        return (own, "constant") if len(own) else None

    def indexed(
        self, mesh: str, name: str, when: Usd.TimeCode
    ) -> tuple[NDArray[np.float32], NDArray[np.int32] | None]:
        """(n, 3) float32 of a baked colour, and which of them each corner has; None: in order."""
        primvar = UsdGeom.PrimvarsAPI(self.prim(mesh)).GetPrimvar(name)
        indices = np.asarray(primvar.GetIndices(when), np.int32) if primvar.IsIndexed() else None
        return np.asarray(primvar.Get(when), np.float32).reshape(-1, 3), indices


def _keeps_instances(prim: Usd.Prim) -> bool:
    """Whether the results left an instance or a point instancer what it was."""
    return bool(prim) and (prim.IsInstance() or prim.IsA(UsdGeom.PointInstancer))
