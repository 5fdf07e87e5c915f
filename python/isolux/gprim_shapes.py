"""Gprims given by numbers (sphere, cube, cylinder, cone, capsule, plane) as polygons.

Sizes and axes are those of UsdGeom's schemas. Every corner lies on the shape and carries its exact
normal; polygons are inscribed, so that round shapes fall short of their area by what
`SEGMENTS_AROUND` says.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pxr import Usd

# Faces around a round shape, a multiple of 4 so that the extremes along the axes are corners.
# With t = pi/n, the area of a cylinder's side is sin(t)/t of the true one, that of a disk
# sin(2t)/2t: 0.07 % and 0.29 % too small; that of a sphere is 0.36 % too small.
SEGMENTS_AROUND = 48
# Faces along each edge of a cube or plane, and along the radius of an end cap: illumination is
# known at corners alone, and a room's wall is often one gprim.
SEGMENTS_ALONG = 8
# Sizes that single precision holds: points of a stage, those of the results too, have no others.
_SMALLEST, _LARGEST = float(np.finfo(np.float32).tiny), float(np.finfo(np.float32).max)


@dataclass(frozen=True, slots=True)
class Polygons:
    """A shape in its own space, in stage units; corners run counter-clockwise seen from outside.

    points : (P, 3) float64
    counts : (F,) int32, corners of each face
    indices : (C,) int32, point of each corner
    normals : (C, 3) float64, unit; None: those of the faces
    """

    points: NDArray[np.float64]
    counts: NDArray[np.int32]
    indices: NDArray[np.int32]
    normals: NDArray[np.float64] | None


class ShapeError(ValueError):
    """A size that no shape has; the message says which."""


def tessellate(prim: Usd.Prim, time: Usd.TimeCode) -> Polygons | None:
    """A gprim's polygons; None where its type is no shape of this file.

    raises : ShapeError
    """
    make = _SHAPES.get(str(prim.GetTypeName()))
    if make is None:
        return None
    return make(_Sizes(prim, time))


class _Sizes:
    """The numbers of one gprim."""

    def __init__(self, prim: Usd.Prim, time: Usd.TimeCode) -> None:
        self._prim = prim
        self._time = time

    def __call__(self, name: str, *, may_be_zero: bool = False) -> float:
        value = self._prim.GetAttribute(name).Get(self._time)
        if not isinstance(value, int | float):
            raise ShapeError(f"{name} {value!r}")
        if not (_SMALLEST <= value <= _LARGEST or (may_be_zero and value == 0)):
            raise ShapeError(f"{name} {value:g}")
        return float(value)

    def axis(self) -> str:
        """ "X", "Y" or "Z"."""
        axis = str(self._prim.GetAttribute("axis").Get(self._time))
        if axis not in ("X", "Y", "Z"):
            raise ShapeError(f"axis {axis}")
        return axis


@dataclass(frozen=True, slots=True)
class _Band:
    """Part of a shape of revolution between two circles around Z.

    start, end : (radius, z)
    start_normal, end_normal : the same components of the unit normal
    """

    start: tuple[float, float]
    end: tuple[float, float]
    start_normal: tuple[float, float]
    end_normal: tuple[float, float]


def _arc(radius: float, centre: float, from_angle: float, to_angle: float) -> list[_Band]:
    """Bands of a sphere around (0, 0, centre), by latitude in rad, rising."""
    segments = max(1, round((to_angle - from_angle) / (2 * np.pi) * SEGMENTS_AROUND))
    angles = np.linspace(from_angle, to_angle, segments + 1)
    # At the poles exactly zero, or the pole would be a circle of points.
    cos = np.where(np.isclose(np.abs(angles), np.pi / 2), 0.0, np.cos(angles))
    circles = [(radius * c, centre + radius * s) for c, s in zip(cos, np.sin(angles), strict=True)]
    normals = list(zip(cos, np.sin(angles), strict=True))
    return [_Band(circles[i], circles[i + 1], normals[i], normals[i + 1]) for i in range(segments)]


def _straight(start: tuple[float, float], end: tuple[float, float], segments: int) -> list[_Band]:
    """Bands of a cone, a cylinder or a disk; outside is to the right of start to end."""
    run = np.array(end) - np.array(start)
    length = float(np.hypot(*run))
    if length == 0:
        return []
    normal = (float(run[1] / length), float(-run[0] / length))
    radii = np.linspace(start[0], end[0], segments + 1)
    heights = np.linspace(start[1], end[1], segments + 1)
    circles = list(zip(radii.tolist(), heights.tolist(), strict=True))
    return [_Band(circles[i], circles[i + 1], normal, normal) for i in range(segments)]


def _side(start: tuple[float, float], end: tuple[float, float]) -> list[_Band]:
    """A straight side in faces about as long as they are wide."""
    length = np.hypot(end[0] - start[0], end[1] - start[1])
    width = 2 * np.pi * max(start[0], end[0]) / SEGMENTS_AROUND
    along = round(min(length / width, SEGMENTS_AROUND)) if width > 0 else 1
    return _straight(start, end, max(1, along))


def _revolve(bands: list[_Band], axis: str) -> Polygons:
    """Polygons of bands that join, from the lowest to the highest."""
    n = SEGMENTS_AROUND
    azimuth = 2 * np.pi * np.arange(n) / n
    around = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    # Quarter turns exactly, so that opposite points mirror each other.
    around[np.abs(around) < 1e-15] = 0.0
    middle = azimuth + np.pi / n
    between = np.stack([np.cos(middle), np.sin(middle)], axis=1)
    here, after = np.arange(n), (np.arange(n) + 1) % n

    points: list[NDArray[np.float64]] = []
    count = 0

    def circle(radius: float, z: float) -> NDArray[np.int64]:
        """The circle's points, by segment; a circle without radius is one point."""
        nonlocal count
        xy = radius * around if radius > 0 else np.zeros((1, 2))
        points.append(np.column_stack([xy, np.full(len(xy), z)]))
        count += len(xy)
        return count - len(xy) + (np.arange(n) if radius > 0 else np.zeros(n, np.int64))

    def at(directions: NDArray[np.float64], normal: tuple[float, float]) -> NDArray[np.float64]:
        return np.column_stack([normal[0] * directions, np.full(n, normal[1])])

    counts, indices, normals = [], [], []
    below = circle(*bands[0].start)
    for band in bands:
        above = circle(*band.end)
        corners, corner_normals = [], []
        if band.start[0] > 0:
            corners += [below[here], below[after]]
            corner_normals += [at(around, band.start_normal)]
            corner_normals += [at(around[after], band.start_normal)]
        else:  # a pole has a normal a face, in the middle of it
            corners.append(below)
            corner_normals.append(at(between, band.start_normal))
        if band.end[0] > 0:
            corners += [above[after], above[here]]
            corner_normals += [at(around[after], band.end_normal), at(around, band.end_normal)]
        else:
            corners.append(above)
            corner_normals.append(at(between, band.end_normal))
        counts.append(np.full(n, len(corners)))
        indices.append(np.stack(corners, axis=1).ravel())
        normals.append(np.stack(corner_normals, axis=1).reshape(-1, 3))
        below = above
    return _polygons(points, counts, indices, normals, axis)


def _polygons(
    points: list[NDArray[np.float64]],
    counts: list[NDArray[np.int64]],
    indices: list[NDArray[np.int64]],
    normals: list[NDArray[np.float64]],
    axis: str = "Z",
) -> Polygons:
    """Arrays joined, Z turned to the axis; the axes keep their cyclic order, so none mirrors."""
    order = {"X": [2, 0, 1], "Y": [1, 2, 0], "Z": [0, 1, 2]}[axis]
    all_normals = np.concatenate(normals)[:, order]
    return Polygons(
        np.concatenate(points)[:, order],
        np.concatenate(counts).astype(np.int32),
        np.concatenate(indices).astype(np.int32),
        all_normals / np.linalg.norm(all_normals, axis=1, keepdims=True),
    )


def _grid(
    corner: NDArray[np.float64], u: NDArray[np.float64], v: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
    """Points, corner indices and corner normals of a parallelogram; its front is along u × v."""
    k = SEGMENTS_ALONG
    t = np.linspace(0, 1, k + 1)
    points = corner + t[None, :, None] * u + t[:, None, None] * v
    first = (np.arange(k)[:, None] * (k + 1) + np.arange(k)).ravel()
    indices = first[:, None] + np.array([0, 1, k + 2, k + 1])
    normal = np.cross(u, v)
    normals = np.tile(normal / np.linalg.norm(normal), (4 * k * k, 1))
    return points.reshape(-1, 3), indices.ravel(), normals


def _sphere(sizes: _Sizes) -> Polygons:
    radius = sizes("radius")
    return _revolve(_arc(radius, 0.0, -np.pi / 2, np.pi / 2), "Z")


def _cube(sizes: _Sizes) -> Polygons:
    half = sizes("size") / 2
    x, y, z = 2 * half * np.eye(3)
    low = np.full(3, -half)
    faces = [
        (low, y, x), (low + z, x, y), (low, x, z), (low + y, z, x), (low, z, y), (low + x, y, z),
    ]  # fmt: skip
    grids = [_grid(*face) for face in faces]
    points = np.concatenate([grid[0] for grid in grids])
    # Faces share the points of their edges: no seam for light or for the adaptive mesh.
    steps = np.rint((points / half + 1) * (SEGMENTS_ALONG / 2)).astype(np.int64)
    _, first, inverse = np.unique(steps, axis=0, return_index=True, return_inverse=True)
    per_face = len(grids[0][0])
    indices = [inverse.ravel()[grid[1] + i * per_face] for i, grid in enumerate(grids)]
    counts = [np.full(len(faces) * SEGMENTS_ALONG**2, 4)]
    return _polygons([points[first]], counts, indices, [grid[2] for grid in grids])


def _plane(sizes: _Sizes) -> Polygons:
    width, length, axis = sizes("width"), sizes("length"), sizes.axis()
    # Before the axes turn: width lies along X but for a plane across Y, where Z turns to it.
    x, y = (length, width) if axis in ("X", "Y") else (width, length)
    corner = np.array([-x / 2, -y / 2, 0.0])
    grid = _grid(corner, np.array([x, 0.0, 0.0]), np.array([0.0, y, 0.0]))
    counts = [np.full(SEGMENTS_ALONG**2, 4)]
    return _polygons([grid[0]], counts, [grid[1]], [grid[2]], axis)


def _cylinder(sizes: _Sizes) -> Polygons:
    radius = sizes("radius")
    return _frustum(radius, radius, sizes("height"), sizes.axis())


def _tapered_cylinder(sizes: _Sizes) -> Polygons:
    bottom = sizes("radiusBottom", may_be_zero=True)
    top = sizes("radiusTop", may_be_zero=True)
    return _frustum(bottom, top, sizes("height"), sizes.axis())


def _cone(sizes: _Sizes) -> Polygons:
    return _frustum(sizes("radius"), 0.0, sizes("height"), sizes.axis())


def _frustum(bottom: float, top: float, height: float, axis: str) -> Polygons:
    if bottom == top == 0:
        raise ShapeError("radiusBottom and radiusTop 0")
    low, high = -height / 2, height / 2
    bands = _straight((0.0, low), (bottom, low), SEGMENTS_ALONG)
    bands += _side((bottom, low), (top, high))
    bands += _straight((top, high), (0.0, high), SEGMENTS_ALONG)
    return _revolve(bands, axis)


def _capsule(sizes: _Sizes) -> Polygons:
    radius = sizes("radius")
    return _spherical_ends(radius, radius, sizes("height", may_be_zero=True), sizes.axis())


def _tapered_capsule(sizes: _Sizes) -> Polygons:
    bottom, top = sizes("radiusBottom"), sizes("radiusTop")
    return _spherical_ends(bottom, top, sizes("height", may_be_zero=True), sizes.axis())


def _spherical_ends(bottom: float, top: float, height: float, axis: str) -> Polygons:
    """A cylinder or a cone that two spheres end, smoothly: it touches them along its rims."""
    low, high = -height / 2, height / 2
    side = np.hypot(height, bottom - top)
    radial, rise = (height / side, (bottom - top) / side) if side > 0 else (1.0, 0.0)
    if radial == 0:
        raise ShapeError("height 0 between unequal radii")
    rim = float(np.arcsin(rise))  # latitude, rad, at which the side leaves both spheres
    bands = _arc(bottom / radial, low - bottom * rise / radial, -np.pi / 2, rim)
    if height > 0:
        bands += _side((bottom, low), (top, high))
    bands += _arc(top / radial, high - top * rise / radial, rim, np.pi / 2)
    return _revolve(bands, axis)


_SHAPES: dict[str, Callable[[_Sizes], Polygons]] = {
    "Capsule": _capsule,
    "Capsule_1": _tapered_capsule,
    "Cone": _cone,
    "Cube": _cube,
    "Cylinder": _cylinder,
    "Cylinder_1": _tapered_cylinder,
    "Plane": _plane,
    "Sphere": _sphere,
}
