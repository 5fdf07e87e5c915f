"""Polygon shapes for the scene generators: boxes, cushions, lathes, tubes, sheets.

Lengths are in metres, +Y is up, corners run counter-clockwise seen from the front. Every shape is
tessellated to edges of about `step`, because the solver's results are per vertex.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

Points = NDArray[np.float64]

WELD_TOLERANCE = 1e-6  # m; well below any modelled detail, well above rounding


@dataclass(frozen=True, slots=True)
class Shape:
    """Triangles and quads.

    points : (P, 3) float64, m
    counts : (F,) int32, 3 or 4
    indices : (C,) int32, each in [0, P)
    """

    points: Points
    counts: NDArray[np.int32]
    indices: NDArray[np.int32]

    def moved(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Shape:
        """Translated by (x, y, z) m."""
        return Shape(self.points + np.array([x, y, z]), self.counts, self.indices)

    def turned(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Shape:
        """Rotated about the X, then Y, then Z axis by degrees."""
        points = self.points
        for axis, degrees in enumerate((x, y, z)):
            i, j = (axis + 1) % 3, (axis + 2) % 3
            turn = np.eye(3)
            turn[[i, j], [i, j]] = np.cos(np.radians(degrees))
            turn[j, i] = np.sin(np.radians(degrees))
            turn[i, j] = -turn[j, i]
            points = points @ turn.T
        return Shape(points, self.counts, self.indices)

    def flipped(self) -> Shape:
        """The same surface with its front on the other side."""
        starts = np.repeat(np.cumsum(self.counts) - self.counts, self.counts)
        ends = np.repeat(np.cumsum(self.counts) - 1, self.counts)
        reverse = starts + ends - np.arange(len(self.indices))
        return Shape(self.points, self.counts, self.indices[reverse])

    def area(self) -> float:
        """Area of one side, m^2."""
        return float(np.linalg.norm(face_area_normals(self), axis=1).sum())


def from_triangles(triangles: Points) -> Shape:
    """Triangles (T, 3, 3), m; corners that coincide are shared."""
    count = len(triangles)
    return _weld(triangles.reshape(-1, 3), np.full(count, 3), np.arange(3 * count))


def merge(*shapes: Shape) -> Shape:
    """One shape of several; points that coincide are shared, faces that collapse are dropped."""
    offsets = np.cumsum([0] + [len(shape.points) for shape in shapes[:-1]])
    points = np.concatenate([shape.points for shape in shapes])
    indices = np.concatenate(
        [shape.indices + offset for shape, offset in zip(shapes, offsets, strict=True)]
    )
    counts = np.concatenate([shape.counts for shape in shapes])
    return _weld(points, counts, indices)


def from_grid(grid: Points, *, closed_rows: bool = False, closed_columns: bool = False) -> Shape:
    """Quads over a grid of points; the front is (along rows' index) x (along columns' index).

    grid : (R, C, 3) m
    closed_rows, closed_columns : the last row (column) is joined to the first
    """
    rows, columns = grid.shape[:2]
    i, j = np.meshgrid(
        np.arange(rows if closed_rows else rows - 1),
        np.arange(columns if closed_columns else columns - 1),
        indexing="ij",
    )
    i1, j1 = (i + 1) % rows, (j + 1) % columns
    corners = np.stack([i * columns + j, i1 * columns + j, i1 * columns + j1, i * columns + j1], -1)
    indices = corners.reshape(-1)
    return _weld(grid.reshape(-1, 3), np.full(len(indices) // 4, 4), indices)


def rectangle(
    corner: ArrayLike,
    u: ArrayLike,
    v: ArrayLike,
    step: float,
    u_breaks: Sequence[float] = (),
    v_breaks: Sequence[float] = (),
) -> Shape:
    """A rectangle with edges u and v from a corner; the front is u x v.

    u_breaks, v_breaks : distances from the corner, m, where an edge of the tessellation must run
    """
    length_u, length_v = float(np.linalg.norm(u)), float(np.linalg.norm(v))
    us = divided([0.0, *u_breaks, length_u], step)
    vs = divided([0.0, *v_breaks, length_v], step)
    grid = us[:, None, None] * np.asarray(u) / length_u + vs[:, None] * np.asarray(v) / length_v
    return from_grid(grid + np.asarray(corner))


def with_opening(shape: Shape, low: Sequence[float], high: Sequence[float]) -> Shape:
    """A shape of quads without those whose centres lie between two corners of a box, m."""
    quads = shape.indices.reshape(-1, 4)
    centre = shape.points[quads].mean(axis=1)
    kept = quads[~((np.array(low) < centre) & (centre < np.array(high))).all(axis=1)]
    return _weld(shape.points, np.full(len(kept), 4), kept.reshape(-1))


def box(size: Sequence[float], step: float, rounding: float = 0.0) -> Shape:
    """A closed box centred at the origin.

    size : width, height, depth, m
    rounding : radius of its edges and corners, m
    """
    half = np.asarray(size, float) / 2
    band = [np.array([-h, -h + rounding, h - rounding, h]) for h in half]
    lines = [divided(breaks, step, least=2 if rounding else 1) for breaks in band]
    shape = _box_surface(lines)
    if not rounding:
        return shape
    core = np.clip(shape.points, -half + rounding, half - rounding)
    outward = shape.points - core
    outward *= rounding / np.linalg.norm(outward, axis=1, keepdims=True)
    return Shape(core + outward, shape.counts, shape.indices)


def superellipsoid(size: Sequence[float], exponent: float, step: float) -> Shape:
    """A closed cushion |x/a|^n + |y/b|^n + |z/c|^n = 1 of full `size`, centred at the origin."""
    half = np.asarray(size, float) / 2
    lines = [divided([-1.0, 1.0], step / h, least=4) for h in half]
    shape = _box_surface(lines)
    radius = (np.abs(shape.points) ** exponent).sum(axis=1, keepdims=True) ** (1 / exponent)
    return Shape(shape.points / radius * half, shape.counts, shape.indices)


def lathe(profile: ArrayLike, step: float, around: int = 16) -> Shape:
    """A surface of revolution about +Y; the front is on the right of the profile's direction.

    profile : (n, 2) radius and height, m; a body from its lowest to its highest point has its
        front outside
    around : least number of segments in a turn
    """
    profile = np.asarray(profile, float)
    segments = max(around, round(2 * np.pi * profile[:, 0].max() / step))
    angle = np.arange(segments) * 2 * np.pi / segments
    radius, height = profile[:, :1], profile[:, 1:]
    grid = np.stack([radius * np.cos(angle), height + 0 * angle, radius * np.sin(angle)], axis=-1)
    return from_grid(grid, closed_columns=True)


def tube(path: ArrayLike, radius: float, step: float, around: int = 8) -> Shape:
    """A closed round bar along a path of points (n, 3), m."""
    path = np.asarray(path, float)
    segments = max(around, round(2 * np.pi * radius / step))
    angle = np.arange(segments) * 2 * np.pi / segments
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side = np.cross(tangent[0], np.eye(3)[np.argmin(np.abs(tangent[0]))])
    rings = []
    for point, along in zip(path, tangent, strict=True):
        side = side - (side @ along) * along  # carried along the path without twist
        side /= np.linalg.norm(side)
        across = np.cross(along, side)
        rings.append(
            point + radius * (np.outer(np.cos(angle), side) + np.outer(np.sin(angle), across))
        )
    centre = np.ones((segments, 1))
    rings = [centre * path[0], *rings, centre * path[-1]]
    return from_grid(np.array(rings)[::-1], closed_columns=True)


def slab(grid: Points, thickness: float) -> Shape:
    """A closed sheet of material around a grid of points (R, C, 3), m."""
    along, across = np.gradient(grid, axis=0), np.gradient(grid, axis=1)
    normal = np.cross(along, across)
    normal *= thickness / 2 / np.linalg.norm(normal, axis=-1, keepdims=True)
    front, back = grid + normal, grid - normal
    rim = [
        np.stack([back[0], front[0]]),
        np.stack([front[-1], back[-1]]),
        np.stack([front[:, 0], back[:, 0]]),
        np.stack([back[:, -1], front[:, -1]]),
    ]
    return merge(from_grid(front), from_grid(back).flipped(), *(from_grid(strip) for strip in rim))


def spline(control: ArrayLike, step: float) -> Points:
    """Points about `step` apart on the Catmull-Rom curve through control points (n, d)."""
    control = np.asarray(control, float)
    ends = 2 * control[0] - control[1], 2 * control[-1] - control[-2]
    p = np.vstack([ends[0], control, ends[1]])
    t = np.linspace(0, 1, 33)[:-1, None]
    spans = [
        0.5
        * (2 * b + (c - a) * t + (2 * a - 5 * b + 4 * c - d) * t**2 + (3 * (b - c) + d - a) * t**3)
        for a, b, c, d in zip(p, p[1:], p[2:], p[3:], strict=False)
    ]
    curve = np.vstack([*spans, control[-1:]])
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    even = np.linspace(0, length[-1], max(3, round(length[-1] / step)) + 1)
    return np.stack([np.interp(even, length, column) for column in curve.T], axis=-1)


def polyline(control: ArrayLike, step: float) -> Points:
    """Straight spans through control points (n, d), each divided to about `step`."""
    control = np.asarray(control, float)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(control, axis=0), axis=1))])
    even = divided(length, step)
    return np.stack([np.interp(even, length, column) for column in control.T], axis=-1)


def divided(breaks: ArrayLike, step: float, least: int = 1) -> Points:
    """Break points with every interval divided evenly to about `step`, `least` parts or more."""
    breaks = np.unique(np.asarray(breaks, float))
    parts = [
        np.linspace(a, b, max(least, round((b - a) / step)) + 1)[:-1] for a, b in pairwise(breaks)
    ]
    return np.concatenate([*parts, breaks[-1:]])


def corner_normals(shape: Shape, crease_angle: float = 40.0) -> NDArray[np.float32]:
    """Unit normals of the face corners, smooth except across creases.

    crease_angle : degrees; faces that meet at a sharper angle keep their own normals
    returns : (C, 3) float32
    """
    area_normals = face_area_normals(shape)
    face_of_corner = np.repeat(np.arange(len(shape.counts)), shape.counts)
    order = np.argsort(shape.indices, kind="stable")
    valence = np.bincount(shape.indices, minlength=len(shape.points))
    first = np.cumsum(valence) - valence
    unit = area_normals / np.linalg.norm(area_normals, axis=1, keepdims=True)
    own = unit[face_of_corner]
    total = np.zeros_like(own)
    for turn in range(valence.max()):  # each corner meets, in turn, the corners at its point
        has = turn < valence[shape.indices]
        neighbour = face_of_corner[order[first[shape.indices[has]] + turn]]
        smooth = (own[has] * unit[neighbour]).sum(axis=1) > np.cos(np.radians(crease_angle))
        total[has] += np.where(smooth[:, None], area_normals[neighbour], 0.0)
    return (total / np.linalg.norm(total, axis=1, keepdims=True)).astype(np.float32)


def face_area_normals(shape: Shape) -> Points:
    """(F, 3): normals of the faces, as long as their areas in m^2."""
    p = shape.points[shape.indices]
    first = np.cumsum(shape.counts) - shape.counts
    normals = 0.5 * np.cross(p[first + 1] - p[first], p[first + 2] - p[first])
    quads = shape.counts == 4
    q = first[quads]
    normals[quads] += 0.5 * np.cross(p[q + 2] - p[q], p[q + 3] - p[q])
    return normals


def _box_surface(lines: Sequence[Points]) -> Shape:
    """The six sides of a box on the given coordinates along X, Y and Z, front outside."""
    sides = []
    for axis in range(3):
        u, v = np.meshgrid(lines[(axis + 1) % 3], lines[(axis + 2) % 3], indexing="ij")
        for end in (0, -1):
            grid = np.empty((*u.shape, 3))
            grid[..., (axis + 1) % 3], grid[..., (axis + 2) % 3] = u, v
            grid[..., axis] = lines[axis][end]
            side = from_grid(grid)
            sides.append(side if end == -1 else side.flipped())
    return merge(*sides)


def _weld(points: Points, counts: ArrayLike, indices: ArrayLike) -> Shape:
    keys = np.round(points / WELD_TOLERANCE).astype(np.int64)
    _, kept, point_of = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    counts, corners = np.asarray(counts), point_of.reshape(-1)[np.asarray(indices)]
    # A quad with an edge of no length becomes a triangle; what has less than three corners goes.
    face = np.repeat(np.arange(len(counts)), counts)
    starts = np.repeat(np.cumsum(counts) - counts, counts)
    following = np.where(
        np.arange(len(corners)) + 1 < starts + counts[face], np.arange(len(corners)) + 1, starts
    )
    distinct = corners != corners[following]
    counts = np.bincount(face[distinct], minlength=len(counts))
    used, corners = np.unique(corners[distinct & (counts >= 3)[face]], return_inverse=True)
    return Shape(points[kept][used], counts[counts >= 3].astype(np.int32), corners.astype(np.int32))
