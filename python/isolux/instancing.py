"""Walks the prims of a stage that are drawn, those of instances and point instancers as well.

What a prototype holds is read where it is met first. Elsewhere its meshes are that reading, moved:
they share every array but points and normals. Its lights are read anew in each place.

A prototype of a point instancer is drawn where the instancer puts it, and by itself only where it
is an ordinary prim: defined, and not below an instancer [UsdGeomPointInstancer].
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, UsdLux

from .errors import SceneError
from .mesh_copies import Motion
from .point_instances import PointInstances, read_point_instances
from .reading_context import Frame, ReadingContext
from .scene_description import InstancedPrim, MeshDescription, PointCopies
from .unreadable_prims import TOO_FAR, are_in_reach, skipped_where_unreadable

# Nesting multiplies: a few lines of text could ask for more than any memory holds. A mesh takes
# 1 kB besides its points, so that these take some 0.5 GB and 6 GB.
MOST_PLACED = 500_000
MOST_CORNERS = 1 << 28
# Places of a prototype whose axes differ more in scale are no base for others: rounding.
MOST_UNEVEN = 1e6

# Properties below these names reach the prims below, so that instances of one prototype differ.
_INHERITED = ("primvars:", "material:binding", "skel:", "purpose")
# But of these each place has its own: by its path, or by where a skeleton beside it stands.
_BY_PLACE = ("material:binding:collection", "skel:skeleton")
_INSIDE_PROTOTYPE = Usd.PrimIsActive  # a prototype may be an over or a class

Matrix = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Placed:
    """A prim in one of its places.

    prim : on the source stage; below an instance its proxy
    path : where it is in the results once nothing is instanced any more
    again : its meshes are known and placed: only its light is to be read
    source : its path on the source stage, where prim is the same in another instance; "": prim's
    """

    prim: Usd.Prim
    path: str
    again: bool = False
    source: str = ""

    @property
    def source_path(self) -> str:
        return self.source or str(self.prim.GetPath())

    def mesh(self, read: MeshDescription) -> MeshDescription:
        """The mesh that was read of the prim, at this path."""
        if read.path == self.path:
            return read
        return replace(read, path=self.path, source_path=read.path)


@dataclass(slots=True)
class _Known:
    """What a prototype holds, as it stands in the place where it was read.

    path, source : of that place, in the results and on the stage
    inverse : of that place's matrix
    """

    path: str
    source: str
    inverse: Matrix
    meshes: list[MeshDescription]
    lights: list[tuple[Placed, Frame | None]]
    instanced: list[InstancedPrim]
    findings: range
    corners: int


class InstanceWalk:
    """One walk over a stage.

    meshes : the caller appends what it reads of each prim before it asks for the next; copies of
        them are appended here
    skip : whether nothing at or below a prim is drawn; notes why
    instanced : grows; see SceneDescription
    """

    def __init__(
        self,
        context: ReadingContext,
        meshes: list[MeshDescription],
        skip: Callable[[Usd.Prim], bool],
    ) -> None:
        self.instanced: list[InstancedPrim] = []
        self._context = context
        self._meshes = meshes
        self._skip = skip
        self._known: dict[tuple[Any, ...], _Known] = {}
        self._inherited: dict[Sdf.Path, tuple[Any, ...]] = {Sdf.Path.absoluteRootPath: ()}
        self._lights: list[tuple[Placed, Frame | None]] = []
        self._open: list[Sdf.Path] = []  # prototypes of point instancers that are being walked
        self._depth = 0
        self._resets = 0
        self._placed = 0
        self._corners = 0
        self._repeated: set[int] = set()  # findings that hold for other instances as well

    def prims(self, stage: Usd.Stage, predicate: Usd._PrimFlagsPredicate) -> Iterator[Placed]:
        """Every drawn prim in each of its places, in stage order.

        predicate : which prims are part of the stage
        Raises SceneError where instances are more than can be held.
        """
        yield from self._subtree(stage.GetPseudoRoot(), predicate)
        findings = self._context.findings
        for index in self._repeated:
            reason = f"{findings[index].reason} (so in its other instances)"
            findings[index] = replace(findings[index], reason=reason)

    def _subtree(self, root: Usd.Prim, predicate: Usd._PrimFlagsPredicate) -> Iterator[Placed]:
        prims = iter(Usd.PrimRange(root, Usd.TraverseInstanceProxies(predicate)))
        for prim in prims:
            undefined = predicate == _INSIDE_PROTOTYPE and prim.GetSpecifier() != Sdf.SpecifierDef
            if (undefined and prim != root) or self._skip(prim):
                prims.PruneChildren()
                continue
            if prim.IsInstance() and not prim.IsA(UsdGeom.PointInstancer):
                prims.PruneChildren()
                yield from self._instance(prim, predicate)
                continue
            if prim.IsInstance() or (prim.IsInstanceable() and self._context.frame):
                # A copy's reference makes an instance of what has no other arc.
                self.instanced.append(InstancedPrim(self._path(prim), str(prim.GetPath())))
            if prim.IsA(UsdGeom.PointInstancer):
                prims.PruneChildren()
                yield from self._point_instancer(prim)
            else:
                yield self._met(prim)

    def _met(self, prim: Usd.Prim) -> Placed:
        placed = Placed(prim, self._path(prim))
        if self._depth:
            if prim.HasAPI(UsdLux.LightAPI):
                self._lights.append((placed, self._context.frame))
            if prim.IsA(UsdGeom.Xformable) and UsdGeom.Xformable(prim).GetResetXformStack():
                self._resets += 1
        return placed

    def _path(self, prim: Usd.Prim) -> str:
        path, frame = str(prim.GetPath()), self._context.frame
        return path if frame is None else frame.path + path[len(frame.source) :]

    def _instance(self, prim: Usd.Prim, predicate: Usd._PrimFlagsPredicate) -> Iterator[Placed]:
        begin, item = len(self._meshes), len(self.instanced)
        path, source = self._path(prim), str(prim.GetPath())
        self.instanced.append(InstancedPrim(path, source))
        yield self._met(prim)
        matrix = self._context.world_matrix(prim)
        if matrix is None:
            reason = "its transform is singular or not finite"
            self._context.note(prim, "instance", "skipped", reason)
            return
        inherited = self._inherited_by(prim)
        key: tuple[Any, ...] | None = None
        if _BY_PLACE not in inherited:
            key = (prim.GetPrototype().GetPath(), *inherited)
        children: list[Usd.Prim] = []
        if key not in self._known:
            children = prim.GetFilteredChildren(Usd.TraverseInstanceProxies(predicate))
        yield from self._place(key, matrix, path, source, children, predicate)
        if self._depth == 0:
            ranges = np.array([begin, len(self._meshes)])
            self.instanced[item] = replace(self.instanced[item], mesh_ranges=ranges)

    def _point_instancer(self, prim: Usd.Prim) -> Iterator[Placed]:
        context, outer = self._context, self._context.frame
        world = context.world_matrix(prim)
        if world is None:
            reason = "its transform is singular or not finite"
            context.note(prim, "PointInstancer", "skipped", reason)
            return
        found = None
        with skipped_where_unreadable(prim, context):
            found = read_point_instances(prim, context)
        if found is None:
            return
        for name in ("displayColor", "displayOpacity"):
            primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar(name)
            if primvar.HasAuthoredValue() and primvar.GetInterpolation() != "constant":
                context.note(prim, name, "approximated", "given by instance, which is not read")
        targets = UsdGeom.PointInstancer(prim).GetPrototypesRel().GetForwardedTargets()
        prototypes = [self._prototype(prim, path, i, found) for i, path in enumerate(targets)]
        item = len(self.instanced)
        name = _free_name(prim)
        copies = PointCopies(name, found.count, *_drawn(found, prototypes), _children(prim))
        path = self._path(prim)
        self.instanced.append(
            InstancedPrim(path, str(prim.GetPath()), copies, tuple(str(p) for p in targets))
        )
        ranges = [len(self._meshes)]
        begun: set[int] = set()
        for number, index, matrix in zip(
            copies.numbers, copies.prototype, copies.matrices @ world, strict=True
        ):
            prototype = prototypes[index]
            assert prototype is not None
            source, copy_path = str(targets[index]), f"{path}/{name}{number}"
            key = ("prototype", source)
            if key in self._known and index not in begun:  # better now than after half of them
                known, times = self._known[key], int(np.count_nonzero(copies.prototype == index))
                self._require_room(times * len(known.meshes), times * known.corners, source)
                begun.add(index)
            context.frame = Frame(prototype.GetParent(), matrix, source, copy_path)
            self._open.append(targets[index])
            yield from self._place(key, matrix, copy_path, source, [prototype], _INSIDE_PROTOTYPE)
            self._open.pop()
            ranges.append(len(self._meshes))
            context.frame = outer
        if self._depth == 0:
            self.instanced[item] = replace(self.instanced[item], mesh_ranges=np.array(ranges))

    def _prototype(
        self, prim: Usd.Prim, path: Sdf.Path, index: int, found: PointInstances
    ) -> Usd.Prim | None:
        """A prototype that can be drawn; None, with a finding where it was wanted."""
        prototype = prim.GetStage().GetPrimAtPath(path.GetPrimPath())
        wanted = int(np.count_nonzero(found.prototype == index))
        fault = None
        if not prototype:
            fault = "is missing"
        elif not prototype.IsActive():
            fault = "is inactive"
        elif prim.GetPath().HasPrefix(path) or path in self._open:
            fault = "holds the instancer itself"
        if fault and wanted:
            reason = f"its prototype {path} {fault}: {wanted} instances"
            self._context.note(prim, "prototypes", "skipped", reason)
        return None if fault else prototype

    def _place(
        self,
        key: tuple[Any, ...] | None,
        matrix: Matrix,
        path: str,
        source: str,
        roots: Sequence[Usd.Prim],
        predicate: Usd._PrimFlagsPredicate,
    ) -> Iterator[Placed]:
        """What a prototype holds, in one of its places.

        key : of all places that hold the same; None: of this one alone
        matrix : (4, 4) float64 of the place, stage units
        path, source : of the place, in the results and on the stage
        roots : the prims to walk where the prototype is met first
        """
        self._count(1, 0, source)
        known = self._known.get(key) if key else None
        if known:
            yield from self._again(known, matrix, path, source)
            return
        meshes, lights, instanced = len(self._meshes), len(self._lights), len(self.instanced)
        findings, resets = len(self._context.findings), self._resets
        self._depth += 1
        for root in roots:
            yield from self._subtree(root, predicate)
        self._depth -= 1
        scales = np.linalg.svd(matrix[:3, :3], compute_uv=False)
        if key and resets == self._resets and scales[0] <= MOST_UNEVEN * scales[-1]:
            held = self._meshes[meshes:]
            self._known[key] = _Known(
                path, source, np.linalg.inv(matrix).astype(np.float64), held, self._lights[lights:],
                self.instanced[instanced:], range(findings, len(self._context.findings)),
                sum(len(mesh.face_vertex_indices) for mesh in held),
            )  # fmt: skip
        if self._depth == 0:
            self._lights.clear()

    def _again(self, known: _Known, matrix: Matrix, path: str, source: str) -> Iterator[Placed]:
        self._count(len(known.meshes), known.corners, source)
        self._repeated.update(known.findings)
        context = self._context
        moved = known.inverse @ matrix
        motion = Motion(moved, context.meters_per_unit)
        for mesh in known.meshes:
            in_results = path + mesh.path[len(known.path) :]
            on_stage = _rebased(mesh.source_path or mesh.path, known.source, source)
            renamed = "" if on_stage == in_results else on_stage
            copy = motion.copied(mesh, in_results, renamed)
            if are_in_reach(copy.points):
                self._meshes.append(copy)
            else:
                context.note(Sdf.Path(on_stage), "Mesh", "skipped", TOO_FAR)
        for item in known.instanced:
            self.instanced.append(
                replace(
                    item,
                    path=path + item.path[len(known.path) :],
                    source_path=_rebased(item.source_path, known.source, source),
                    prototypes=tuple(
                        _rebased(prototype, known.source, source) for prototype in item.prototypes
                    ),
                )
            )
        outer = context.frame
        for placed, frame in known.lights:
            again = Placed(
                placed.prim,
                path + placed.path[len(known.path) :],
                again=True,
                source=_rebased(placed.source_path, known.source, source),
            )
            context.frame = (frame or Frame(None, np.eye(4), "", "")).moved(moved)
            if self._depth:
                self._lights.append((again, context.frame))
            noted = len(context.findings)
            yield again
            del context.findings[noted:]  # as at its first place
            context.frame = outer

    def _count(self, placed: int, corners: int, source: str) -> None:
        self._require_room(placed, corners, source)
        self._placed += placed
        self._corners += corners

    def _require_room(self, placed: int, corners: int, source: str) -> None:
        if self._placed + placed > MOST_PLACED or self._corners + corners > MOST_CORNERS:
            raise SceneError(
                source,
                f"more than {MOST_PLACED:,} instances and meshes in them, or {MOST_CORNERS:,} face "
                "corners, once nested instances are multiplied",
                "fewer",
            )

    def _inherited_by(self, prim: Usd.Prim) -> tuple[Any, ...]:
        """What reaches the prims below: authored on this prim or above it."""
        path = prim.GetPath()
        if path not in self._inherited:
            own: list[Any] = []
            for name in prim.GetAuthoredPropertyNames():
                if name.startswith(_BY_PLACE):
                    own.append(_BY_PLACE)
                elif name.startswith(_INHERITED):
                    own.append((name, *self._told_by(prim.GetProperty(name))))
            self._inherited[path] = (*self._inherited_by(prim.GetParent()), *own)
        return self._inherited[path]

    def _told_by(self, told: Usd.Property) -> tuple[Any, ...]:
        if isinstance(told, Usd.Relationship):
            return (*told.GetTargets(), told.GetMetadata("bindMaterialAs"))
        if told.HasMetadata("interpolation") and told.GetMetadata("interpolation") != "constant":
            return ()  # stays where it is
        value = told.Get(self._context.time)
        array = np.asarray(value)
        return (str(value) if array.dtype.kind == "O" else array.tobytes(),)


def _rebased(path: str, old: str, new: str) -> str:
    """The path with `new` in place of `old`; as it is where it doesn't lie there."""
    inside = path == old or path.startswith(old + "/")
    return new + path[len(old) :] if inside else path


def _free_name(prim: Usd.Prim) -> str:
    """Beginning of the copies' names, with which none of the instancer's children begins."""
    taken = [child.GetName() for child in prim.GetAllChildren()]
    name = "Copy"
    while any(other.startswith(name) for other in taken):
        name += "_"
    return name


def _children(prim: Usd.Prim) -> tuple[tuple[str, bool], ...]:
    """Name of each child, and whether its visibility means something."""
    children = prim.GetFilteredChildren(Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate))
    return tuple(
        (child.GetName(), child.IsA(UsdGeom.Imageable))
        for child in children
        if child.IsA(UsdGeom.Imageable) or not child.GetTypeName()
    )


def _drawn(
    found: PointInstances, prototypes: list[Usd.Prim | None]
) -> tuple[NDArray[np.int64], NDArray[np.int64], Matrix]:
    """Numbers, prototypes and matrices of the instances whose prototype can be drawn."""
    usable = np.array([prototype is not None for prototype in prototypes], bool)
    kept = usable[found.prototype] if len(found.prototype) else np.zeros(0, bool)
    return found.numbers[kept], found.prototype[kept], found.matrices[kept]
