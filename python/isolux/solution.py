"""A progressive solution: illuminance at the illumination vertices of each mesh, and its error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .errors import SceneError
from .scene_description import SceneDescription
from .schedule import StagePlan

# Rec. 709 luminance weights: the light's colour is scaled so that these give lumens.
LUMINANCE_WEIGHTS = np.array([0.2126, 0.7152, 0.0722])


@dataclass(frozen=True, slots=True)
class ProgressiveStage:
    """One progressive stage as the report, the results layer and `isolux info` tell it.

    index : 1, 2, ...; the integer time code of the stage
    component : which part of the solver made it: DEPT, DDL, IDEPT, gather or HPR
    photons : photons emitted so far
    rays : rays traced so far by photons
    shadow_rays : by direct lighting
    indirect_rays : by the gather or by radiosity
    elements : mesh elements (triangles), those of the adaptive mesh where there is one
    elapsed : s, solving so far, without reading, building and writing
    rms_error, rms_error_indirect : estimated relative RMS error of the written illuminance at the
        vertices, area-weighted, bias of the filter included; nan where it can't be told yet
    bucket_rms_error, bucket_rms_error_indirect : of the unfiltered buckets [Volevich 2000, Eq. 5];
        nan without photons
    batch_rms_error : of the unfiltered buckets, from independent batches of photons
    switchover_time, switchover_photons : T1, s and photons, when direct lighting began; 0 before
    second_switchover_time : T2, s, when direct lighting was complete; 0 before
    absorbed, back_absorbed, escaped : photons that ended at a front, at the back of a one-sided
        mesh, or outside; their sum is photons, but for light links:
    split_by_links : photons that became two, at a mesh that their luminaire lights and that casts
        none of its shadow: one stayed, one went on
    absorbed_by_links : photons that ended at a mesh that stands in the light of a luminaire that
        doesn't light it; the sum of all four ends is photons + split_by_links
    """

    index: int
    component: str
    photons: int
    rays: int
    shadow_rays: int
    indirect_rays: int
    elements: int
    elapsed: float
    rms_error: float
    rms_error_indirect: float
    bucket_rms_error: float
    bucket_rms_error_indirect: float
    batch_rms_error: float
    switchover_time: float
    switchover_photons: int
    second_switchover_time: float
    absorbed: int
    back_absorbed: int
    escaped: int
    split_by_links: int = 0
    absorbed_by_links: int = 0


@dataclass(frozen=True, slots=True)
class MeshLayout:
    """Where a mesh's illumination vertices lie in the arrays of a solution.

    front, back : ranges into the solution's vertex arrays; back is empty for a one-sided mesh
    corner_vertices : (C,) int32, illumination vertex of each face corner, counted from the start
        of the range (front and back alike); -1 at corners of holes
    """

    front: slice
    back: slice
    corner_vertices: NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class RefinedMesh:
    """The adaptive mesh: the elements' triangles, split along edges where light needs it.

    Vertices are the scene's V illumination vertices, then S split vertices, each on the line
    between two vertices before it, so that linear interpolation from its parents gives any
    function of the coarser mesh unchanged. The mesh of a later iteration begins with all split
    vertices of an earlier one; with another threshold they may part.

    vertex_count : V
    split_parents : (S, 2) int32, the two vertices between which each split vertex lies
    split_fraction : (S,) float64, 0 at the first parent, 1 at the second
    split_twin : (S,) int32, of a front vertex its twin on the back of a double-sided mesh, else -1
    split_point : (S,) int32, split vertices at the same place of an edge share a number in
        [0, P): the sides of a crease, front and back
    elements : (T, 3) int32, front vertices, counter-clockwise seen from the front
    element_parents : (T,) int32, the scene's element of which each is a part, in rising order
    barycentrics : (T, 3, 3) float64, place of each corner in its parent: weights of its vertices
    """

    vertex_count: int
    split_parents: NDArray[np.int32]
    split_fraction: NDArray[np.float64]
    split_twin: NDArray[np.int32]
    split_point: NDArray[np.int32]
    elements: NDArray[np.int32]
    element_parents: NDArray[np.int32]
    barycentrics: NDArray[np.float64]

    @classmethod
    def unsplit(cls, vertex_count: int, elements: NDArray[np.int32]) -> RefinedMesh:
        """Elements, (T, 3), as an adaptive mesh without a split."""
        return cls(
            vertex_count=vertex_count,
            split_parents=np.zeros((0, 2), np.int32),
            split_fraction=np.zeros(0),
            split_twin=np.zeros(0, np.int32),
            split_point=np.zeros(0, np.int32),
            elements=elements,
            element_parents=np.arange(len(elements), dtype=np.int32),
            barycentrics=np.broadcast_to(np.eye(3), (len(elements), 3, 3)),
        )

    def common_vertices(self, other: RefinedMesh) -> int:
        """How many vertices, from the first on, are the same in both meshes: V at least."""
        count = min(len(self.split_fraction), len(other.split_fraction))
        same = (self.split_parents[:count] == other.split_parents[:count]).all(axis=1)
        same &= self.split_fraction[:count] == other.split_fraction[:count]
        return self.vertex_count + (count if same.all() else int(same.argmin()))

    def interpolate(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Values of the first n >= V vertices, (n,) or (n, C), carried on to all V + S."""
        known = len(values)
        total = self.vertex_count + len(self.split_parents)
        out = np.empty((total, *values.shape[1:]), values.dtype)
        out[:known] = values
        is_known = np.arange(total) < known
        pending = np.arange(known, total)
        while len(pending):  # a round for each generation of splits
            ready = is_known[self.split_parents[pending - self.vertex_count]].all(axis=1)
            vertices = pending[ready]
            a, b = self.split_parents[vertices - self.vertex_count].T
            t = self.split_fraction[vertices - self.vertex_count]
            t = t.reshape(-1, *(1,) * (values.ndim - 1))
            out[vertices] = out[a] * (1 - t) + out[b] * t
            is_known[vertices] = True
            pending = pending[~ready]
        return out


@dataclass(frozen=True, slots=True)
class DividedLight:
    """Light at all vertices of a mesh whose large elements were divided, N of them, for means.

    layouts : where its vertices lie, by mesh path, added ones behind those of the face corners
    direct, indirect : (N, 3) float32, lx by channel
    relative_deviation : (N,) float32, of the total
    vertex_areas : (N,) float64, m^2; with them photons' light is their flux
    """

    layouts: dict[str, MeshLayout]
    direct: NDArray[np.float32]
    indirect: NDArray[np.float32]
    relative_deviation: NDArray[np.float32]
    vertex_areas: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Solution:
    """Illuminance of all meshes after one progressive stage.

    Arrays have an entry a vertex: V of the scene, then S where the mesh is refined.

    direct, indirect : (V + S, 3) float32, lx by channel (linear Rec. 709; the luminance-weighted
        sum of the channels is the photometric illuminance)
    relative_deviation : (V + S,) float32, of the total; 0.05, not 5 %
    support_radius : (V,) float32, m, of the indirect light's filter; 0 where there was none
    vertex_areas : (V,) float64, m^2, area that each vertex stands for
    refined : the adaptive mesh; None: the elements as they are
    divided : the light where it was solved for; None: at the vertices alone
    steps : what the run did so far, by counts: `ProgressiveSolver.stages` replays it
    """

    stage: ProgressiveStage
    scene: SceneDescription
    layouts: dict[str, MeshLayout]
    direct: NDArray[np.float32]
    indirect: NDArray[np.float32]
    relative_deviation: NDArray[np.float32]
    support_radius: NDArray[np.float32]
    vertex_areas: NDArray[np.float64]
    refined: RefinedMesh | None = None
    divided: DividedLight | None = None
    steps: tuple[StagePlan, ...] = ()

    @property
    def solved_light(self) -> Solution | DividedLight:
        """Light of which means are taken: at all vertices that were solved for, with their areas.

        Where large elements were divided these are more than the scene's own.
        """
        return self.divided or self

    def layout(self, path: str) -> MeshLayout:
        """Layout of the mesh at `path`. Raises SceneError where no such mesh was solved."""
        try:
            return self.layouts[path]
        except KeyError:
            raise SceneError(path, "no solved mesh", "one of " + _some(self.layouts)) from None

    def illuminance(self, path: str, *, back: bool = False) -> NDArray[np.float32]:
        """Total illuminance at a mesh's face corners.

        path : prim path of the mesh
        back : of the back side of a double-sided mesh
        returns : (C, 3) float32, lx by channel, in the authored order of corners; 0 at holes
        """
        layout = self.layout(path)
        vertices = layout.back if back else layout.front
        values = self.direct[vertices] + self.indirect[vertices]
        if len(values) == 0:
            return np.zeros((len(layout.corner_vertices), 3), np.float32)
        corners = values[layout.corner_vertices]
        corners[layout.corner_vertices < 0] = 0.0
        return corners

    def mean_illuminance(self, path: str) -> float:
        """Area-weighted mean photometric illuminance of the front of a mesh, lx."""
        self.layout(path)
        light = self.solved_light
        front = light.layouts[path].front
        areas = light.vertex_areas[front]
        total = float(areas.sum())
        if total == 0.0:
            return 0.0
        colour = areas @ (light.direct[front] + light.indirect[front]).astype(np.float64)
        return float(colour @ LUMINANCE_WEIGHTS) / total


def _some(names: dict[str, MeshLayout]) -> str:
    shown = list(names)[:5]
    more = len(names) - len(shown)
    return ", ".join(shown) + (f" and {more} more" if more else "")
