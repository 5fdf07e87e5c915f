"""What reading a prim needs besides the prim: the time, world transforms, and where findings go."""

from __future__ import annotations

import math
import os
import weakref
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Ar, Gf, Sdf, Tf, Usd, UsdGeom

from .attribute_values import is_like
from .errors import SceneError
from .prim_selection import PrimSelection
from .scene_description import Finding, FindingAction
from .settings import SolverSettings
from .skinned_points import Skinning

# A transform that flattens one direction by more than this, relative to the others, is singular.
SINGULAR_SCALE = 1e-12

# Of scales and places, stage units. Single precision times it times the largest unit, cubed, is
# still a number. What is scaled below the least is a point.
LEAST_SCALE, LARGEST_SCALE = 1e-30, 1e30
# m; a picometre, with which no surface is measured.
LEAST_UNIT = 1e-12
LARGEST_UNIT = 1e30  # m
NO_TRANSFORM = "its transform is singular, not finite or not readable"


def singular(matrices: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(N,) bool of (N, 4, 4) transforms for row vectors: flat, not affine or not finite."""
    finite = np.isfinite(matrices).all(axis=(1, 2))
    finite &= (matrices[:, :, 3] == (0, 0, 0, 1)).all(axis=1)
    scales = np.zeros((len(matrices), 3))
    scales[finite] = np.linalg.svd(matrices[finite, :3, :3], compute_uv=False)
    return ~(scales[:, -1] > SINGULAR_SCALE * scales[:, 0])


@dataclass(frozen=True, slots=True)
class Frame:
    """Where the prims below a prototype are drawn, in place of where they lie.

    parent : of the prototype; None: the stage
    matrix : (4, 4) float64, its space to the world, for row vectors, stage units
    source, path : of the prototype, and of its copy in the results
    """

    parent: Usd.Prim | None
    matrix: NDArray[np.float64]
    source: str
    path: str

    def moved(self, matrix: NDArray[np.float64]) -> Frame:
        """The same, and then moved in the world."""
        return replace(self, matrix=self.matrix @ matrix)


class ReadingContext:
    """One reading of one stage.

    time : at which attributes are read; the earliest samples where no time was asked for
    settings : of the solver, some of which say how finely or in which form geometry is read
    threads : for what is done to every point and corner of a mesh
    meters_per_unit : m
    selection : which prims are rendered
    skinning : poses skinned meshes
    findings : grows while the stage is read
    frame : where the prims that are read are drawn; None: where they lie
    """

    def __init__(self, stage: Usd.Stage, time_code: float | None, settings: SolverSettings) -> None:
        self.settings = settings
        self.threads = settings.threads or len(os.sched_getaffinity(0))
        self.time = Usd.TimeCode.EarliestTime() if time_code is None else Usd.TimeCode(time_code)
        self.meters_per_unit = float(UsdGeom.GetStageMetersPerUnit(stage))
        if not LEAST_UNIT <= self.meters_per_unit <= LARGEST_UNIT:
            raise SceneError(
                stage.GetRootLayer().identifier,
                f"metersPerUnit = {self.meters_per_unit:g}",
                f"a number from {LEAST_UNIT:g} to {LARGEST_UNIT:g}",
            )
        self.findings: list[Finding] = []
        self._stage = stage
        self._read: Counter[str] = Counter()
        self._noted: dict[tuple[str, FindingAction], set[Sdf.Path]] = {}
        # Not held in turn: a cycle would keep the stage open.
        own = weakref.proxy(self)
        self.selection = PrimSelection(stage, own)
        self.skinning = Skinning(own)
        self.frame: Frame | None = None
        self._transforms = UsdGeom.XformCache(self.time)
        self._broken: list[Sdf.Path] = []
        self._still: set[Sdf.Path] = set()

    def note(
        self, prim: Usd.Prim | Sdf.Path, kind: str, action: FindingAction, reason: str
    ) -> None:
        """Record a finding about a prim."""
        path = prim.GetPath() if isinstance(prim, Usd.Prim) else prim
        self.findings.append(Finding(str(path), kind, action, reason))
        found = prim if isinstance(prim, Usd.Prim) else self._stage.GetPrimAtPath(path)
        if found and not found.IsPseudoRoot():
            self._noted.setdefault((_type_of(found), action), set()).add(path)

    def count_read(self, prim: Usd.Prim) -> None:
        """Count a prim as a surface or a luminaire that was read."""
        self._read[_type_of(prim)] += 1

    def prim_counts(self) -> dict[str, dict[str, int]]:
        """By type of prim: how many were read, skipped, approximated, repaired, noted."""
        counts: dict[str, dict[str, int]] = {kind: {"read": n} for kind, n in self._read.items()}
        for (kind, action), paths in self._noted.items():
            counts.setdefault(kind, {})[action] = len(paths)
        return dict(sorted(counts.items()))

    def value(self, prim: Usd.Prim, name: str, default: Any) -> Any:
        """The attribute's value at the time of reading, or `default` where it has none.

        Raises SceneError where a number, numbers as many or an asset are wanted, as the default is,
        and there are none.
        """
        found = prim.GetAttribute(name).Get(self.time) if prim.HasAttribute(name) else None
        if found is None:
            return default
        if not is_like(found, default):
            kind = "an asset" if isinstance(default, Sdf.AssetPath) else "numbers"
            told = f"{name} = {found!r:.60}"
            raise SceneError(str(prim.GetPath()), told, kind)
        return found

    def world_matrix(
        self, prim: Usd.Prim, singular_too: bool = False
    ) -> NDArray[np.float64] | None:
        """(4, 4) float64 local-to-world for row vectors, in stage units; None where there is none.

        None where it is not finite or beyond LARGEST_SCALE, made of operations that USD can't read,
        or singular.
        singular_too : where it is singular, it is given all the same
        """
        if any(prim.GetPath().HasPrefix(broken) for broken in self._broken):
            return None
        try:
            transform = self._transforms.GetLocalToWorldTransform(prim)
            if self.frame is not None:
                parent = self.frame.parent or prim.GetStage().GetPseudoRoot()
                relative, _ = self._transforms.ComputeRelativeTransform(prim, parent)
                transform = relative * Gf.Matrix4d(self.frame.matrix)
        except Tf.ErrorException:
            # USD raises once, and takes the prims below as untransformed from then on.
            self._broken.append(_unreadable_transform(prim, self.time))
            return None
        matrix = np.array(transform)
        if transform.GetColumn(3) != (0, 0, 0, 1) or not all(map(math.isfinite, matrix.flat)):
            return None
        # The least scale over the greatest is at least the determinant over the size cubed.
        size = math.hypot(*matrix[:3, :3].flat)
        if max(size, *map(abs, matrix[3, :3])) > LARGEST_SCALE:
            return None
        if singular_too:
            return matrix
        if size < LEAST_SCALE:
            return None
        if abs(transform.GetDeterminant3()) > SINGULAR_SCALE * size * size * size > 0:
            return matrix
        scales = np.linalg.svd(matrix[:3, :3], compute_uv=False)
        return matrix if scales[-1] > SINGULAR_SCALE * scales[0] else None

    def in_metres(self, matrix: NDArray[np.float64]) -> NDArray[np.float64]:
        """A matrix to world space in stage units, as one to world space in metres."""
        scaled = matrix.copy()
        scaled[:, :3] *= self.meters_per_unit
        return scaled

    def note_changing_visibility(self, prim: Usd.Prim) -> None:
        """Say that a prim comes and goes, and at which time it is read."""
        visibility = prim.GetAttribute("visibility")
        if visibility and may_change(visibility.ValueMightBeTimeVarying):
            reason = f"animated visibility read {self._when()}"
            self.note(prim, "animation", "noted", reason)

    def _when(self) -> str:
        return "at the earliest time" if self.time.IsEarliestTime() else f"at time {self.time}"

    def note_animation(self, prim: Usd.Prim, attributes: list[Usd.Attribute]) -> None:
        """Say that a prim moves or changes, and at which time it is read.

        A moving transform is reported once, at the prim that moves.
        """
        when = self._when()
        animated = [a.GetName() for a in attributes if a and may_change(a.ValueMightBeTimeVarying)]
        if animated:
            more = f" and {len(animated) - 3} more" if len(animated) > 3 else ""
            reason = f"animated {', '.join(animated[:3])}{more} read {when}"
            self.note(prim, "animation", "noted", reason)
        while prim and prim.GetPath() not in self._still:
            self._still.add(prim.GetPath())
            if (
                prim.IsA(UsdGeom.Xformable)
                and prim.GetPath() not in self._broken
                and may_change(UsdGeom.Xformable(prim).TransformMightBeTimeVarying)
            ):
                self.note(prim, "animation", "noted", f"animated transform read {when}")
            prim = prim.GetParent()


def may_change(asked: Callable[[], bool]) -> bool:
    """What USD says of an animation; yes where it can't tell, as of a time that is no number."""
    try:
        return asked()
    except Tf.ErrorException:
        return True


def _unreadable_transform(prim: Usd.Prim, time: Usd.TimeCode) -> Sdf.Path:
    """The prim, at or above this one, whose own transform USD can't read."""
    above = prim
    while above:
        try:
            if above.IsA(UsdGeom.Xformable):
                UsdGeom.Xformable(above).GetLocalTransformation(time)
        except Tf.ErrorException:
            return above.GetPath()
        above = above.GetParent()
    return prim.GetPath()


def read_asset(path: Sdf.AssetPath, at_most: int | None = None) -> bytes | None:
    """The bytes behind a resolved asset path, out of a usdz package as well; None: not there.

    at_most : number of bytes to read; None: all
    """
    resolved = path.resolvedPath
    asset = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(resolved)) if resolved else None
    if not asset:
        return None
    size = asset.GetSize() if at_most is None else min(at_most, asset.GetSize())
    return bytes(asset.Read(size, 0)) if size else b""  # nothing to read is an error to USD


def _type_of(prim: Usd.Prim) -> str:
    return str(prim.GetTypeName()) or "untyped"


def triple(value: Iterable[float]) -> str:
    """A colour as text for messages."""
    return "(" + ", ".join(f"{channel:.6g}" for channel in value) + ")"
