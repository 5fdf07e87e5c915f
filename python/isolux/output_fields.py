"""What is written per mesh: one row a primvar, and where its values sit on the mesh.

The mesh is the authored one, or its refinement.

Interpolation: a primvar is `vertex` where all corners of each mesh point agree, which leaves one
value a point. Where creases or the reflectances of faces part them it is `faceVarying` with
indices: one value an illumination vertex as time samples, the indices once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from .display_view import Display
from .refined_topology import RefinedTopology
from .scene_description import MeshDescription
from .solution import LUMINANCE_WEIGHTS, MeshLayout, RefinedMesh

Interpolation = Literal["vertex", "faceVarying"]


@dataclass(frozen=True, slots=True)
class PrimvarLayout:
    """Where the values of a primvar come from and how they sit on the mesh.

    interpolation : "vertex": one value a mesh point; "faceVarying": indices point to the values
    front : (N,) int32, vertex of the solution of each value; -1: no surface there, the value is 0
    back : the same of the mesh's back; None for a one-sided mesh
    reflectance : (N, 3) or (1, 3) float32, linear Rec. 709, of each value; with the emission
        behind it (N, 6) or (1, 6), see `surface_look`
    indices : (C,) int32, value of each face corner; None for "vertex"
    """

    interpolation: Interpolation
    front: NDArray[np.int32]
    back: NDArray[np.int32] | None
    reflectance: NDArray[np.float32]
    indices: NDArray[np.int32] | None

    def subset(self, values: NDArray[np.int64]) -> PrimvarLayout:
        """These values alone, on no mesh."""
        return PrimvarLayout(
            self.interpolation,
            self.front[values],
            None if self.back is None else self.back[values],
            self.reflectance if len(self.reflectance) == 1 else self.reflectance[values],
            None,
        )

    def gather(self, illuminance: VertexIlluminance) -> PrimvarValues:
        """The solution's part of this mesh, as the primvar's N values."""
        direct, indirect = illuminance.direct, illuminance.indirect
        back = None
        if self.back is not None:
            back = _pick(direct, self.back) + _pick(indirect, self.back)
        return PrimvarValues(
            direct=_pick(direct, self.front),
            indirect=_pick(indirect, self.front),
            back=back,
            relative_deviation=_pick(illuminance.relative_deviation, self.front),
            reflectance=self.reflectance[:, :3],
            emission=self._emission(),
            display=illuminance.display,
        )

    def _emission(self) -> NDArray[np.float32] | None:
        emission = self.reflectance[:, 3:]
        return np.where(self.front[:, None] < 0, 0, emission) if emission.size else None


@dataclass(frozen=True, slots=True)
class VertexIlluminance:
    """A progressive stage at all vertices of a solution, kept until all stages are written.

    time_code : of the stage
    direct, indirect, relative_deviation : as in `Solution`
    display : from luminance to displayColor
    """

    time_code: float
    direct: NDArray[np.float32]
    indirect: NDArray[np.float32]
    relative_deviation: NDArray[np.float32]
    display: Display

    def on(self, refined: RefinedMesh, known: int | None = None) -> VertexIlluminance:
        """The same on another refined mesh.

        known : how many vertices, from the first on, it shares with that of this stage; None: all
        """
        shared = slice(known)
        return VertexIlluminance(
            self.time_code,
            refined.interpolate(self.direct[shared]),
            refined.interpolate(self.indirect[shared]),
            refined.interpolate(self.relative_deviation[shared]),
            self.display,
        )


@dataclass(frozen=True, slots=True)
class PrimvarValues:
    """One mesh's part of a solution, gathered to the N values of a primvar layout.

    direct, indirect : (N, 3) float32, lx by channel, front
    back : (N, 3) float32, total, lx by channel; None for a one-sided mesh
    relative_deviation : (N,) float32, of the front's total
    reflectance : (N, 3) or (1, 3) float32
    emission : (N, 3) float32, cd/m^2 by channel, of both sides; None: the mesh doesn't shine
    display : from luminance to displayColor
    """

    direct: NDArray[np.float32]
    indirect: NDArray[np.float32]
    back: NDArray[np.float32] | None
    relative_deviation: NDArray[np.float32]
    reflectance: NDArray[np.float32]
    emission: NDArray[np.float32] | None
    display: Display

    @property
    def total(self) -> NDArray[np.float32]:
        return self.direct + self.indirect


def _display_colour(values: PrimvarValues) -> NDArray[np.float32]:
    """The brighter side's luminance ρE/π, and its own: a point has one displayColor."""
    illuminance = values.total
    if values.back is not None:
        back_is_brighter = values.back @ LUMINANCE_WEIGHTS > illuminance @ LUMINANCE_WEIGHTS
        illuminance = np.where(back_is_brighter[:, None], values.back, illuminance)
    luminance = np.multiply(illuminance, values.reflectance / np.pi, dtype=np.float32)
    if values.emission is not None:
        luminance += values.emission
    return values.display(luminance)


@dataclass(frozen=True, slots=True)
class OutputField:
    """A row of the table below.

    name : primvar, without "primvars:"
    unit : "1" where it has none
    meaning : one phrase for listings and the README
    split : what makes the corners of a point differ: the illumination vertices alone ("crease"),
        or the reflectance of the faces too ("reflectance")
    values : the primvar's values, (N, 3) or (N,) float32; None where the mesh has no such field
    """

    name: str
    unit: str
    meaning: str
    split: Literal["crease", "reflectance"]
    values: Callable[[PrimvarValues], NDArray[np.float32] | None]


OUTPUT_FIELDS = (
    OutputField("isolux:illuminance", "lx", "total illuminance", "crease", lambda v: v.total),
    OutputField(
        "isolux:direct", "lx", "straight from the luminaires", "crease", lambda v: v.direct
    ),
    OutputField("isolux:indirect", "lx", "by way of surfaces", "crease", lambda v: v.indirect),
    OutputField(
        "isolux:backIlluminance",
        "lx",
        "total on the back of a double-sided mesh",
        "crease",
        lambda v: v.back,
    ),
    OutputField(
        "isolux:relativeDeviation",
        "1",
        "estimated standard deviation over the total (0.05, not 5 %)",
        "crease",
        lambda v: v.relative_deviation,
    ),
    OutputField(
        "displayColor",
        "1",
        "luminance of the surface, its brighter side, as the display shows it",
        "reflectance",
        _display_colour,
    ),
)


@dataclass(frozen=True, slots=True)
class MeshCorners:
    """The face corners to write on.

    points : (C,) int32, point of each corner
    point_count : P
    faces : (C,) int32, authored face of each corner
    front : (C,) int32, vertex of the solution at each corner; -1 at corners of holes
    back : the same of the back; None for a one-sided mesh
    """

    points: NDArray[np.int32]
    point_count: int
    faces: NDArray[np.int32]
    front: NDArray[np.int32]
    back: NDArray[np.int32] | None

    @classmethod
    def of_authored(cls, mesh: MeshDescription, layout: MeshLayout) -> MeshCorners:
        corners = layout.corner_vertices
        two_sided = layout.back.stop > layout.back.start
        return cls(
            points=mesh.face_vertex_indices,
            point_count=len(mesh.points),
            faces=_corner_faces(mesh),
            front=np.where(corners < 0, -1, corners + layout.front.start),
            back=np.where(corners < 0, -1, corners + layout.back.start) if two_sided else None,
        )

    @classmethod
    def of_refined(cls, topology: RefinedTopology) -> MeshCorners:
        return cls(
            points=topology.indices,
            point_count=topology.point_count,
            faces=np.repeat(topology.faces, 3),
            front=topology.front,
            back=topology.back,
        )


class MeshOutput:
    """The primvars of one mesh, stage after stage on the same layouts.

    path : prim path
    reflectance : (F, 3), (1, 3), (F, 6) or (1, 6) float32, `surface_look` of its authored faces
    corners : where to write
    """

    def __init__(self, path: str, reflectance: NDArray[np.float32], corners: MeshCorners) -> None:
        self.path = path
        self._crease = _primvar_layout(corners, reflectance, np.zeros(1, np.int64))
        self._by_reflectance = self._crease
        if len(reflectance) > 1:
            self._by_reflectance = _primvar_layout(corners, reflectance, face_kinds(reflectance))

    def primvars(
        self, illuminance: VertexIlluminance
    ) -> Iterator[tuple[OutputField, PrimvarLayout, NDArray[np.float32] | None]]:
        """Field, layout and values of each primvar; no values where this mesh hasn't the field."""
        crease = by_reflectance = self._crease.gather(illuminance)
        if self._by_reflectance is not self._crease:
            by_reflectance = self._by_reflectance.gather(illuminance)
        of_split = {
            "crease": (self._crease, crease),
            "reflectance": (self._by_reflectance, by_reflectance),
        }
        for field in OUTPUT_FIELDS:
            layout, values = of_split[field.split]
            yield field, layout, field.values(values)


def surface_look(mesh: MeshDescription) -> NDArray[np.float32]:
    """What displayColor shows of a mesh besides its illuminance, a row a face.

    returns : (F, 3) or (1, 3) float32, the reflectance; (F, 6) or (1, 6) where the mesh shines:
        behind it the emission, cd/m^2 by channel
    """
    if mesh.emission is None:
        return mesh.reflectance
    rows = max(len(mesh.reflectance), len(mesh.emission))
    parts = [np.broadcast_to(part, (rows, 3)) for part in (mesh.reflectance, mesh.emission)]
    return np.hstack(parts)


def face_kinds(reflectance: NDArray[np.float32]) -> NDArray[np.int64]:
    """(F,) or (1,) int64: faces of one reflectance are of one kind."""
    return np.unique(reflectance, axis=0, return_inverse=True)[1].ravel()


def corner_values(
    corners: MeshCorners, reflectance: NDArray[np.float32], kinds: NDArray[np.int64]
) -> tuple[PrimvarLayout, NDArray[np.int32]]:
    """One value for each pair of illumination vertex and kind of face; that of each corner.

    kinds : (F,) or (1,) int64, faces of different kinds never share a value
    """
    kinds = kinds[corners.faces] if len(kinds) > 1 else kinds
    keys = corners.front * (kinds.max(initial=0) + 1) + kinds
    keys[corners.front < 0] = -1
    first_corners, place = _unique(keys)
    if len(reflectance) > 1:
        reflectance = reflectance[corners.faces[first_corners]]
    front = corners.front[first_corners]
    back = None if corners.back is None else corners.back[first_corners]
    indices = place.astype(np.int32)
    return PrimvarLayout("faceVarying", front, back, reflectance, indices), indices


def _unique(keys: NDArray[np.integer]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Of each different key in rising order the first place; of each key, which of them it is."""
    low, high = (int(keys.min()), int(keys.max())) if len(keys) else (0, -1)
    span = high - low + 1
    if span > 4 * len(keys):
        _, first, which = np.unique(keys, return_index=True, return_inverse=True)
        return first, which.ravel()
    # A table takes a fraction of the time of sorting them.
    table = np.full(span, -1)
    table[keys[::-1] - low] = np.arange(len(keys))[::-1]  # the first of equal ones stays
    used = table >= 0
    return table[used], (np.cumsum(used) - 1)[keys - low]


def _primvar_layout(
    corners: MeshCorners, reflectance: NDArray[np.float32], kinds: NDArray[np.int64]
) -> PrimvarLayout:
    """The values of `corner_values`, one a point where all its corners agree."""
    values, indices = corner_values(corners, reflectance, kinds)

    # A point takes the value of any of its corners on the surface; do all the others agree?
    on_surface = corners.front >= 0
    points = corners.points[on_surface]
    point_values = np.full(corners.point_count, -1)
    point_values[points] = indices[on_surface]
    if not np.array_equal(point_values[points], indices[on_surface]):
        return values
    used = point_values >= 0

    def at_points(side: NDArray[np.int32]) -> NDArray[np.int32]:
        vertices = np.full(corners.point_count, -1, np.int32)
        vertices[used] = side[point_values[used]]
        return vertices

    front = at_points(values.front)
    back = None if values.back is None else at_points(values.back)
    reflectance = values.reflectance
    if len(reflectance) > 1:
        reflectance = reflectance[point_values]
    return PrimvarLayout("vertex", front, back, reflectance, None)


def _pick(values: NDArray[np.float32], vertices: NDArray[np.int32]) -> NDArray[np.float32]:
    if len(values) == 0:
        return np.zeros((len(vertices), *values.shape[1:]), np.float32)
    picked = values[vertices]
    picked[vertices < 0] = 0.0
    return picked


def _corner_faces(mesh: MeshDescription) -> NDArray[np.int32]:
    faces = np.arange(len(mesh.face_vertex_counts), dtype=np.int32)
    return np.repeat(faces, mesh.face_vertex_counts)
