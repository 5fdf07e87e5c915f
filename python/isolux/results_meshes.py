"""Meshes in the results that stand where the source has none.

A shape given by numbers (a Sphere, say) has no points that could carry illumination. Its prim
becomes a Mesh in the results layer: same path, transform, material, purpose and visibility, with
the polygons that were read. The source keeps its shape.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, Vt

from .layer_authoring import author
from .scene_description import Finding, MeshDescription

_Types = Sdf.ValueTypeNames


def write_as_mesh(layer: Sdf.Layer, prim: Usd.Prim, mesh: MeshDescription) -> list[Finding]:
    """Write a gprim that is no mesh as the polygons that were read of it.

    layer : to write into
    prim : on the source stage
    returns : primvars of the gprim that a mesh of other points can't have
    """
    shape = local_shape(mesh)
    spec = Sdf.CreatePrimInLayer(layer, mesh.path)
    spec.typeName = "Mesh"
    points = Vt.Vec3fArray.FromNumpy(shape.points)
    author(spec, "points", _Types.Point3fArray, points)
    author(spec, "extent", _Types.Float3Array, UsdGeom.PointBased.ComputeExtent(points))
    for name, values in (
        ("faceVertexCounts", mesh.face_vertex_counts),
        ("faceVertexIndices", mesh.face_vertex_indices),
    ):
        author(spec, name, _Types.IntArray, Vt.IntArray.FromNumpy(values))
    author(spec, "subdivisionScheme", _Types.Token, UsdGeom.Tokens.none, Sdf.VariabilityUniform)
    author(spec, "doubleSided", _Types.Bool, mesh.double_sided, Sdf.VariabilityUniform)
    if shape.corner_normals is not None:
        normals = Vt.Vec3fArray.FromNumpy(shape.corner_normals)
        attribute = author(spec, "normals", _Types.Normal3fArray, normals)
        attribute.SetInfo("interpolation", UsdGeom.Tokens.faceVarying)
    return _block_primvars(spec, prim)


def stage_of_mesh(prim: Usd.Prim, mesh: MeshDescription) -> Usd.Stage:
    """The mesh alone, at its path, as `write_as_mesh` writes it."""
    layer = Sdf.Layer.CreateAnonymous(".usda")
    write_as_mesh(layer, prim, mesh)
    return Usd.Stage.Open(layer)


@dataclass(frozen=True, slots=True)
class LocalShape:
    """What was read of a prim, back in its own space and units.

    points : (P, 3) float32
    corner_normals : (C, 3) float32, unit; None where the mesh has none
    """

    points: NDArray[np.float32]
    corner_normals: NDArray[np.float32] | None


def local_shape(mesh: MeshDescription) -> LocalShape:
    """Points and normals of a mesh as a prim at its path has to author them."""
    to_world = np.eye(4) if mesh.to_world is None else mesh.to_world
    linear = to_world[:3, :3]
    points = ((mesh.points - to_world[3, :3]) @ np.linalg.inv(linear)).astype(np.float32)
    normals = None
    if mesh.corner_normals is not None:
        turned = mesh.corner_normals @ linear.T
        turned /= np.linalg.norm(turned, axis=1, keepdims=True)
        normals = turned.astype(np.float32)
    return LocalShape(points, normals)


def _block_primvars(spec: Sdf.PrimSpec, prim: Usd.Prim) -> list[Finding]:
    """A value a corner or face of the shape means nothing on the mesh."""
    findings = []
    for primvar in UsdGeom.PrimvarsAPI(prim).GetPrimvarsWithAuthoredValues():
        interpolation = str(primvar.GetInterpolation())
        if interpolation != UsdGeom.Tokens.constant:
            author(spec, primvar.GetName(), primvar.GetTypeName(), Sdf.ValueBlock())
            reason = f"{interpolation} values of a {prim.GetTypeName()}: none on its mesh"
            findings.append(Finding(str(prim.GetPath()), str(primvar.GetName()), "skipped", reason))
    return findings
