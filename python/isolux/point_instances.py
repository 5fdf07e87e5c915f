"""Reads the arrays of one UsdGeomPointInstancer: which prototype stands where.

A bad array never sizes anything: what is allocated grows with the arrays that the file holds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom

from .attribute_values import number_array
from .reading_context import ReadingContext, singular


@dataclass(frozen=True, slots=True)
class PointInstances:
    """The instances of a point instancer that are drawn.

    count : of all its instances, drawn or not
    numbers : (N,) int64, place of each drawn one in the instancer's arrays, rising
    prototype : (N,) int64, which target of the prototypes relationship
    matrices : (N, 4, 4) float64, for row vectors, stage units: where it stands in the instancer's
        space, the prototype's own transform not included
    """

    count: int
    numbers: NDArray[np.int64]
    prototype: NDArray[np.int64]
    matrices: NDArray[np.float64]


def read_point_instances(prim: Usd.Prim, context: ReadingContext) -> PointInstances | None:
    """What a point instancer draws; None, with a finding, where its arrays can't be used.

    Raises ArrayError where an array is none.
    """
    instancer = UsdGeom.PointInstancer(prim)
    context.note_animation(prim, list(_animated(instancer)))
    indices = number_array(instancer.GetProtoIndicesAttr(), context.time, np.int64)
    targets = len(instancer.GetPrototypesRel().GetForwardedTargets())
    count = len(indices)
    positions = number_array(instancer.GetPositionsAttr(), context.time, np.float64, columns=3)
    scales = number_array(instancer.GetScalesAttr(), context.time, np.float64, columns=3)
    orientations = _orientations(instancer, context)
    for name, values in (
        ("positions", positions),
        ("scales", scales),
        ("orientations", orientations),
    ):
        optional = name != "positions" and len(values) == 0
        if len(values) != count and not optional:
            reason = f"{len(values)} {name}, {count} protoIndices: none of it is drawn"
            context.note(prim, "PointInstancer", "skipped", reason)
            return None
    drawn = _unmasked(instancer, count, context)
    known = (indices >= 0) & (indices < targets)
    if not known.all():
        reason = (
            f"{np.count_nonzero(~known)} protoIndices such as {indices[~known][0]} name none of "
            f"{targets} prototypes: those instances are not drawn"
        )
        context.note(prim, "protoIndices", "skipped", reason)
    numbers = np.flatnonzero(drawn & known)
    matrices = _matrices(
        positions[numbers],
        scales[numbers] if len(scales) else None,
        orientations[numbers] if len(orientations) else None,
    )
    flat = singular(matrices)
    if flat.any():
        reason = (
            f"{np.count_nonzero(flat)} instances such as {numbers[flat][0]} with a transform that "
            "is singular or not finite"
        )
        context.note(prim, "PointInstancer", "skipped", reason)
    numbers, matrices = numbers[~flat], matrices[~flat]
    return PointInstances(count, numbers, indices[numbers], matrices)


def _animated(instancer: UsdGeom.PointInstancer) -> tuple[Usd.Attribute, ...]:
    return (
        instancer.GetProtoIndicesAttr(),
        instancer.GetPositionsAttr(),
        instancer.GetOrientationsAttr(),
        instancer.GetOrientationsfAttr(),
        instancer.GetScalesAttr(),
        instancer.GetInvisibleIdsAttr(),
    )


def _orientations(
    instancer: UsdGeom.PointInstancer, context: ReadingContext
) -> NDArray[np.float64]:
    """(n, 4) float64 quaternions, real part last; those of full precision come first."""
    for attribute in (instancer.GetOrientationsfAttr(), instancer.GetOrientationsAttr()):
        found = number_array(attribute, context.time, np.float64, columns=4)
        if len(found):
            return found
    return np.zeros((0, 4))


def _unmasked(
    instancer: UsdGeom.PointInstancer, count: int, context: ReadingContext
) -> NDArray[np.bool_]:
    """(count,) bool: neither in invisibleIds nor in inactiveIds."""
    prim = instancer.GetPrim()
    hidden = number_array(instancer.GetInvisibleIdsAttr(), context.time, np.int64).tolist()
    inactive = prim.GetMetadata("inactiveIds")
    if isinstance(inactive, Sdf.Int64ListOp):
        hidden += inactive.GetAppliedItems()
    if not hidden:
        return np.ones(count, bool)
    ids = number_array(instancer.GetIdsAttr(), context.time, np.int64)
    if len(ids) != count:
        if len(ids):
            reason = f"{len(ids)} ids, {count} protoIndices: masked by place in the array instead"
            context.note(prim, "ids", "repaired", reason)
        ids = np.arange(count)
    return ~np.isin(ids, np.array(hidden, np.int64))


def _matrices(
    positions: NDArray[np.float64],
    scales: NDArray[np.float64] | None,
    orientations: NDArray[np.float64] | None,
) -> NDArray[np.float64]:
    """(N, 4, 4) float64: scale, then turn, then move; not finite where what is authored isn't."""
    matrices = np.zeros((len(positions), 4, 4))
    matrices[:, :3, :3] = np.eye(3) if orientations is None else _rotations(orientations)
    if scales is not None:
        matrices[:, :3, :3] *= scales[:, :, None]
    matrices[:, 3, :3] = positions
    matrices[:, 3, 3] = 1.0
    return matrices


def _rotations(quaternions: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 3, 3) float64 for row vectors; of another length than 1 as USD takes them, GfMatrix4d."""
    x, y, z, w = quaternions.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)],
        [2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)],
        [2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1)
