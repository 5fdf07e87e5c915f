"""What the solver needs of a stage: plain arrays in world space, metres and lumens.

Nothing here knows USD; prim paths are kept as text, so that every later message can name its prim.
World space is the stage's own axes (Y-up stays Y-up), scaled by `metersPerUnit`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from .subdivision import SubdivisionCage

LuminaireShape = Literal["sphere", "disk", "rect", "cylinder", "distant", "dome", "mesh"]
FindingAction = Literal["skipped", "approximated", "repaired", "noted"]


@dataclass(frozen=True, slots=True)
class MeshCopy:
    """What a mesh is a copy of: an earlier mesh of the scene, with the same faces, moved.

    path : of that mesh, itself no copy
    matrix : (4, 4) float64, that mesh's points to the copy's, for row vectors: world space, metres
    """

    path: str
    matrix: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class MeshDescription:
    """One polygon mesh, corners in the order in which its prim authors them.

    path : prim path
    points : (P, 3) float64, metres, world space
    face_vertex_counts : (F,) int32
    face_vertex_indices : (C,) int32, each in [0, P)
    corner_normals : (C, 3) float32, unit, world space, on the front side; None where not authored
    hole_faces : (H,) int32, faces that are no surface
    reflectance : (F, 3) or (1, 3) float32, linear Rec. 709, each in [0, 1)
    double_sided : both sides receive and reflect light; else the back absorbs
    flip_winding : the authored corner order runs clockwise seen from the front
        (left-handed orientation or a mirroring transform, not both)
    opacity : (F,) or (1,) float32 in [0, 1], share of the light that a face stops; None: all
    emission : (F, 3) or (1, 3) float32, luminance in cd/m² by channel; None: the mesh doesn't shine
    cage : what the results return to where the mesh is the refined limit surface of a control cage,
        which then authored none of its corners; None: the mesh is as authored
    source_path : prim path on the source stage, where that is another than in the results: the mesh
        is a point instancer's prototype or part of one; "": path
    copy_of : the earlier mesh that this one is in another place; its arrays are shared but for
        points and corner_normals; None: none
    to_world : (4, 4) float64, from the space of the prim in the results, stage units, to world
        space, metres, for row vectors; None: they are the same
    is_posed : the points are a skeleton's or blend shapes' and not the prim's own
    """

    path: str
    points: NDArray[np.float64]
    face_vertex_counts: NDArray[np.int32]
    face_vertex_indices: NDArray[np.int32]
    corner_normals: NDArray[np.float32] | None
    hole_faces: NDArray[np.int32]
    reflectance: NDArray[np.float32]
    double_sided: bool
    flip_winding: bool
    opacity: NDArray[np.float32] | None = None
    emission: NDArray[np.float32] | None = None
    cage: SubdivisionCage | None = None
    source_path: str = ""
    copy_of: MeshCopy | None = None
    to_world: NDArray[np.float64] | None = None
    is_posed: bool = False


@dataclass(frozen=True, slots=True)
class GoniometricDiagram:
    """Luminous intensity over direction: nadir is local -Z, C0 is local +X, C90 is local +Y.

    Between the angles the intensity is bilinear in (gamma, C); outside the gamma range it is zero.

    gamma : (G,) float64, rad, strictly increasing in [0, pi]
    c_angles : (H,) float64, rad, strictly increasing; either [0] (axially symmetric)
        or from 0 to 2 pi inclusive (symmetries already unfolded)
    candela : (H, G) float64, cd, >= 0
    """

    gamma: NDArray[np.float64]
    c_angles: NDArray[np.float64]
    candela: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LuminaireDescription:
    """One luminaire: a shape in space, how much light it gives and in which directions.

    path : prim path
    shape : sphere (size: radius, 0), disk (radius, 0), rect (width along X, height along Y),
        cylinder (radius, length along X), distant (half its angle in rad, 0), dome, mesh: what
        shines of the MeshDescription of the same path
    origin : (3,) float64, metres, world space
    axes : (3, 3) float64, rows are the unit local X, Y, Z in world space, orthonormal
    size : (2,) float64, metres
    colour : (3,) float64, linear Rec. 709, scaled to luminance 1
    luminous_flux : lm, > 0; of a distant light or a dome, which shine on all of a scene, lm/m²:
        of each of its directions through the plane across it
    diagram : directions by relative intensity, scaled to luminous_flux; None: a surface of
        constant luminance (disk and rect shine to -Z, cylinder without its end caps)
    lit_meshes : paths of the meshes that it lights; None: all
    shadow_meshes : paths of the meshes that stand in its light; None: all
    environment : of a dome, (H, W, 3) float32, luminance in cd/m² by channel over latitude and
        longitude as OpenEXR has them: rows from local +Y to −Y, the middle column +Z and those left
        of it +X; axes may be left-handed
    """

    path: str
    shape: LuminaireShape
    origin: NDArray[np.float64]
    axes: NDArray[np.float64]
    size: NDArray[np.float64]
    colour: NDArray[np.float64]
    luminous_flux: float
    diagram: GoniometricDiagram | None
    lit_meshes: frozenset[str] | None = None
    shadow_meshes: frozenset[str] | None = None
    environment: NDArray[np.float32] | None = None

    @property
    def is_infinite(self) -> bool:
        """Whether it shines from infinitely far."""
        return self.shape in ("distant", "dome")


@dataclass(frozen=True, slots=True)
class PointCopies:
    """What a point instancer draws.

    name : of a copy in the results, without its number
    count : of the instancer's instances, drawn or not
    numbers : (N,) int64, places of the drawn ones in the instancer's arrays, rising
    prototype : (N,) int64, which of the prototypes each is
    matrices : (N, 4, 4) float64, for row vectors, stage units, in the instancer's space; the
        prototype's own transform comes before
    children : (name, whether its visibility means something) of each child of the instancer
    """

    name: str
    count: int
    numbers: NDArray[np.int64]
    prototype: NDArray[np.int64]
    matrices: NDArray[np.float64]
    children: tuple[tuple[str, bool], ...]


@dataclass(frozen=True, slots=True)
class InstancedPrim:
    """A scenegraph instance or a point instancer.

    path : where it is in the results once nothing around it is instanced any more
    source_path : on the source stage, the path of a proxy below another instance
    copies : of a point instancer; None: a scenegraph instance
    prototypes : of a point instancer, their paths on the source stage
    mesh_ranges : (N + 1,) int64, N copies or one instance: mesh k of the scene belongs to copy i
        where mesh_ranges[i] <= k < mesh_ranges[i + 1]; None for one that lies inside another
    """

    path: str
    source_path: str
    copies: PointCopies | None = None
    prototypes: tuple[str, ...] = ()
    mesh_ranges: NDArray[np.int64] | None = None


@dataclass(frozen=True, slots=True)
class Finding:
    """Something on the stage that was not taken as it stands.

    path : prim path
    kind : schema type or attribute, such as "PointInstancer"
    action : skipped (has no part in the solution), approximated, repaired, or noted
    reason : one plain sentence without the path
    """

    path: str
    kind: str
    action: FindingAction
    reason: str


@dataclass(frozen=True, slots=True)
class SceneDescription:
    """A whole stage as the solver sees it. See `isolux.stage_reader.read_stage`.

    meshes, luminaires : in stage order
    findings : everything skipped, approximated or repaired, by prim path
    meters_per_unit, up_axis : as the stage has them ("Y" or "Z")
    time_code : the time at which attributes were read; None: the default time
    source_hash : sha256 of the used layers' contents, hex
    prim_counts : by type of prim and by "read" or the action of its findings, how many prims
    instanced : outer ones before those inside them
    """

    meshes: tuple[MeshDescription, ...]
    luminaires: tuple[LuminaireDescription, ...]
    findings: tuple[Finding, ...]
    meters_per_unit: float
    up_axis: str
    time_code: float | None
    source_hash: str = ""
    read_seconds: float = field(default=0.0, compare=False)
    prim_counts: Mapping[str, Mapping[str, int]] = field(default_factory=dict)
    instanced: tuple[InstancedPrim, ...] = ()

    @property
    def luminous_flux(self) -> float:
        """Total luminous flux of all luminaires but those that shine from infinitely far, lm."""
        finite = (light for light in self.luminaires if not light.is_infinite)
        return float(sum(light.luminous_flux for light in finite))
