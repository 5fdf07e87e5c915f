"""Reads the rules of a subdivision surface, and refines it as finely as its curvature asks for.

A level is enough where the faces stay within CHORD_TOLERANCE of the limit surface; the setting
`surface_level` bounds it, 0 leaves the control cage as it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from .attribute_values import number_array
from .mesh_topology import MeshTopology
from .reading_context import ReadingContext
from .scene_description import MeshDescription
from .subdivision import RefinedSurface, SubdivisionCage, sound_faces

# Distance from the limit surface, relative to the diagonal of the mesh's bounds: a pixel on a mesh
# 500 pixels large.
CHORD_TOLERANCE = 0.002
# Each level quarters the distance of the faces from the limit surface.
LEVEL_GAIN = 4.0
# Refined faces of one mesh: 400 bytes each while it is read, 1 kB while its results are written.
# Finer cages are taken as fine enough.
MAX_REFINED_FACES = 1 << 20
# From this sharpness on an edge or point stays as it is at every level [OpenSubdiv, Sdc].
INFINITE_SHARPNESS = 10.0
# Terms that the faces or points of one cage may share among each other: a fan of n faces around one
# point takes n².
MAX_SHARED_TERMS = 1 << 26


@dataclass(frozen=True, slots=True)
class _Sharp:
    """Points of edges or single points, and how sharp each is."""

    points: NDArray[np.int32]
    sharpness: NDArray[np.float32]


def refined_surface(
    mesh: UsdGeom.Mesh,
    scheme: str,
    topology: MeshTopology,
    points: NDArray[np.float64],
    hole_faces: NDArray[np.int32],
    context: ReadingContext,
) -> RefinedSurface | None:
    """The limit surface of a mesh; None where it stays its control cage, and why as a finding.

    scheme : its subdivisionScheme, not none
    topology, points, hole_faces : of the cage; (P, 3) m, world space
    """
    if context.settings.surface_level == 0:
        fault = "surface_level is 0"
    else:
        cage = _read_cage(mesh, scheme, topology, hole_faces, context)
        fault = _too_many(cage)
    if not fault:
        try:
            return _refined(cage, points, mesh.GetPrim(), context)
        except ValueError as error:
            fault = str(error)
    reason = f"{scheme} read as its control cage: {fault}"
    context.note(mesh.GetPrim(), "subdivisionScheme", "approximated", reason)
    return None


def on_limit_surface(description: MeshDescription, surface: RefinedSurface) -> MeshDescription:
    """A cage, with what its materials say of the refined faces, as those faces."""
    normals = surface.limit_normals(description.points)
    if normals is not None and description.flip_winding:
        normals = -normals
    return replace(
        description,
        points=surface.limit_points(description.points),
        face_vertex_counts=surface.topology.counts,
        face_vertex_indices=surface.topology.indices,
        corner_normals=normals,
        hole_faces=surface.hole_faces,
        cage=surface.cage,
    )


def _refined(
    cage: SubdivisionCage, points: NDArray[np.float64], prim: Usd.Prim, context: ReadingContext
) -> RefinedSurface:
    """The surface at the lowest level that is fine enough."""
    allowed = context.settings.surface_level
    once = None
    wanted = 1
    if _face_count(cage, 1) <= MAX_REFINED_FACES:
        once = replace(cage, level=1).refine()
        used = points[cage.topology.indices]
        tolerance = CHORD_TOLERANCE * float(np.linalg.norm(used.max(axis=0) - used.min(axis=0)))
        error, wanted = once.chord_error(points), 0
        while error > tolerance and wanted < allowed:
            error /= LEVEL_GAIN
            wanted += 1
    sharpest = _sharpest(cage)
    wanted = min(max(wanted, int(np.ceil(sharpest))), allowed)
    level = wanted
    while level > 0 and _face_count(cage, level) > MAX_REFINED_FACES:
        level -= 1
    if level < wanted:
        reason = f"level {level} of {wanted}: more than {MAX_REFINED_FACES:,} faces otherwise"
        context.note(prim, "subdivisionScheme", "approximated", reason)
    if sharpest > level:
        reason = f"sharpness {sharpest:.3g} taken as infinite from level {level} on"
        context.note(prim, "creaseSharpnesses", "approximated", reason)
    surface = once if once and level == 1 else replace(cage, level=level).refine()
    if cage.boundary == "none":
        open_faces = np.setdiff1d(surface.cage_faces[surface.hole_faces], cage.hole_faces)
        reason = f"{len(open_faces)} faces at the boundary are no surface: it is not interpolated"
        context.note(prim, "interpolateBoundary", "noted", reason)
    return surface


def _sharpest(cage: SubdivisionCage) -> float:
    """Greatest finite sharpness: so many levels are rounded off less than those after them."""
    sharpness = np.append(cage.edge_sharpness, cage.point_sharpness)
    return float(sharpness[sharpness < INFINITE_SHARPNESS].max(initial=0.0))


def _face_count(cage: SubdivisionCage, level: int) -> int:
    """Refined faces: a corner gives one at the first level, a face four at each after it."""
    counts = cage.sound.counts
    first = 4 * len(counts) if cage.scheme == "loop" else int(counts.sum(dtype=np.int64))
    return first * 4 ** (level - 1) if level > 0 else len(counts)


def _too_many(cage: SubdivisionCage) -> str:
    """Why a cage can't be refined for its size; empty where it can."""
    if len(cage.faces) == 0:
        return "no face has three corners"
    counts = cage.topology.counts.astype(np.int64)
    valences = np.bincount(cage.topology.indices).astype(np.int64)
    if (counts**2).sum() + (valences**2).sum() > MAX_SHARED_TERMS:
        return f"{max(counts.max(), valences.max()):,} corners at one face or point"
    return ""


def _read_cage(
    mesh: UsdGeom.Mesh,
    scheme: str,
    topology: MeshTopology,
    hole_faces: NDArray[np.int32],
    context: ReadingContext,
) -> SubdivisionCage:
    prim = mesh.GetPrim()
    faces, corners = sound_faces(topology)
    if scheme == "loop" and (topology.counts[faces] > 3).any():
        quads = int((topology.counts[faces] > 3).sum())
        reason = f"loop wants triangles and {quads} faces are none: catmullClark instead"
        context.note(prim, "subdivisionScheme", "approximated", reason)
        scheme = "catmullClark"
    edges = _creases(mesh, topology, context)
    tips = _corners(mesh, topology, context)
    triangle_rule = mesh.GetTriangleSubdivisionRuleAttr().Get(context.time)
    return SubdivisionCage(
        topology=topology,
        faces=faces,
        corners=corners,
        hole_faces=hole_faces,
        sharp_edges=edges.points.reshape(-1, 2),
        edge_sharpness=edges.sharpness,
        sharp_points=tips.points,
        point_sharpness=tips.sharpness,
        scheme=scheme,  # type: ignore[arg-type]
        boundary=_token(
            mesh.GetInterpolateBoundaryAttr(),
            ("edgeAndCorner", "edgeOnly", "none"),
            context,
        ),
        face_varying=_token(
            mesh.GetFaceVaryingLinearInterpolationAttr(),
            ("cornersPlus1", "cornersPlus2", "cornersOnly", "boundaries", "none", "all"),
            context,
        ),
        smooth_triangles=triangle_rule == UsdGeom.Tokens.smooth,
        level=0,
    )


def _token(attribute: Usd.Attribute, known: tuple[str, ...], context: ReadingContext) -> str:
    """One of the tokens that USD knows; the first is its fallback."""
    value = str(attribute.Get(context.time))
    if value in known:
        return value
    reason = f'"{value}" is none of {", ".join(known)}: {known[0]} instead'
    context.note(attribute.GetPrim(), attribute.GetName(), "repaired", reason)
    return known[0]


def _creases(mesh: UsdGeom.Mesh, topology: MeshTopology, context: ReadingContext) -> _Sharp:
    """(E, 2) sharp edges: each chain of points with one sharpness, or one an edge."""
    prim = mesh.GetPrim()
    none = _Sharp(np.zeros((0, 2), np.int32), np.zeros(0, np.float32))
    lengths = _numbers(mesh.GetCreaseLengthsAttr(), context, np.int64)
    points = _numbers(mesh.GetCreaseIndicesAttr(), context, np.int64)
    sharpness = _numbers(mesh.GetCreaseSharpnessesAttr(), context, np.float32)
    if len(lengths) == 0 and len(points) == 0 and len(sharpness) == 0:
        return none
    fault = ""
    if (lengths < 0).any():
        fault = f"a crease of {lengths.min()} points"
    elif len(sharpness) not in (len(lengths), np.maximum(lengths - 1, 0).sum()):
        fault = f"{len(sharpness)} sharpnesses for {len(lengths)} creases"
    elif not np.isfinite(sharpness).all():
        fault = "a sharpness that is not finite"
    if fault:
        context.note(prim, "creaseIndices", "repaired", f"{fault}: no creases")
        return none
    if lengths.sum() != len(points):
        reason = f"{len(points)} points for creases of {lengths.sum()}: those that are there"
        context.note(prim, "creaseIndices", "repaired", reason)
    ends = np.minimum(np.cumsum(lengths), len(points))
    starts = np.concatenate([np.zeros(1, np.int64), ends[:-1]])
    edge_counts = np.maximum(ends - starts - 1, 0)
    crease = np.repeat(np.arange(len(lengths)), edge_counts)
    place = np.arange(len(crease)) - np.repeat(np.cumsum(edge_counts) - edge_counts, edge_counts)
    edges = np.column_stack([points[starts[crease] + place + i] for i in (0, 1)])
    if len(sharpness) == len(lengths):
        sharpness = sharpness[crease]
    else:
        authored = np.maximum(lengths - 1, 0)
        sharpness = sharpness[(np.cumsum(authored) - authored)[crease] + place]
    known = np.isin(_edge_keys(edges, topology.point_count), _mesh_edges(topology))
    known &= ((edges >= 0) & (edges < topology.point_count)).all(axis=1)
    if not known.all():
        reason = f"{(~known).sum()} creases join no points of an edge and are ignored"
        context.note(prim, "creaseIndices", "repaired", reason)
    sharp = known & (sharpness > 0)
    return _Sharp(np.ascontiguousarray(edges[sharp], np.int32), sharpness[sharp])


def _corners(mesh: UsdGeom.Mesh, topology: MeshTopology, context: ReadingContext) -> _Sharp:
    """Single points that are sharp."""
    points = _numbers(mesh.GetCornerIndicesAttr(), context, np.int64)
    sharpness = _numbers(mesh.GetCornerSharpnessesAttr(), context, np.float32)
    if len(points) != len(sharpness) or not np.isfinite(sharpness).all():
        reason = f"{len(points)} cornerIndices, {len(sharpness)} finite sharpnesses wanted"
        context.note(mesh.GetPrim(), "cornerIndices", "repaired", f"{reason}: no corners")
        return _Sharp(np.zeros(0, np.int32), np.zeros(0, np.float32))
    known = (points >= 0) & (points < topology.point_count)
    if not known.all():
        reason = f"{(~known).sum()} corners are no points and are ignored"
        context.note(mesh.GetPrim(), "cornerIndices", "repaired", reason)
    sharp = known & (sharpness > 0)
    return _Sharp(points[sharp].astype(np.int32), sharpness[sharp])


def _edge_keys(edges: NDArray[np.integer], point_count: int) -> NDArray[np.int64]:
    low, high = np.minimum(*edges.T).astype(np.int64), np.maximum(*edges.T).astype(np.int64)
    return low * point_count + high


def _mesh_edges(topology: MeshTopology) -> NDArray[np.int64]:
    """Keys of all edges."""
    after = np.arange(1, len(topology.indices) + 1)
    full = topology.counts > 0
    after[(topology.starts + topology.counts)[full] - 1] = topology.starts[full]
    edges = np.column_stack([topology.indices, topology.indices[after]])
    return np.unique(_edge_keys(edges, topology.point_count))


def _numbers(attribute: Usd.Attribute, context: ReadingContext, dtype: type) -> NDArray:
    return number_array(attribute, context.time, dtype)
