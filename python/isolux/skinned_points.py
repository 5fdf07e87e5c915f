"""Points of meshes that a skeleton or blend shapes deform, posed at the time of reading.

Skinning, inbetweens and the order of joints are UsdSkel's own: points end in the skeleton's space,
and the skeleton's transform places them, not the mesh's.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel, Vt

from .mesh_topology import MeshTopology

if TYPE_CHECKING:
    from .reading_context import ReadingContext

# Prototypes of point instancers may be overs or classes.
_WITH_PROTOTYPES = Usd.TraverseInstanceProxies(Usd.PrimIsActive & Usd.PrimIsLoaded)
_SKINNING_PRIMVARS = ("primvars:skel:jointIndices", "primvars:skel:joints")


@dataclass(frozen=True, slots=True)
class Pose:
    """A mesh as its skeleton and blend shapes hold it.

    points : (P, 3) float32
    to_world : (4, 4) float64, of the points, in stage units
    turn_normals : from (C, 3) float64 normals of the mesh at rest, by face corner, to those of the
        pose; None: blend shapes have moved points, and no normal of the rest pose holds
    """

    points: NDArray[np.float32]
    to_world: NDArray[np.float64]
    turn_normals: Callable[[NDArray[np.float64]], NDArray[np.float64]] | None


class Skinning:
    """The skeletons of one stage, each looked at once; none before the first skinned mesh."""

    def __init__(self, context: ReadingContext) -> None:
        self._context = context
        self._cache = UsdSkel.Cache()
        self._skeletons: dict[Sdf.Path, UsdSkel.Skeleton] = {}
        self._roots: set[Sdf.Path] = set()

    def pose(
        self, mesh: UsdGeom.Mesh, points: NDArray[np.float32], topology: MeshTopology
    ) -> Pose | None:
        """A skinned mesh's pose; None for any other, or where it has to stay at rest.

        points : (P, 3) float32, at rest
        """
        prim = mesh.GetPrim()
        root = UsdSkel.Root.Find(prim)
        skeleton = self._bound_skeleton(root, prim) if root else None
        if not skeleton:
            self._note_unbound(prim)
            return None
        query = self._cache.GetSkinningQuery(prim)
        skeleton_query = self._cache.GetSkelQuery(skeleton)
        own_matrix = self._context.world_matrix(prim)
        if not skeleton_query or own_matrix is None:
            self._rest(prim, f"its skeleton {skeleton.GetPath()} can't be used")
            return None
        posed = Vt.Vec3fArray.FromNumpy(points)
        shaped = query.HasBlendShapes() and self._blend(prim, query, skeleton_query, posed)
        if not query.HasJointInfluences():
            if prim.GetAttribute(_SKINNING_PRIMVARS[0]).HasAuthoredValue():
                self._rest(prim, "its joint influences can't be used")
            else:
                self._note(prim, skeleton)
            return Pose(np.array(posed), own_matrix, None if shaped else _unturned)
        to_world = self._context.world_matrix(skeleton.GetPrim())
        joints = skeleton_query.ComputeSkinningTransforms(self._context.time)
        if to_world is None or not joints:
            self._rest(prim, f"its skeleton {skeleton.GetPath()} has no pose")
            return None
        if query.IsRigidlyDeformed():
            skinned = query.ComputeSkinnedTransform(joints, self._context.time)
            moved = np.array(skinned)
            if not np.isfinite(moved).all() or skinned.GetDeterminant() == 0:
                self._rest(prim, "its joint influences don't fit its skeleton")
                return None
            self._note(prim, skeleton)
            return Pose(np.array(posed), moved @ to_world, None if shaped else _unturned)
        if not query.ComputeSkinnedPoints(joints, posed, self._context.time):
            self._rest(prim, "its joint influences don't fit its points or its skeleton")
            return None
        self._note(prim, skeleton)

        def turn(normals: NDArray[np.float64]) -> NDArray[np.float64]:
            ordered = _in_order_of(query.GetJointOrder(), skeleton_query.GetJointOrder(), joints)
            return _skinned_normals(
                query, ordered, self._context.time, topology, normals.astype(np.float32)
            )

        return Pose(np.array(posed), to_world, None if shaped else turn)

    def _bound_skeleton(self, root: UsdSkel.Root, prim: Usd.Prim) -> UsdSkel.Skeleton | None:
        """The skeleton that deforms a prim below a SkelRoot."""
        if root.GetPath() not in self._roots:
            self._roots.add(root.GetPath())
            self._cache.Populate(root, _WITH_PROTOTYPES)
            for binding in self._cache.ComputeSkelBindings(root, _WITH_PROTOTYPES):
                for query in binding.GetSkinningTargets():
                    self._skeletons[query.GetPrim().GetPath()] = binding.GetSkeleton()
        return self._skeletons.get(prim.GetPath())

    def _blend(
        self,
        prim: Usd.Prim,
        query: UsdSkel.SkinningQuery,
        skeleton: UsdSkel.SkeletonQuery,
        points: Vt.Vec3fArray,
    ) -> bool:
        """Move points by the blend shapes in place; whether any has moved."""
        animation = skeleton.GetAnimQuery()
        weights = animation.ComputeBlendShapeWeights(self._context.time) if animation else None
        mapper = query.GetBlendShapeMapper()
        if weights and mapper:
            weights = mapper.Remap(weights)
        if not weights or not any(weights):
            return False
        shapes = UsdSkel.BlendShapeQuery(UsdSkel.BindingAPI(prim))
        moved = shapes.ComputeDeformedPoints(
            *shapes.ComputeSubShapeWeights(weights),
            shapes.ComputeBlendShapePointIndices(),
            shapes.ComputeSubShapePointOffsets(),
            points,
        )
        if not moved:
            reason = "read without its blend shapes: they don't fit its points"
            self._context.note(prim, "BlendShape", "approximated", reason)
        return bool(moved)

    def _note(self, prim: Usd.Prim, skeleton: UsdSkel.Skeleton) -> None:
        time = self._context.time
        when = "the earliest time" if time.IsEarliestTime() else f"time {time}"
        reason = f"posed by {skeleton.GetPath()} at {when}"
        self._context.note(prim, "SkelBindingAPI", "noted", reason)

    def _note_unbound(self, prim: Usd.Prim) -> None:
        if any(prim.HasAttribute(name) for name in _SKINNING_PRIMVARS):
            self._rest(prim, "no skeleton is bound to it by SkelBindingAPI below a SkelRoot")
        elif prim.GetRelationship("skel:blendShapeTargets").HasAuthoredTargets():
            reason = "read without its blend shapes: no skeleton is bound to it below a SkelRoot"
            self._context.note(prim, "BlendShape", "approximated", reason)

    def _rest(self, prim: Usd.Prim, why: str) -> None:
        reason = f"skinned mesh read in its rest pose: {why}"
        self._context.note(prim, "SkelBindingAPI", "approximated", reason)


def _unturned(normals: NDArray[np.float64]) -> NDArray[np.float64]:
    return normals


def _in_order_of(
    wanted: Sequence[str] | None, order: Sequence[str], joints: Sequence[Gf.Matrix4d]
) -> list[Gf.Matrix4d]:
    """Transforms of joints in the order that a mesh gives of its own, if it does.

    One that the skeleton hasn't stays where it was bound; names of which it has none are ignored.
    """
    if not wanted or not set(wanted) & set(order):
        return list(joints)
    by_name = dict(zip(order, joints, strict=True))
    return [by_name.get(name, Gf.Matrix4d(1)) for name in wanted]


def _skinned_normals(
    query: UsdSkel.SkinningQuery,
    joints: list[Gf.Matrix4d],
    time: Usd.TimeCode,
    topology: MeshTopology,
    normals: NDArray[np.float32],
) -> NDArray[np.float64]:
    """(C, 3) float64 by face corner, in the skeleton's space.

    joints : skinning transforms in the mesh's own order of joints
    """
    count = query.GetNumInfluencesPerComponent()
    indices, weights = query.ComputeVaryingJointInfluences(topology.point_count, time)
    at_corners = [
        np.asarray(values).reshape(-1, count)[topology.indices].ravel()
        for values in (indices, weights)
    ]
    turned = Vt.Vec3fArray.FromNumpy(normals)
    UsdSkel.SkinNormals(
        query.GetSkinningMethod(),
        _normal_matrix(query.GetGeomBindTransform(time)),
        Vt.Matrix3dArray([_normal_matrix(joint) for joint in joints]),
        Vt.IntArray.FromNumpy(at_corners[0]),
        Vt.FloatArray.FromNumpy(at_corners[1]),
        count,
        turned,
        True,
    )
    return np.array(turned, np.float64)


def _normal_matrix(matrix: Gf.Matrix4d) -> Gf.Matrix3d:
    """The inverse transpose, by which normals turn."""
    upper = Gf.Matrix3d(*(matrix[row][column] for row in range(3) for column in range(3)))
    return upper.GetInverse().GetTranspose()
