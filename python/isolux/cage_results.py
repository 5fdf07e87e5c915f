"""Results of a subdivision surface, on its control cage.

The values c of the cage are those whose limit values S c come nearest to the solver's values v, by
weighted least squares: (SᵀAS) c = SᵀA v, A the area that each illumination vertex stands for. S
holds the limit stencils, so that whoever subdivides the primvar gets v again.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .output_fields import (
    OUTPUT_FIELDS,
    MeshCorners,
    OutputField,
    PrimvarLayout,
    PrimvarValues,
    VertexIlluminance,
    corner_values,
    face_kinds,
    surface_look,
)
from .scene_description import Finding, MeshDescription
from .solution import LUMINANCE_WEIGHTS, MeshLayout
from .subdivision import SubdivisionCage

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

# Relative residual of the normal equations at which the iteration stops, and the most steps: the
# condition of the limit masks is below 100 but for unused points.
FIT_ACCURACY = 1e-5
MAX_FIT_STEPS = 200
# Relative step at which the bounded iteration stops.
BOUNDED_ACCURACY = 3e-4
# Relative RMS difference from which on it is told.
TOLD_FIT_ERROR = 0.01


class CageFit:
    """Least squares on one stencil matrix, for any number of columns of values.

    stencils : (n, m) weights of m values of the cage at n places
    weights : (n,) float64 >= 0
    """

    def __init__(self, stencils: csr_matrix, weights: NDArray[np.float64]) -> None:
        if not weights.any():
            weights = np.ones_like(weights)
        self.stencils = stencils
        self._weighted = stencils.multiply(weights[:, None]).tocsr().T.tocsr()
        self._normal = (self._weighted @ stencils).tocsr()
        diagonal = self._normal.diagonal()
        self._preconditioner = _ratio(np.ones_like(diagonal), diagonal)[:, None]
        # Greatest row sum, which no eigenvalue of the preconditioned equations passes [Gershgorin].
        sums = self._normal @ np.ones(len(diagonal))
        self._stiffness = float((self._preconditioner[:, 0] * sums).max(initial=0.0)) or 1.0

    def solve(
        self,
        values: NDArray[np.floating],
        start: NDArray[np.float64] | None = None,
        most: float = np.inf,
    ) -> NDArray[np.float64]:
        """(m, K) float64 in [0, most] from (n, K).

        No light is negative: where free least squares asks for negative values on the cage, those
        in the range whose limit comes nearest take their place.

        start : a first guess, such as the values of the stage before
        """
        first, same = _distinct_columns(values)
        wanted = self._weighted @ values[:, first].astype(np.float64)
        found = np.zeros_like(wanted) if start is None else start[:, first]
        found = self._unbounded(wanted, found)
        outside = ((found < 0) | (found > most)).any(axis=0)
        if outside.any():
            found[:, outside] = self._bounded(wanted[:, outside], found[:, outside], most)
        return found[:, same]

    def _unbounded(
        self, wanted: NDArray[np.float64], found: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """By conjugate gradients."""
        residual = wanted - self._normal @ found
        enough = FIT_ACCURACY * np.linalg.norm(self._preconditioner * wanted, axis=0)
        direction = step = self._preconditioner * residual
        size = (residual * step).sum(axis=0)
        for _ in range(MAX_FIT_STEPS):
            if (np.linalg.norm(self._preconditioner * residual, axis=0) <= enough).all():
                break
            image = self._normal @ direction
            length = _ratio(size, (direction * image).sum(axis=0))
            found += length * direction
            residual -= length * image
            step = self._preconditioner * residual
            size, before = (residual * step).sum(axis=0), size
            direction = step + _ratio(size, before) * direction
        return found

    def _bounded(
        self, wanted: NDArray[np.float64], start: NDArray[np.float64], most: float
    ) -> NDArray[np.float64]:
        """By accelerated projected gradients [Beck and Teboulle 2009]."""
        found = ahead = np.clip(start, 0.0, most)
        pace = 1.0
        for _ in range(MAX_FIT_STEPS):
            gradient = self._preconditioner * (self._normal @ ahead - wanted)
            found, before = np.clip(ahead - gradient / self._stiffness, 0.0, most), found
            moved = np.linalg.norm(found - before, axis=0)
            if (moved <= BOUNDED_ACCURACY * np.linalg.norm(found, axis=0)).all():
                break
            pace, last = (1 + np.sqrt(1 + 4 * pace**2)) / 2, pace
            ahead = found + (last - 1) / pace * (found - before)
        return found


@dataclass(frozen=True, slots=True)
class _CageLayout:
    """Places on the refined surface, and the cage's values that give theirs.

    places : of the solver's values
    written : how the cage's values sit on it
    fit : from one to the other
    """

    places: PrimvarLayout
    written: PrimvarLayout
    fit: CageFit


class CageOutput:
    """The primvars of one subdivision surface on its cage, stage after stage.

    fit_error : relative RMS difference of the photometric illuminance between the limit values of
        the last stage's primvar and the solver's values, area-weighted

    mesh : with a cage
    areas : (V,) float64, m^2, of all vertices of the solution
    """

    def __init__(
        self, mesh: MeshDescription, layout: MeshLayout, areas: NDArray[np.float64]
    ) -> None:
        assert mesh.cage is not None
        self.path = mesh.path
        self.fit_error = self._noise = 0.0
        self._areas = areas
        corners = MeshCorners.of_authored(mesh, layout)
        look = surface_look(mesh)
        kinds = _cage_kinds(mesh.cage, face_kinds(look))
        crease = self._layout(mesh.cage, corners, look, np.zeros(1, np.int64))
        self._layouts = {
            "crease": crease,
            "reflectance": crease
            if len(kinds) == 1
            else self._layout(mesh.cage, corners, look, kinds),
        }
        self._before: dict[str, NDArray[np.float64]] = {}

    def primvars(
        self, illuminance: VertexIlluminance
    ) -> Iterator[tuple[OutputField, PrimvarLayout, NDArray[np.float32] | None]]:
        """Field, layout and values of each primvar; no values where this mesh hasn't the field."""
        crease, coloured = self._layouts["crease"], self._layouts["reflectance"]
        values = crease.places.gather(illuminance)
        fitted = self._fitted(crease, values)
        self._tell_fit(crease, values, fitted)
        for field in OUTPUT_FIELDS:
            if field.split == "crease":
                yield field, crease.written, field.values(fitted)
            else:
                colours = field.values(coloured.places.gather(illuminance))
                assert colours is not None
                yield field, coloured.written, self._solve(coloured, field.name, colours, 1.0)

    def _fitted(self, layout: _CageLayout, values: PrimvarValues) -> PrimvarValues:
        """The cage's illuminances; the total is the sum of its parts there too."""
        parts = [values.direct, values.indirect, values.relative_deviation[:, None]]
        if values.back is not None:
            parts.append(values.back)
        direct, indirect, deviation, *back = np.split(
            self._solve(layout, "illuminance", np.hstack(parts)), [3, 6, 7], axis=1
        )
        return replace(
            values,
            direct=direct,
            indirect=indirect,
            relative_deviation=deviation[:, 0],
            back=back[0] if values.back is not None else None,
        )

    def _solve(
        self, layout: _CageLayout, name: str, values: NDArray[np.float32], most: float = np.inf
    ) -> NDArray[np.float32]:
        fitted = layout.fit.solve(values, self._before.get(name), most)
        self._before[name] = fitted
        return fitted.astype(np.float32)

    def finding(self) -> Finding | None:
        """Says so where the cage does not give the solver's values again, but for their noise."""
        if self.fit_error <= np.hypot(TOLD_FIT_ERROR, self._noise):
            return None
        reason = (
            f"the limit of its values on the control cage is {100 * self.fit_error:.2g} % RMS off "
            "the illuminance that was solved; output mode refined keeps that"
        )
        return Finding(self.path, f"primvars:{OUTPUT_FIELDS[0].name}", "approximated", reason)

    def _tell_fit(self, layout: _CageLayout, values: PrimvarValues, fitted: PrimvarValues) -> None:
        """How far off the solver's values are, and how much of that may be their own noise."""
        areas = self._areas[layout.places.front]
        wanted = values.total @ LUMINANCE_WEIGHTS
        off = layout.fit.stencils @ (fitted.total @ LUMINANCE_WEIGHTS) - wanted
        total = float(areas @ wanted)
        self.fit_error, self._noise = (
            float(np.sqrt(areas.sum() * (areas @ part**2))) / total if total > 0 else 0.0
            for part in (off, values.relative_deviation * wanted)
        )

    def _layout(
        self,
        cage: SubdivisionCage,
        corners: MeshCorners,
        reflectance: NDArray[np.float32],
        kinds: NDArray[np.int64],
    ) -> _CageLayout:
        """One place for each pair of illumination vertex and kind of face."""
        places, place_of_corner = corner_values(corners, reflectance, kinds)
        if len(reflectance) > 1:
            means = _means(place_of_corner, reflectance[corners.faces], len(places.front))
            places = replace(places, reflectance=means)
        first_corner = np.zeros(len(places.front), np.int64)
        first_corner[place_of_corner[::-1]] = np.arange(len(place_of_corner))[::-1]
        on_surface = np.flatnonzero(places.front >= 0)

        surface = cage.refine()
        refined = surface.corners_of_cage
        keys = np.where(refined < 0, -1, place_of_corner[refined])
        keys[keys >= 0] = np.where(places.front[keys[keys >= 0]] < 0, -1, keys[keys >= 0])
        points = cage.topology.indices
        at_point = np.full(cage.topology.point_count, -1)
        at_point[points[keys >= 0]] = keys[keys >= 0]
        if (at_point[points[keys >= 0]] == keys[keys >= 0]).all():
            stencils = surface.limit_stencils
            rows = corners.points[first_corner[on_surface]]
            written = PrimvarLayout("vertex", places.front, places.back, places.reflectance, None)
        else:
            # Corners without light, at holes, still bear on their neighbours: a value a point.
            keys = np.where(keys < 0, len(places.front) + points, keys)
            indices = np.unique(keys, return_inverse=True)[1].ravel().astype(np.int32)
            stencils, corner_rows = cage.refine(indices).face_varying_stencils()
            rows = corner_rows[first_corner[on_surface]]
            written = PrimvarLayout(
                "faceVarying", places.front, places.back, places.reflectance, indices
            )
        kept = places.subset(on_surface)
        return _CageLayout(kept, written, CageFit(stencils[rows], self._areas[kept.front]))


def _cage_kinds(cage: SubdivisionCage, kinds: NDArray[np.int64]) -> NDArray[np.int64]:
    """Kinds of the refined faces: a colour that varies over a face of the cage is smooth there.

    All parts of such faces are of one kind, so that only the colours of whole faces stay apart.
    """
    if len(kinds) == 1:
        return kinds
    parents = cage.refine().cage_faces
    least = np.full(len(cage.topology.counts), kinds.max())
    np.minimum.at(least, parents, kinds)
    varies = np.zeros(len(least), bool)
    varies[parents[kinds != least[parents]]] = True
    kinds = np.where(varies[parents], -1, kinds)
    return np.unique(kinds, return_inverse=True)[1].ravel()


def _means(
    places: NDArray[np.integer], values: NDArray[np.float32], count: int
) -> NDArray[np.float32]:
    """(count, K) means of (n, K) values, each at one of so many places."""
    sums = np.stack([np.bincount(places, column, count) for column in values.T], axis=1)
    return (sums / np.maximum(np.bincount(places, minlength=count), 1)[:, None]).astype(np.float32)


def cage_corner_values(
    cage: SubdivisionCage,
    values: NDArray[np.float32],
    interpolation: str,
    indices: NDArray[np.int32] | None,
) -> NDArray[np.float32]:
    """A primvar of the cage at the refined corners, (C, K) float32."""
    surface = cage.refine()
    refined = surface.refine_primvar(values, interpolation, indices)
    return surface.topology.to_corners(refined, interpolation).astype(np.float32)


def cage_face_means(cage: SubdivisionCage, values: NDArray[np.float32]) -> NDArray[np.float32]:
    """(1, K) or (F, K) values of refined faces, as means over the parts of each cage face."""
    if len(values) == 1:
        return values
    return _means(cage.refine().cage_faces, values, len(cage.topology.counts))


def _distinct_columns(values: NDArray[np.floating]) -> tuple[list[int], list[int]]:
    """Columns that differ, and for each its place among them: grey light has one of three."""
    rows = np.ascontiguousarray(values.T)
    first: list[int] = []
    same: list[int] = []
    for column, row in enumerate(rows):
        alike = (i for i, other in enumerate(first) if np.array_equal(row, rows[other]))
        same.append(next(alike, len(first)))
        if same[-1] == len(first):
            first.append(column)
    return first, same


def _ratio(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """a / b, 0 where b is."""
    return np.divide(a, b, out=np.zeros_like(a), where=b > 0)
