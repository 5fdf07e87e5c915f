"""Reads what is a surface and no mesh: shapes given by numbers, and the skin of tetrahedra.

Results are written on a mesh in the place of such a prim (`results_meshes`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from .gprim_shapes import Polygons, ShapeError, tessellate
from .materials import MaterialReader
from .mesh_topology import MeshTopology
from .reading_context import ReadingContext
from .scene_description import MeshDescription
from .unreadable_prims import TOO_FAR, are_in_reach


def read_gprim(
    prim: Usd.Prim, context: ReadingContext, materials: MaterialReader
) -> MeshDescription | None:
    """A gprim that is no mesh, as polygons; None where it has no surface to read, with a finding.

    Raises SceneError where its reflectance is none.
    """
    kind = str(prim.GetTypeName())
    try:
        shape = _tetrahedra(prim, context) if prim.IsA(UsdGeom.TetMesh) else None
        shape = shape or tessellate(prim, context.time)
    except ShapeError as fault:
        context.note(prim, kind, "skipped", str(fault))
        return None
    if shape is None:
        context.note(prim, kind, "skipped", "no surface that is read: polygons and shapes are")
        return None
    to_world = context.world_matrix(prim)
    if to_world is None:
        context.note(prim, kind, "skipped", "its transform is singular or not finite")
        return None
    world = shape.points @ to_world[:3, :3] + to_world[3, :3]
    world *= context.meters_per_unit
    if not are_in_reach(world):
        context.note(prim, kind, "skipped", TOO_FAR)
        return None
    flat = kind in ("Cube", "Plane", "TetMesh")
    reason = f"read as {len(shape.counts)} faces"
    is_instanced = prim.IsInstanceProxy() or context.frame is not None
    if not (is_instanced and context.settings.instances == "summary"):
        reason += "; a Mesh in the results"
    context.note(prim, kind, "noted" if flat else "approximated", reason)
    if prim.HasAttribute("primvars:skel:jointIndices"):
        reason = f"skinned {kind} read in its rest pose: meshes are posed"
        context.note(prim, "SkelBindingAPI", "approximated", reason)
    context.note_animation(
        prim, [prim.GetAttribute(name) for name in prim.GetPropertyNames() if name in _SHAPE_INPUTS]
    )
    gprim = UsdGeom.Gprim(prim)
    left_handed = gprim.GetOrientationAttr().Get(context.time) == UsdGeom.Tokens.leftHanded
    mirrored = bool(np.linalg.det(to_world[:3, :3]) < 0)
    normals = None
    if shape.normals is not None:
        # The inverse transpose keeps outward normals outward, under mirroring as well.
        turned = shape.normals @ np.linalg.inv(to_world[:3, :3]).T
        turned /= np.linalg.norm(turned, axis=1, keepdims=True)
        normals = np.ascontiguousarray(-turned if left_handed else turned, np.float32)
    topology = MeshTopology(shape.counts, shape.indices, len(shape.points))
    surfaces = materials.surfaces(gprim, topology)
    return MeshDescription(
        path=str(prim.GetPath()),
        points=world,
        face_vertex_counts=shape.counts,
        face_vertex_indices=shape.indices,
        corner_normals=normals,
        hole_faces=np.zeros(0, np.int32),
        reflectance=surfaces.reflectance,
        double_sided=bool(gprim.GetDoubleSidedAttr().Get(context.time)),
        flip_winding=left_handed != mirrored,
        opacity=surfaces.opacity,
        emission=surfaces.emission,
        to_world=context.in_metres(to_world),
    )


_SHAPE_INPUTS = (
    "axis",
    "height",
    "length",
    "points",
    "radius",
    "radiusBottom",
    "radiusTop",
    "size",
    "tetVertexIndices",
    "width",
)


def _tetrahedra(prim: Usd.Prim, context: ReadingContext) -> Polygons:
    """The skin of a TetMesh; raises ShapeError where its arrays make none."""
    tetrahedra = UsdGeom.TetMesh(prim)
    points = _rows(tetrahedra.GetPointsAttr().Get(context.time), 3, np.float64)
    if not np.isfinite(points).all():
        raise ShapeError("points that are NaN or infinite")
    faces = _rows(tetrahedra.GetSurfaceFaceVertexIndicesAttr().Get(context.time), 3, np.int32)
    if len(faces) == 0:
        corners = _rows(tetrahedra.GetTetVertexIndicesAttr().Get(context.time), 4, np.int32)
        _require_points(corners, len(points))
        skin = UsdGeom.TetMesh.ComputeSurfaceFaces(tetrahedra, context.time)
        faces = _rows(skin, 3, np.int32)
    _require_points(faces, len(points))
    return Polygons(points, np.full(len(faces), 3, np.int32), faces.ravel(), None)


def _rows(values: object, width: int, dtype: type) -> NDArray:
    rows = np.asarray([] if values is None else values)
    if rows.size and (rows.dtype.kind not in "iuf" or rows.shape[-1] != width):
        raise ShapeError(f"{type(values).__name__} for rows of {width} numbers")
    return rows.astype(dtype).reshape(-1, width)


def _require_points(corners: NDArray[np.int32], point_count: int) -> None:
    if corners.size == 0:
        raise ShapeError("no faces")
    if corners.min() < 0 or corners.max() >= point_count:
        wrong = corners.min() if corners.min() < 0 else corners.max()
        raise ShapeError(f"a corner at point {wrong} of {point_count} points")
