"""Reads one polygon mesh of a stage: points in metres, faces, normals, orientation.

Subdivision surfaces are refined to their limit surface, skinned meshes as `skinned_points` poses
them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from . import _core
from .attribute_values import ArrayError, number_array
from .materials import MaterialReader
from .mesh_topology import MeshTopology
from .reading_context import NO_TRANSFORM, ReadingContext
from .scene_description import MeshDescription
from .skinned_points import Pose
from .subdivision_reader import on_limit_surface, refined_surface
from .unreadable_prims import TOO_FAR

# Faces on which authored normals are compared with the winding: enough to tell a majority.
NORMAL_CHECK_FACES = 2000
# From this share of opposed normals on, the winding is wrong and not some of the normals.
TURNED_SHARE = 0.95


def read_mesh(
    prim: Usd.Prim, context: ReadingContext, materials: MaterialReader
) -> MeshDescription | None:
    """A mesh prim as arrays; None where it can't be used, with a finding that says why.

    Raises SceneError where its reflectance is none, ArrayError where an array is none.
    """
    mesh = UsdGeom.Mesh(prim)
    to_world = context.world_matrix(prim)
    if to_world is None:
        context.note(prim, "Mesh", "skipped", NO_TRANSFORM)
        return None
    points = number_array(mesh.GetPointsAttr(), context.time, np.float32, columns=3)
    world = _placed(points, to_world, context)
    if world is None:
        context.note(prim, "Mesh", "skipped", "points that are NaN, infinite or over 10⁹ m away")
        return None
    topology = MeshTopology(
        number_array(mesh.GetFaceVertexCountsAttr(), context.time, np.int32),
        number_array(mesh.GetFaceVertexIndicesAttr(), context.time, np.int32),
        len(points),
    )
    survey = topology.survey(context.threads)
    fault = topology.fault(survey)
    if fault:
        context.note(prim, "Mesh", "skipped", fault)
        return None
    if survey.degenerate_faces:
        reason = (
            f"{survey.degenerate_faces} faces without area: under 3 corners or a point used twice"
        )
        context.note(prim, "Mesh", "repaired", reason)
    if survey.greatest_count > _core.MOST_EAR_CORNERS:
        reason = f"a face of {survey.greatest_count} corners, taken as if it were convex"
        context.note(prim, "Mesh", "approximated", reason)

    own_space = context.in_metres(to_world)
    pose = context.skinning.pose(mesh, points, topology)
    if pose:
        to_world = pose.to_world
        world = _placed(pose.points, to_world, context)
        if world is None:
            context.note(prim, "Mesh", "skipped", f"posed {TOO_FAR}")
            return None
    mirrored = bool(np.linalg.det(to_world[:3, :3]) < 0)
    left_handed = mesh.GetOrientationAttr().Get(context.time) == UsdGeom.Tokens.leftHanded
    flip_winding = left_handed != mirrored
    _note_what_is_not_read(mesh, context)
    normals = None
    scheme = mesh.GetSubdivisionSchemeAttr().Get(context.time)
    if scheme == UsdGeom.Tokens.none:
        normals = _corner_normals(mesh, topology, to_world, context, pose)
    if normals is not None:
        opposed = _share_against_winding(normals, topology, world, flip_winding)
        if opposed >= TURNED_SHARE:
            reason = "its normals point to the back of its faces: the front is taken from them"
            context.note(prim, "orientation", "repaired", reason)
            flip_winding = not flip_winding
        elif opposed > 0.5:
            reason = "most point to the back of their faces: geometric ones instead"
            context.note(prim, "normals", "repaired", reason)
            normals = None
    holes = _hole_faces(mesh, len(topology.counts), context)
    refined = None
    if scheme != UsdGeom.Tokens.none:
        refined = refined_surface(mesh, str(scheme), topology, world, holes, context)
    surfaces = materials.surfaces(mesh, topology, refined)
    description = MeshDescription(
        path=str(prim.GetPath()),
        points=world,
        face_vertex_counts=topology.counts,
        face_vertex_indices=topology.indices,
        corner_normals=normals,
        hole_faces=holes,
        reflectance=surfaces.reflectance,
        double_sided=bool(mesh.GetDoubleSidedAttr().Get(context.time)),
        flip_winding=flip_winding,
        opacity=surfaces.opacity,
        emission=surfaces.emission,
        to_world=own_space,
        is_posed=pose is not None,
    )
    return description if refined is None else on_limit_surface(description, refined)


def _placed(
    points: NDArray[np.float32], to_world: NDArray[np.float64], context: ReadingContext
) -> NDArray[np.float64] | None:
    """(P, 3) float64 in metres, world space; None where some are no place to be."""
    world = np.empty(points.shape)
    matrix = to_world[:, :3] * context.meters_per_unit
    return world if _core.place_points(points, matrix, world, context.threads) else None


def _note_what_is_not_read(mesh: UsdGeom.Mesh, context: ReadingContext) -> None:
    prim = mesh.GetPrim()
    context.note_animation(prim, [mesh.GetPointsAttr(), mesh.GetFaceVertexIndicesAttr()])


def _hole_faces(mesh: UsdGeom.Mesh, face_count: int, context: ReadingContext) -> NDArray[np.int32]:
    try:
        authored = number_array(mesh.GetHoleIndicesAttr(), context.time, np.int32)
    except ArrayError as error:
        context.note(mesh.GetPrim(), "holeIndices", "repaired", f"{error} and are ignored")
        return np.zeros(0, np.int32)
    if len(authored) == 0:
        return authored
    holes = np.unique(authored)
    inside = holes[(holes >= 0) & (holes < face_count)]
    if len(inside) < len(holes):
        reason = f"{len(holes) - len(inside)} hole indices name no face and are ignored"
        context.note(mesh.GetPrim(), "holeIndices", "repaired", reason)
    if len(inside):
        reason = f"{len(inside)} hole {'face' if len(inside) == 1 else 'faces'} left open"
        context.note(mesh.GetPrim(), "holeIndices", "noted", reason)
    return inside


def _corner_normals(
    mesh: UsdGeom.Mesh,
    topology: MeshTopology,
    to_world: NDArray[np.float64],
    context: ReadingContext,
    pose: Pose | None,
) -> NDArray[np.float32] | None:
    """(C, 3) float32 authored unit normals in world space; None where there are none to trust."""
    prim = mesh.GetPrim()
    primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar("normals")
    if primvar and primvar.HasAuthoredValue():  # precedes the attribute [UsdGeomPointBased]
        authored = primvar.ComputeFlattened(context.time)
        interpolation = str(primvar.GetInterpolation())
    else:
        authored = mesh.GetNormalsAttr().Get(context.time)
        interpolation = str(mesh.GetNormalsInterpolation())
        if authored is None:
            return None
    values = np.asarray(authored if authored else np.zeros((0, 3)))
    if values.shape[1:] != (3,) or values.dtype.kind != "f":
        reason = f"{type(authored).__name__} and no vectors: geometric ones instead"
        context.note(prim, "normals", "repaired", reason)
        return None
    values = values.astype(np.float32, copy=False)
    if not topology.has_values(values, interpolation):
        reason = (
            f"{len(values)} {interpolation} normals, {topology.value_count(interpolation)} wanted"
        )
        context.note(prim, "normals", "repaired", reason + ": geometric ones instead")
        return None
    if pose:
        if pose.turn_normals is None:
            reason = "blend shapes have moved its points: geometric ones instead"
            context.note(prim, "normals", "approximated", reason)
            return None
        at_rest = topology.to_corners(values, interpolation).astype(np.float64)
        values = np.asarray(pose.turn_normals(at_rest), np.float32)
        interpolation = "faceVarying"
    # The inverse transpose keeps outward normals outward, under mirroring as well.
    turn = np.vstack([np.linalg.inv(to_world[:3, :3]).T, np.zeros((1, 3))])
    corners = np.empty((len(topology.indices), 3), np.float32)
    of_corners = topology.values_of_corners(interpolation)
    if not _core.place_normals(values, of_corners, turn, corners, context.threads):
        reason = "some are zero or not finite: geometric ones instead"
        context.note(prim, "normals", "repaired", reason)
        return None
    return corners


def _share_against_winding(
    corner_normals: NDArray[np.float32],
    topology: MeshTopology,
    world: NDArray[np.float64],
    flip_winding: bool,
) -> float:
    """Share of faces whose authored normal points to the side that the corner order calls back."""
    faces = np.arange(0, len(topology.counts), max(1, len(topology.counts) // NORMAL_CHECK_FACES))
    faces = faces[topology.counts[faces] >= 3]
    geometric = topology.face_normals(world, faces) * (-1.0 if flip_winding else 1.0)
    authored = corner_normals[topology.first_corners(faces)]
    side = np.einsum("ij,ij->i", geometric, authored)
    decided = np.count_nonzero(side)
    return float((side < 0).sum() / decided) if decided else 0.0
