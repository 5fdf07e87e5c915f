"""What is written per mesh: one row a primvar, and where its values sit on the mesh.

Interpolation: a primvar is `vertex` where all corners of each mesh point agree, which leaves one
value a point. Where creases or the reflectances of faces part them it is `faceVarying` with
indices: one value an illumination vertex as time samples, the indices once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ._core import adaptation_luminance, tone_map
from .scene_description import MeshDescription
from .solution import LUMINANCE_WEIGHTS, MeshLayout, Solution

Interpolation = Literal["vertex", "faceVarying"]


@dataclass(frozen=True, slots=True)
class PrimvarLayout:
    """Where the values of a primvar come from and how they sit on the mesh.

    interpolation : "vertex": one value a mesh point; "faceVarying": indices point to the values
    vertices : (N,) int32, illumination vertex of each value, counted from the start of the
        mesh's range; -1: no surface there, the value is 0
    reflectance : (N, 3) or (1, 3) float32, linear Rec. 709, of each value
    indices : (C,) int32, value of each face corner; None for "vertex"
    """

    interpolation: Interpolation
    vertices: NDArray[np.int32]
    reflectance: NDArray[np.float32]
    indices: NDArray[np.int32] | None

    def gather(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Values of one side of the mesh, (V,) or (V, 3), as the primvar's N values."""
        if len(values) == 0:
            return np.zeros((len(self.vertices), *values.shape[1:]), np.float32)
        gathered = values[self.vertices]
        gathered[self.vertices < 0] = 0.0
        return gathered


@dataclass(frozen=True, slots=True)
class PrimvarValues:
    """One mesh's part of a solution, gathered to the N values of a primvar layout.

    direct, indirect : (N, 3) float32, lx by channel, front
    back : (N, 3) float32, total, lx by channel; None for a one-sided mesh
    relative_deviation : (N,) float32, of the front's total
    reflectance : (N, 3) or (1, 3) float32
    adaptation_luminance : cd/m^2, of the whole scene
    """

    direct: NDArray[np.float32]
    indirect: NDArray[np.float32]
    back: NDArray[np.float32] | None
    relative_deviation: NDArray[np.float32]
    reflectance: NDArray[np.float32]
    adaptation_luminance: float

    @property
    def total(self) -> NDArray[np.float32]:
        return self.direct + self.indirect


def _display_colour(values: PrimvarValues) -> NDArray[np.float32]:
    """The brighter side's luminance ρE/π, tone-mapped: a point has one displayColor."""
    illuminance = values.total
    if values.back is not None:
        back_is_brighter = values.back @ LUMINANCE_WEIGHTS > illuminance @ LUMINANCE_WEIGHTS
        illuminance = np.where(back_is_brighter[:, None], values.back, illuminance)
    luminance = np.multiply(illuminance, values.reflectance / np.pi, dtype=np.float32)
    return tone_map(luminance, values.adaptation_luminance)


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
        "tone-mapped luminance of the diffuse surface, its brighter side",
        "reflectance",
        _display_colour,
    ),
)


class MeshOutput:
    """The primvars of one mesh, stage after stage on the same layouts.

    mesh : as it was read
    layout : as it was solved
    """

    def __init__(self, mesh: MeshDescription, layout: MeshLayout) -> None:
        self.path = mesh.path
        self._reflectance = _vertex_reflectance(mesh, layout)
        crease = _primvar_layout(mesh, layout.corner_vertices, np.zeros(1, np.int64))
        by_reflectance = crease
        if len(mesh.reflectance) > 1:
            _, kinds = np.unique(mesh.reflectance, axis=0, return_inverse=True)
            by_reflectance = _primvar_layout(mesh, layout.corner_vertices, kinds.ravel())
        self._layouts = {"crease": crease, "reflectance": by_reflectance}

    def luminance(self, solution: Solution) -> Iterator[tuple[slice, NDArray[np.float64]]]:
        """Luminance of each side's illumination vertices, cd/m^2, with their range."""
        layout = solution.layout(self.path)
        for side in (layout.front, layout.back):
            illuminance = solution.direct[side] + solution.indirect[side]
            if len(illuminance):
                yield side, (illuminance * self._reflectance) @ LUMINANCE_WEIGHTS / np.pi

    def primvars(
        self, solution: Solution, adaptation: float
    ) -> Iterator[tuple[OutputField, PrimvarLayout, NDArray[np.float32] | None]]:
        """Field, layout and values of each primvar; no values where this mesh hasn't the field.

        adaptation : adaptation luminance of the scene, cd/m^2
        """
        values = {
            split: _gather(solution, self.path, layout, adaptation)
            for split, layout in self._layouts.items()
        }
        for field in OUTPUT_FIELDS:
            yield field, self._layouts[field.split], field.values(values[field.split])


def scene_adaptation(solution: Solution, meshes: Iterable[MeshOutput]) -> float:
    """Luminance to which an observer of all lit surfaces adapts, cd/m^2; 0: nothing is lit."""
    luminance = np.zeros(len(solution.direct))
    for mesh in meshes:
        for side, values in mesh.luminance(solution):
            luminance[side] = values
    return adaptation_luminance(luminance, solution.vertex_areas)


def _primvar_layout(
    mesh: MeshDescription, corner_vertices: NDArray[np.int32], face_kinds: NDArray[np.int64]
) -> PrimvarLayout:
    """One value for each pair of illumination vertex and kind of face.

    face_kinds : (F,) or (1,) int64, faces of different kinds never share a value
    """
    faces = np.repeat(np.arange(len(mesh.face_vertex_counts)), mesh.face_vertex_counts)
    kinds = face_kinds[faces] if len(face_kinds) > 1 else face_kinds
    keys = corner_vertices * (kinds.max(initial=0) + 1) + kinds
    keys[corner_vertices < 0] = -1
    keys, first_corners, indices = np.unique(keys, return_index=True, return_inverse=True)
    vertices = corner_vertices[first_corners]
    reflectance = mesh.reflectance
    if len(reflectance) > 1:
        reflectance = reflectance[faces[first_corners]]

    # A point takes the value of any of its corners on the surface; do all the others agree?
    on_surface = corner_vertices >= 0
    points = mesh.face_vertex_indices[on_surface]
    point_values = np.full(len(mesh.points), -1)
    point_values[points] = indices[on_surface]
    if not np.array_equal(point_values[points], indices[on_surface]):
        return PrimvarLayout("faceVarying", vertices, reflectance, indices.astype(np.int32))
    unused = point_values < 0
    point_vertices = np.full(len(mesh.points), -1, np.int32)
    point_vertices[~unused] = vertices[point_values[~unused]]
    if len(reflectance) > 1:
        reflectance = reflectance[point_values]
    return PrimvarLayout("vertex", point_vertices, reflectance, None)


def _vertex_reflectance(mesh: MeshDescription, layout: MeshLayout) -> NDArray[np.float64]:
    """Mean over the corners at each illumination vertex, (V, 3), or (1, 3) where all are alike."""
    if len(mesh.reflectance) == 1:
        return mesh.reflectance.astype(np.float64)
    on_surface = layout.corner_vertices >= 0
    vertices = layout.corner_vertices[on_surface]
    corners = np.repeat(mesh.reflectance, mesh.face_vertex_counts, axis=0)[on_surface]
    size = layout.front.stop - layout.front.start
    sums = [np.bincount(vertices, corners[:, c], size) for c in range(3)]
    return np.stack(sums, axis=1) / np.maximum(np.bincount(vertices, minlength=size), 1)[:, None]


def _gather(
    solution: Solution, path: str, layout: PrimvarLayout, adaptation: float
) -> PrimvarValues:
    front, back = solution.layout(path).front, solution.layout(path).back
    two_sided = back.stop > back.start
    return PrimvarValues(
        direct=layout.gather(solution.direct[front]),
        indirect=layout.gather(solution.indirect[front]),
        back=layout.gather(solution.direct[back] + solution.indirect[back]) if two_sided else None,
        relative_deviation=layout.gather(solution.relative_deviation[front]),
        reflectance=layout.reflectance,
        adaptation_luminance=adaptation,
    )
