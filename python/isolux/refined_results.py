"""Writes the adaptive mesh of one prim into the results layer, with all that hangs on its faces.

Every opinion is a default value: that of the time at which the stage was read holds at all times.
A primvar is carried over by its interpolation:

- constant: as it is
- uniform: each triangle picks its authored face's value, by indices
- vertex, varying, faceVarying: linear over the triangles of the authored faces, without indices;
  what can't be blended (integers, text, quaternions, skinning) picks the nearest value, by indices

Normals, velocities and accelerations go along. Faces of GeomSubsets become their triangles, points
take their new neighbours. Holes have no triangles any more. What tells of a subdivision surface or
of blend shapes is blocked: the mesh that is written has neither. The values of a subdivision
surface spread over it by its own rules first.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, UsdUtils, Vt

from .layer_authoring import author
from .output_fields import OUTPUT_FIELDS
from .refined_cage import RefinedCageTopology
from .refined_topology import RefinedTopology
from .results_meshes import LocalShape
from .scene_description import Finding, FindingAction

# Authored face of each triangle: a uniform primvar of every refined mesh.
SOURCE_FACE = "isolux:sourceFace"

_OWN_PRIMVARS = {SOURCE_FACE, *(field.name for field in OUTPUT_FIELDS)}
_BLOCKED = (
    "cornerIndices",
    "cornerSharpnesses",
    "creaseIndices",
    "creaseLengths",
    "creaseSharpnesses",
    "holeIndices",
    "skel:blendShapes",
)
_BY_POINT = ("velocities", "accelerations")
# Primvars that hold for the pose in which a skeleton was bound, or not for a limit surface.
_OF_THE_REST_POSE = ("normals", "skel:jointIndices", "skel:jointWeights")
_Types = Sdf.ValueTypeNames


def write_refined_mesh(
    layer: Sdf.Layer,
    prim: Usd.Prim,
    path: str,
    time: Usd.TimeCode,
    topology: RefinedTopology | RefinedCageTopology,
    solved: LocalShape | None = None,
    is_posed: bool = False,
) -> list[Finding]:
    """Write topology, points, primvars and subsets of one mesh; what was there is replaced.

    layer : the results layer
    prim : the mesh on the source stage
    path : where it is in the results
    time : at which the source was read
    solved : the faces that the solver saw, where the prim's own normals don't hold for them: in
        the pose of a skeleton, to which the refined mesh is not bound, or on a limit surface
    is_posed : whether their points are not the prim's own either
    returns : what could not be carried over as it is
    """
    diagnostics = UsdUtils.CoalescingDiagnosticDelegate()  # findings say it, not stderr
    try:
        return _RefinedPrim(layer, prim, path, time, topology, solved, is_posed).write()
    finally:
        diagnostics.TakeUncoalescedDiagnostics()


class _RefinedPrim:
    def __init__(
        self,
        layer: Sdf.Layer,
        prim: Usd.Prim,
        path: str,
        time: Usd.TimeCode,
        topology: RefinedTopology | RefinedCageTopology,
        solved: LocalShape | None,
        is_posed: bool,
    ) -> None:
        self._spec = Sdf.CreatePrimInLayer(layer, path)
        self._prim = prim
        self._mesh = UsdGeom.Mesh(prim)
        self._time = time
        self._topology = topology
        self._solved_shape = solved
        self._is_posed = is_posed
        self._solved = topology.solved if isinstance(topology, RefinedCageTopology) else topology
        self._findings: list[Finding] = []

    def write(self) -> list[Finding]:
        self._write_topology()
        for name in _BY_POINT:
            attribute = self._prim.GetAttribute(name)
            if attribute.HasAuthoredValue():
                self._write_attribute(attribute, "vertex")
        if self._solved_shape:
            self._write_solved_normals(self._solved_shape)
        elif self._mesh.GetNormalsAttr().HasAuthoredValue():
            self._write_attribute(
                self._mesh.GetNormalsAttr(), str(self._mesh.GetNormalsInterpolation())
            )
        for primvar in UsdGeom.PrimvarsAPI(self._prim).GetPrimvarsWithAuthoredValues():
            unbound = self._solved_shape and primvar.GetPrimvarName() in _OF_THE_REST_POSE
            if primvar.GetPrimvarName() not in _OWN_PRIMVARS and not unbound:
                self._write_primvar(primvar)
        for name in _BLOCKED:
            attribute = self._prim.GetAttribute(name)
            if attribute.HasAuthoredValue():
                self._author(name, attribute.GetTypeName(), Sdf.ValueBlock())
        for subset in UsdGeom.Subset.GetAllGeomSubsets(self._mesh):
            self._write_subset(subset)
        return self._findings

    def _write_solved_normals(self, solved: LocalShape) -> None:
        """The normals that the solver saw; nothing of the skeleton."""
        for primvar_name in _OF_THE_REST_POSE:
            attribute = self._prim.GetAttribute(f"primvars:{primvar_name}")
            if attribute.HasAuthoredValue():
                self._author(attribute.GetName(), attribute.GetTypeName(), Sdf.ValueBlock())
        if solved.corner_normals is None:
            self._author("normals", _Types.Normal3fArray, Sdf.ValueBlock())
            return
        carried = _unit(self._solved.interpolated(solved.corner_normals, "faceVarying"))
        normals = Vt.Vec3fArray.FromNumpy(carried.astype(np.float32))
        attribute = self._author("normals", _Types.Normal3fArray, normals)
        attribute.SetInfo("interpolation", UsdGeom.Tokens.faceVarying)

    def _write_topology(self) -> None:
        topology = self._topology
        if self._solved_shape and self._is_posed:
            placed = self._solved.interpolated(self._solved_shape.points, "vertex")
        else:
            authored = np.asarray(self._mesh.GetPointsAttr().Get(self._time), np.float32)
            placed = topology.interpolated(authored, "vertex")
        points = placed.astype(np.float32)
        vt_points = Vt.Vec3fArray.FromNumpy(points)
        counts = np.full(len(topology.faces), 3, np.int32)
        self._author("points", _Types.Point3fArray, vt_points)
        self._author("faceVertexCounts", _Types.IntArray, Vt.IntArray.FromNumpy(counts))
        self._author("faceVertexIndices", _Types.IntArray, Vt.IntArray.FromNumpy(topology.indices))
        self._author("extent", _Types.Float3Array, UsdGeom.PointBased.ComputeExtent(vt_points))
        self._author("subdivisionScheme", _Types.Token, UsdGeom.Tokens.none, Sdf.VariabilityUniform)
        faces = self._author(
            f"primvars:{SOURCE_FACE}", _Types.IntArray, Vt.IntArray.FromNumpy(topology.faces)
        )
        faces.SetInfo("interpolation", UsdGeom.Tokens.uniform)

    def _write_attribute(self, attribute: Usd.Attribute, interpolation: str) -> None:
        """Vectors of the schema itself, which have no indices."""
        if interpolation == "constant":
            return
        name, type_name = attribute.GetName(), attribute.GetTypeName()
        values = np.asarray(attribute.Get(self._time), np.float64).reshape(-1, 3)
        if not self._fits(name, len(values), interpolation):
            self._author(name, type_name, Sdf.ValueBlock())
            return
        if interpolation == "uniform":
            carried = values[self._topology.nearest(interpolation)]
        else:
            carried = self._topology.interpolated(values, interpolation)
        if name == "normals":
            carried = _unit(carried)
        self._author(name, type_name, Vt.Vec3fArray.FromNumpy(carried.astype(np.float32)))

    def _write_primvar(self, primvar: UsdGeom.Primvar) -> None:
        interpolation = str(primvar.GetInterpolation())
        if interpolation == "constant":
            return
        name, type_name = primvar.GetName(), primvar.GetTypeName()
        indexed = primvar.IsIndexed()
        size = primvar.GetElementSize()
        flat = primvar.ComputeFlattened(self._time)
        if not self._fits(name, 0 if flat is None else len(flat), interpolation, size):
            self._author(name, type_name, Sdf.ValueBlock())
            return
        values = np.asarray(flat)
        blended = values.dtype.kind == "f" and "Quat" not in type(flat).__name__
        skinned = name.startswith("primvars:skel:")  # weights belong to their joints
        if interpolation == "uniform" or skinned or not blended:
            self._pick_primvar(primvar, interpolation)
            return
        carried = self._topology.interpolated(values.reshape(len(flat) // size, -1), interpolation)
        if name == "primvars:normals":
            carried = _unit(carried)
        carried = np.ascontiguousarray(carried.reshape(-1, *values.shape[1:]), values.dtype)
        self._author(name, type_name, type(flat).FromNumpy(carried))
        if indexed:
            self._author(f"{name}:indices", _Types.IntArray, Sdf.ValueBlock())

    def _pick_primvar(self, primvar: UsdGeom.Primvar, interpolation: str) -> None:
        """Leave the values as they are, whatever their type, and point to them."""
        picked = self._topology.nearest(interpolation)
        if primvar.IsIndexed():
            picked = np.asarray(primvar.GetIndices(self._time))[picked]
        indices = Vt.IntArray.FromNumpy(np.ascontiguousarray(picked, np.int32))
        self._author(f"{primvar.GetName()}:indices", _Types.IntArray, indices)
        if primvar.ValueMightBeTimeVarying():
            values = primvar.Get(self._time)
            self._author(primvar.GetName(), primvar.GetTypeName(), values)
        if interpolation != "uniform":
            reason = f"{primvar.GetTypeName()} is not blended: the refined mesh takes the nearest"
            self._note(primvar.GetName(), "approximated", reason)

    def _write_subset(self, subset: UsdGeom.Subset) -> None:
        element_type = str(subset.GetElementTypeAttr().Get(self._time))
        authored = subset.GetIndicesAttr().Get(self._time)
        if authored is None:
            return
        path = subset.GetPath().ReplacePrefix(self._prim.GetPath(), self._spec.path)
        spec = Sdf.CreatePrimInLayer(self._spec.layer, path)
        interpolation = {"face": "uniform", "point": "vertex"}.get(element_type)
        indices = np.zeros(0, np.int32)
        if interpolation:
            indices = self._topology.subset(np.asarray(authored, np.int32), interpolation)
        else:
            reason = f"subset {subset.GetPrim().GetName()} of type {element_type} is left empty"
            self._note("GeomSubset", "skipped", reason)
        author(spec, "indices", _Types.IntArray, Vt.IntArray.FromNumpy(indices))

    def _fits(self, name: str, count: int, interpolation: str, element_size: int = 1) -> bool:
        wanted = self._topology.authored.value_count(interpolation)
        fits = wanted is not None and count == wanted * element_size
        if not fits:
            size = f" of {element_size} each" if element_size > 1 else ""
            reason = f"{count} {interpolation} values, {wanted}{size} wanted"
            self._note(name, "skipped", f"{reason}: none on the refined mesh")
        return fits

    def _note(self, kind: str, action: FindingAction, reason: str) -> None:
        self._findings.append(Finding(str(self._prim.GetPath()), kind, action, reason))

    def _author(
        self,
        name: str,
        type_name: Sdf.ValueTypeName,
        value: object,
        variability: Sdf.Variability = Sdf.VariabilityVarying,
    ) -> Sdf.AttributeSpec:
        return author(self._spec, name, type_name, value, variability)


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Opposite normals may have blended to nothing: those stay zero."""
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(lengths > 0, lengths, 1.0)
