"""Writes what a solution says of instances into the results layer.

expand: nothing stays instanced. An instance loses `instanceable`, so that the primvars of its
meshes have prims to lie on. A point instancer becomes an Xform with a child for each copy that it
draws, a reference to the prototype moved by a matrix; its former children turn invisible.

summary: everything stays as it is. An instance gets constant primvars, which the prims below it
inherit; a point instancer gets a value for each instance, interpolation `vertex`, 0 where the
instance is masked. A value is the area-weighted mean over the fronts of all meshes in it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, Vt

from .output_fields import (
    OUTPUT_FIELDS,
    OutputField,
    PrimvarValues,
    VertexIlluminance,
    surface_look,
)
from .scene_description import Finding, InstancedPrim, SceneDescription
from .settings import Instances
from .solution import MeshLayout, Solution

# Places a copy in its instancer's space, before the prototype's own transform.
_PLACE = "xformOp:transform:isoluxInstance"
# Of the fields of every front vertex: four colours and a deviation, single precision.
_BYTES_A_VERTEX = 4 * (4 * 3 + 1)
_Types = Sdf.ValueTypeNames


def write_expanded(layer: Sdf.Layer, stage: Usd.Stage, instanced: tuple[InstancedPrim, ...]) -> int:
    """Make a prim of everything instanced; returns how many prims that adds, meshes aside.

    layer : the results layer
    stage : the source
    """
    added = 0
    for item in instanced:
        prim = Sdf.CreatePrimInLayer(layer, item.path)
        if item.copies is None:
            prim.SetInfo("instanceable", False)
            continue
        prim.typeName = "Xform"
        _hide_children(prim, item)
        prototypes = [_Prototype.of(stage, item, path) for path in item.prototypes]
        copies = item.copies
        for number, index, matrix in zip(
            copies.numbers, copies.prototype, copies.matrices, strict=True
        ):
            prototypes[index].write(prim, f"{copies.name}{number}", matrix)
        added += len(copies.numbers)
    return added


def _hide_children(prim: Sdf.PrimSpec, item: InstancedPrim) -> None:
    """An instancer draws none of its children, and an Xform would."""
    assert item.copies is not None
    for name, imageable in item.copies.children:
        child = Sdf.CreatePrimInLayer(prim.layer, prim.path.AppendChild(name))
        if not imageable:
            child.typeName = "Scope"
        _attribute(child, "visibility", _Types.Token).default = UsdGeom.Tokens.invisible


@dataclass(frozen=True, slots=True)
class _Prototype:
    """What each copy of a prototype says beside the reference.

    type_name : where the prototype itself has none that can be moved
    shown : it lies below the instancer, where it is hidden
    order : of its own transform
    material : relationship by which a material reaches it from above, out of a copy's reach
    primvars : that reach it in the same way
    """

    path: Sdf.Path
    type_name: str
    shown: bool
    order: list[str]
    material: Usd.Relationship | None
    primvars: list[UsdGeom.Primvar]

    @classmethod
    def of(cls, stage: Usd.Stage, item: InstancedPrim, path: str) -> _Prototype:
        prim, instancer = stage.GetPrimAtPath(path), Sdf.Path(item.source_path)
        if not prim:  # never drawn
            return cls(Sdf.Path(path), "", False, [], None, [])
        xformable = prim.IsA(UsdGeom.Xformable)
        authored = UsdGeom.Xformable(prim).GetXformOpOrderAttr().Get() if xformable else None
        order = list(authored or ())
        if "!resetXformStack!" in order:  # an instance stands where its instancer puts it
            order = order[len(order) - order[::-1].index("!resetXformStack!") :]

        def unreached(owner: Usd.Prim) -> bool:
            return owner != prim and not instancer.HasPrefix(owner.GetPath())

        _, binding = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial(UsdShade.Tokens.full)
        above = UsdGeom.PrimvarsAPI(prim.GetParent()).FindInheritablePrimvars()
        return cls(
            path=prim.GetPath(),
            type_name="" if xformable and not prim.IsA(UsdGeom.PointInstancer) else "Xform",
            shown=prim.GetParent().IsA(UsdGeom.PointInstancer),
            order=order,
            material=binding if binding and unreached(binding.GetPrim()) else None,
            primvars=[primvar for primvar in above if unreached(primvar.GetAttr().GetPrim())],
        )

    def write(self, instancer: Sdf.PrimSpec, name: str, matrix: NDArray[np.float64]) -> None:
        """One copy below the instancer."""
        copy = Sdf.PrimSpec(instancer, name, Sdf.SpecifierDef, self.type_name)
        copy.referenceList.prependedItems = [Sdf.Reference(primPath=self.path)]
        _attribute(copy, _PLACE, _Types.Matrix4d).default = Gf.Matrix4d(matrix)
        order = _attribute(copy, "xformOpOrder", _Types.TokenArray, Sdf.VariabilityUniform)
        order.default = Vt.TokenArray([_PLACE, *self.order])
        if self.shown:
            _attribute(copy, "visibility", _Types.Token).default = UsdGeom.Tokens.inherited
        if self.material is not None:
            schemas = Sdf.TokenListOp.Create(prependedItems=["MaterialBindingAPI"])
            copy.SetInfo("apiSchemas", schemas)
            binding = Sdf.RelationshipSpec(copy, self.material.GetName(), custom=False)
            binding.targetPathList.explicitItems = self.material.GetTargets()
            strength = self.material.GetMetadata("bindMaterialAs")
            if strength:
                binding.SetInfo("bindMaterialAs", strength)
        for primvar in self.primvars:
            attribute = _attribute(copy, primvar.GetName(), primvar.GetTypeName())
            attribute.default = primvar.ComputeFlattened()
            attribute.SetInfo("interpolation", UsdGeom.Tokens.constant)


def instance_of_meshes(scene: SceneDescription) -> dict[str, tuple[InstancedPrim, int]]:
    """The outermost instanced prim that a mesh belongs to, and the copy's place in its arrays.

    Meshes that are in none have no entry.
    """
    found = {}
    for item in scene.instanced:
        if item.mesh_ranges is None:
            continue
        numbers = [0] if item.copies is None else item.copies.numbers
        for number, begin, end in zip(
            numbers, item.mesh_ranges[:-1], item.mesh_ranges[1:], strict=True
        ):
            for mesh in scene.meshes[begin:end]:
                found[mesh.path] = item, int(number)
    return found


def instances_finding(scene: SceneDescription, solution: Solution, how: Instances) -> Finding:
    """What the results make of the stage's instances, and at which cost."""
    meshes = list(instance_of_meshes(scene))
    count = len(scene.instanced) + sum(
        len(item.copies.numbers) - 1 for item in scene.instanced if item.copies is not None
    )
    values = sum(_value_count(solution.layouts[path]) for path in meshes)
    size = f"{values * _BYTES_A_VERTEX / 1e6:,.3g} MB of primvars a stage"
    subject = f"{count:,} instances with {len(meshes):,} meshes"
    if how == "expand":
        reason = f"{subject} are prims of their own in the results: {size}"
    else:
        reason = f"{subject} have a value each in the results, which saves {size}"
    return Finding("/", "instances", "noted", reason)


def _value_count(layout: MeshLayout) -> int:
    return layout.front.stop - layout.front.start


class InstanceSummary:
    """Area-weighted means over what each instance or copy holds, stage after stage.

    scene : what was solved
    solution : one of it
    """

    def __init__(self, scene: SceneDescription, solution: Solution) -> None:
        light = solution.solved_light
        layouts, areas = light.layouts, light.vertex_areas
        self._items = [item for item in scene.instanced if item.mesh_ranges is not None]
        sizes = [1 if item.copies is None else item.copies.count for item in self._items]
        self._begins = np.cumsum([0, *sizes])
        begin_of = dict(zip((item.path for item in self._items), self._begins, strict=False))
        self._front = np.full(len(areas), -1, np.int64)
        self._back = np.full(len(areas), -1, np.int64)
        self._areas = areas
        look = np.zeros((len(areas), 6), np.float32)
        look_areas = np.zeros(len(areas))
        placed = instance_of_meshes(scene)
        for mesh in scene.meshes:
            if mesh.path not in placed:
                continue
            item, number = placed[mesh.path]
            layout = layouts[mesh.path]
            group = begin_of[item.path] + number
            self._front[layout.front] = group
            self._back[layout.back] = group
            corners = np.repeat(np.arange(len(mesh.face_vertex_counts)), mesh.face_vertex_counts)
            on_surface = layout.corner_vertices >= 0
            of_faces = surface_look(mesh)
            by_face = np.broadcast_to(of_faces, (len(mesh.face_vertex_counts), of_faces.shape[1]))
            vertices = layout.corner_vertices[on_surface] + layout.front.start
            look[vertices, : by_face.shape[1]] = by_face[corners[on_surface]]
            of_corners = solution.layout(mesh.path).front
            count = of_corners.stop - of_corners.start
            begin = layout.front.start
            look_areas[begin : begin + count] = solution.vertex_areas[of_corners]
        self._look = self._means(look, self._front, look_areas)

    def primvars(
        self, stage: VertexIlluminance
    ) -> Iterator[tuple[InstancedPrim, OutputField, NDArray[np.float32]]]:
        """The values of each instance (1) or of each point instancer (one an instance)."""
        back = None
        if (self._back >= 0).any():
            back = self._means(stage.direct + stage.indirect, self._back, self._areas)
        means = PrimvarValues(
            direct=self._means(stage.direct, self._front, self._areas),
            indirect=self._means(stage.indirect, self._front, self._areas),
            back=back,
            relative_deviation=self._means(stage.relative_deviation, self._front, self._areas),
            reflectance=self._look[:, :3],
            emission=self._look[:, 3:],
            display=stage.display,
        )
        for field in OUTPUT_FIELDS:
            values = field.values(means)
            if values is None:
                continue
            for item, begin, end in zip(
                self._items, self._begins[:-1], self._begins[1:], strict=True
            ):
                yield item, field, values[begin:end]

    def _means(
        self, values: NDArray[np.float32], groups: NDArray[np.int64], areas: NDArray[np.float64]
    ) -> NDArray[np.float32]:
        """(V,) or (V, K) values of vertices as means of their groups; 0 where one has none."""
        inside = groups >= 0
        groups, count = groups[inside], int(self._begins[-1])
        areas = areas[inside]
        total = np.bincount(groups, areas, count)
        columns = values[: len(inside)][inside].reshape(len(groups), -1).T
        sums = np.array([np.bincount(groups, areas * column, count) for column in columns])
        means = (sums / np.where(total > 0, total, 1.0)).T.astype(np.float32)
        return np.ascontiguousarray(means.reshape(count, *values.shape[1:]))


def _attribute(
    prim: Sdf.PrimSpec,
    name: str,
    type_name: Sdf.ValueTypeName,
    variability: Sdf.Variability = Sdf.VariabilityVarying,
) -> Sdf.AttributeSpec:
    return prim.attributes.get(name) or Sdf.AttributeSpec(prim, name, type_name, variability)
