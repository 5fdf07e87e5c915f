"""Values of shader inputs on the faces of one mesh: the mean over each face."""

from __future__ import annotations

from collections import OrderedDict
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom

from .attribute_colours import attribute_colours
from .mesh_topology import MeshTopology
from .reading_context import ReadingContext
from .scene_description import FindingAction
from .shader_values import (
    Combined,
    Constant,
    Coordinates,
    PrimvarValue,
    Textured,
    Value,
    evaluate,
)
from .subdivision import RefinedSurface
from .texture_mean import TexelSums

# Sums of texels kept for the next mesh.
KEPT_BYTES = 1 << 29
# Beyond it single precision no longer tells one texel from the next.
MAX_COORDINATE = 1e6
# Coordinates this far beyond a picture are no rounding, in pictures.
OUTSIDE = 1e-3
_WHOLE = np.array([[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]], float)


class TextureMeans:
    """Means of textures over triangles; the sums behind them are kept while KEPT_BYTES allow."""

    def __init__(self) -> None:
        self._kept: OrderedDict[tuple[int, int], tuple[Textured, TexelSums]] = OrderedDict()

    def over(self, texture: Textured, triangles: NDArray[np.float64]) -> NDArray[np.float64]:
        """(T, C) mean over each triangle; triangles: (T, 3, 2) finite texture coordinates."""
        if not texture.layout.is_udim:
            return self._sums(texture, 0).triangle_means(triangles)
        cells = np.floor(triangles.mean(axis=1))
        numbers = udim_numbers(triangles)
        means = np.tile(texture.outside, (len(triangles), 1))
        for number in texture.tiles:
            inside = numbers == number
            if inside.any():
                local = triangles[inside] - cells[inside, None]
                means[inside] = self._sums(texture, number).triangle_means(local)
        return means

    def whole(self, texture: Textured) -> NDArray[np.float64]:
        """(C,) mean of all texels, over all tiles."""
        sums = [self._sums(texture, number) for number in texture.tiles]
        return np.mean([s.triangle_means(_WHOLE).mean(axis=0) for s in sums], axis=0)

    def limits(self, texture: Textured) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(C,) the least and the greatest that a mean can be."""
        limits = [self._sums(texture, number).limits for number in texture.tiles]
        if texture.layout.is_udim:
            limits.append((texture.outside, texture.outside))
        low, high = zip(*limits, strict=True)
        return np.min(low, axis=0), np.max(high, axis=0)

    def _sums(self, texture: Textured, number: int) -> TexelSums:
        key = (id(texture), number)
        if key not in self._kept:
            sums = TexelSums(texture.tiles[number](), texture.layout.wrap, texture.outside)
            self._kept[key] = (texture, sums)
            while (
                len(self._kept) > 1 and sum(s.nbytes for _, s in self._kept.values()) > KEPT_BYTES
            ):
                self._kept.popitem(last=False)
        self._kept.move_to_end(key)
        return self._kept[key][1]


def udim_numbers(triangles: NDArray[np.float64]) -> NDArray[np.int64]:
    """(T,) number of the tile in which each triangle lies; 0: none."""
    cells = np.floor(triangles.mean(axis=1)).astype(np.int64)
    is_tile = (cells >= 0).all(axis=1) & (cells[:, 0] < 10)
    return np.where(is_tile, 1001 + cells @ (1, 10), 0)


class FaceValues:
    """Brings values to the faces of one mesh: of a subdivision surface, to its refined faces."""

    def __init__(
        self,
        prim: Usd.Prim,
        topology: MeshTopology,
        context: ReadingContext,
        means: TextureMeans,
        refined: RefinedSurface | None = None,
    ) -> None:
        self._prim = prim
        self._authored = topology
        self._refined = refined
        self._topology = topology if refined is None else refined.topology
        self._context = context
        self._means = means
        self._primvars: dict[str, tuple[NDArray[np.floating], str] | None] = {}
        self._noted: set[str] = set()

    def of(self, value: Value, faces: NDArray[np.int64] | None = None) -> NDArray[np.floating]:
        """(1, C) or (n, C) mean over each of the faces; None: over all."""
        if isinstance(value, Constant):
            return value.value[None, :]
        if isinstance(value, PrimvarValue):
            found = self.primvar(value.name)
            if found is None:
                return value.fallback[None, :]
            return found if faces is None or len(found) == 1 else found[faces]
        if isinstance(value, Combined):
            return evaluate(value, [self.of(operand, faces) for operand in value.operands])
        return self._textured(value, faces)

    def primvar(self, name: str) -> NDArray[np.floating] | None:
        """(1, C) or (F, C) mean over each face of a primvar, inherited ones too; None: none."""
        found = self._found(name)
        return None if found is None else self._topology.to_faces(*found)

    def _found(self, name: str) -> tuple[NDArray[np.floating], str] | None:
        if name not in self._primvars:
            self._primvars[name] = (
                self._read(name) if Sdf.Path.IsValidNamespacedIdentifier(name) else None
            )
        return self._primvars[name]

    def _read(self, name: str) -> tuple[NDArray[np.floating], str] | None:
        """Values of a primvar and its interpolation; None where there is none that can be used."""
        primvar = UsdGeom.PrimvarsAPI(self._prim).FindPrimvarWithInheritance(name)
        if not (primvar and primvar.HasAuthoredValue()):
            return None
        flattened = primvar.ComputeFlattened(self._context.time)
        values = np.asarray([] if flattened is None else flattened)
        if values.dtype.kind not in "biuf":
            self._repaired(name, f"a {primvar.GetTypeName()} is no colour and no number: ignored")
            return None
        values = values.reshape(-1, 1) if values.ndim < 2 else values.reshape(len(values), -1)
        interpolation = str(primvar.GetInterpolation())
        if not self._authored.has_values(values, interpolation):
            wanted = self._authored.value_count(interpolation)
            self._repaired(name, f"{len(values)} {interpolation} values, {wanted} wanted: ignored")
            return None
        if values.shape[1] == 3:
            values = attribute_colours(primvar.GetAttr(), values, self._context)
        if self._refined is not None:
            values = self._refined.refine_primvar(values, interpolation)
        return values, interpolation

    def _repaired(self, name: str, reason: str) -> None:
        self._context.note(self._prim, name, "repaired", reason)

    def _textured(self, texture: Textured, faces: NDArray[np.int64] | None) -> NDArray[np.floating]:
        coordinates = texture.layout.coordinates
        if coordinates is None:
            self._note_once("no texture coordinates: a texture is read as its mean colour")
            return self._means.whole(texture)[None, :]
        corners = self._corners(coordinates)
        if corners is None:
            name = coordinates.primvar
            self._note_once(f"no primvar {name or 'named'}: a texture is read as its mean colour")
            return self._means.whole(texture)[None, :]
        if len(corners) == 1:
            triangle = np.broadcast_to(corners, (1, 3, 2))
            return self._means.over(texture, triangle)
        triangles, weights, owners = self._triangles
        if faces is not None:
            chosen = np.zeros(len(self._topology.counts), bool)
            chosen[faces] = True
            kept = chosen[owners]
            triangles, weights, owners = triangles[kept], weights[kept], owners[kept]
        places = corners[triangles]
        means = self._means.over(texture, places)
        self._note_what_is_outside(texture, places)
        total = np.zeros((len(self._topology.counts), means.shape[1]))
        for channel in range(means.shape[1]):
            total[:, channel] = np.bincount(
                owners, means[:, channel] * weights, minlength=len(total)
            )
        if (weights < 0).any():  # parts of a bent concave face may add up to more than there is
            np.clip(total, *self._means.limits(texture), out=total)
        return total if faces is None else total[faces]

    def _note_what_is_outside(self, texture: Textured, triangles: NDArray[np.float64]) -> None:
        if texture.layout.is_udim:
            missing = sorted(set(udim_numbers(triangles).tolist()) - set(texture.tiles))
            if missing:
                tiles = ", ".join(str(number) for number in missing[:5])
                self._note_once(f"no texture tile {tiles}: the fallback of the texture instead")
        beyond = (triangles < -OUTSIDE).any(axis=(0, 1)) | (triangles > 1 + OUTSIDE).any(
            axis=(0, 1)
        )
        if (beyond & (np.array(texture.layout.wrap) == "black")).any():
            reason = "faces reach beyond a texture that is black there by its wrap mode"
            self._note_once(reason, "noted")

    def _corners(self, coordinates: Coordinates) -> NDArray[np.float64] | None:
        """(1, 2) or (C, 2) texture coordinates of corners; None where the mesh has none."""
        values, interpolation = np.zeros((1, 2)), "constant"
        if coordinates.primvar is not None:
            found = self._found(coordinates.primvar)
            if found is not None and found[0].shape[1] >= 2:
                values, interpolation = found[0][:, :2].astype(np.float64), found[1]
            elif coordinates.fallback is not None:
                values = np.array([coordinates.fallback])
            else:
                return None
        values = coordinates.of(values)
        broken = ~(np.abs(values) <= MAX_COORDINATE).all(axis=1)
        if broken.any():
            name = coordinates.primvar or "their node"
            self._note_once(f"{broken.sum()} values of {name} are no coordinates", "repaired")
            values[broken] = 0
        if interpolation == "constant":
            return values
        return self._topology.to_corners(values, interpolation)

    def _note_once(self, reason: str, action: FindingAction = "approximated") -> None:
        if reason not in self._noted:
            self._noted.add(reason)
            self._context.note(self._prim, "texture", action, reason)

    @cached_property
    def _triangles(
        self,
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]:
        """Fans of triangles: (T, 3) corners, (T,) share in the area of their face, (T,) face.

        Shares are negative where a concave face folds back over itself; they add up to 1.
        """
        counts = self._topology.counts.astype(np.int64)
        number = np.maximum(counts - 2, 1)
        owners = np.repeat(np.arange(len(counts)), number)
        nth = np.arange(len(owners)) - np.repeat(np.cumsum(number) - number, number)
        last = counts[owners] - 1
        within = np.stack(
            [np.zeros_like(nth), np.minimum(nth + 1, last), np.minimum(nth + 2, last)]
        )
        corners = self._topology.starts[owners] + np.maximum(within, 0)
        corners = np.minimum(corners, len(self._topology.indices) - 1).T
        if (number == 1).all():
            return corners, np.ones(len(owners)), owners
        shares = self._signed_areas(corners, owners)
        total = np.bincount(owners, shares, minlength=len(counts))
        flat = ~(total > 0)
        shares = np.where(flat[owners], 1.0, shares)
        return corners, shares / np.where(flat, number, total)[owners], owners

    def _signed_areas(
        self, corners: NDArray[np.int64], owners: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        authored = self._context.value(self._prim, "points", [])
        points = np.asarray(authored, np.float64).reshape(-1, 3)
        if len(points) != self._topology.point_count or not np.isfinite(points).all():
            return np.ones(len(owners))
        a, b, c = (points[self._topology.indices[corners[:, k]]] for k in range(3))
        normals = np.cross(b - a, c - a)
        whole = np.stack(
            [
                np.bincount(owners, normals[:, axis], minlength=len(self._topology.counts))
                for axis in range(3)
            ],
            axis=-1,
        )
        return np.einsum("ij,ij->i", normals, whole[owners])
