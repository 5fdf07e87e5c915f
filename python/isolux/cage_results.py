"""Results of a subdivision surface, on its control cage.

The values of the cage are those whose limit comes nearest to the solver's, by `CageFit`, each
weighted by the area that its illumination vertex stands for: whoever subdivides the primvar gets
the solver's values again.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .cage_fit import CageFit, ratio
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

# Areas of a copy that are in proportion to the first one's but for this take its weights: the fit
# moves by no more than this share of what it is off, as of a turn stored in half precision.
SAME_WEIGHTS = 0.01
# Of copies that are fitted together: columns, and values in all, 8 bytes each.
MOST_COLUMNS = 256
MOST_VALUES = 1 << 24
# Relative RMS difference from which on it is told.
TOLD_FIT_ERROR = 0.01
# The only field that faces of several colours part.
(_COLOUR,) = (field for field in OUTPUT_FIELDS if field.split == "reflectance")


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


class CageFits:
    """Fits of the cages of one scene: copies of a mesh have all but the places in common.

    areas : (V,) float64, m^2, of all vertices of the solution
    """

    def __init__(self, areas: NDArray[np.float64]) -> None:
        self.areas = areas
        self._known: dict[tuple[int, ...], tuple[MeshLayout, dict[str, _CageLayout]]] = {}

    def layouts(self, mesh: MeshDescription, layout: MeshLayout) -> dict[str, _CageLayout]:
        """By what parts the values of a field."""
        # All of them are kept by the scene, so that no other object takes their numbers.
        key = (id(mesh.cage), id(mesh.reflectance), id(mesh.emission))
        first, known = self._known.get(key, (None, None))
        if first and known and _same_corners(first, layout):
            moved: dict[int, _CageLayout] = {}
            for each in known.values():
                if id(each) not in moved:
                    moved[id(each)] = self._moved(each, first, layout)
            return {split: moved[id(each)] for split, each in known.items()}
        assert mesh.cage is not None
        corners = MeshCorners.of_authored(mesh, layout)
        look = surface_look(mesh)
        kinds = _cage_kinds(mesh.cage, face_kinds(look))
        crease = _layout(mesh.cage, corners, look, np.zeros(1, np.int64), self.areas)
        coloured = crease
        if len(kinds) > 1:
            coloured = _layout(mesh.cage, corners, look, kinds, self.areas)
        found = {"crease": crease, "reflectance": coloured}
        self._known.setdefault(key, (layout, found))
        return found

    def _moved(self, known: _CageLayout, first: MeshLayout, layout: MeshLayout) -> _CageLayout:
        """The layout of one copy for another."""
        places, written = (_shifted(each, first, layout) for each in (known.places, known.written))
        before, after = (self.areas[each.front] for each in (known.places, places))
        fit = known.fit
        if np.ptp(ratio(after, before)) > SAME_WEIGHTS * after.sum() / (before.sum() or 1.0):
            fit = CageFit(fit.stencils, after)
        return _CageLayout(places, written, fit)


class CageOutput:
    """The primvars of one subdivision surface on its cage, stage after stage.

    fit_error : relative RMS difference of the photometric illuminance between the limit values of
        the last stage's primvar and the solver's values, area-weighted
    fitted : the cage's values by what parts them; those of a stage before are the first guess

    mesh : with a cage
    fits : of the solution's cages
    """

    def __init__(self, mesh: MeshDescription, layout: MeshLayout, fits: CageFits) -> None:
        self.path = mesh.path
        self.fit_error = self._noise = 0.0
        self._areas = fits.areas
        self._layouts = fits.layouts(mesh, layout)
        self.fitted: dict[str, NDArray[np.float64]] = {}

    def primvars(
        self, illuminance: VertexIlluminance
    ) -> Iterator[tuple[OutputField, PrimvarLayout, NDArray[np.float32] | None]]:
        """Field, layout and values of each primvar; no values where this mesh hasn't the field.

        After `fit_cages` on the same stage.
        """
        crease, coloured = self._layouts["crease"], self._layouts["reflectance"]
        values = crease.places.gather(illuminance)
        fitted = self._illuminance(values)
        self._tell_fit(crease, values, fitted)
        for field in OUTPUT_FIELDS:
            if field is _COLOUR:
                yield field, coloured.written, self.fitted[field.split].astype(np.float32)
            else:
                yield field, crease.written, field.values(fitted)

    def wanted(self, split: str, illuminance: VertexIlluminance) -> NDArray[np.float32]:
        """(n, K) values to fit of the fields that are parted so."""
        places = self._layouts[split].places
        values = places.gather(illuminance)
        if split == "crease":
            parts = [values.direct, values.indirect, values.relative_deviation[:, None]]
            return np.hstack(parts if values.back is None else [*parts, values.back])
        colours = _COLOUR.values(values)
        assert colours is not None
        return colours

    def fit(self, split: str) -> CageFit:
        return self._layouts[split].fit

    def _illuminance(self, values: PrimvarValues) -> PrimvarValues:
        """The cage's illuminances; the total is the sum of its parts there too."""
        fitted = self.fitted["crease"].astype(np.float32)
        direct, indirect, deviation, *back = np.split(fitted, [3, 6, 7], axis=1)
        return replace(
            values,
            direct=direct,
            indirect=indirect,
            relative_deviation=deviation[:, 0],
            back=back[0] if values.back is not None else None,
        )

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


def fit_cages(outputs: Iterable[CageOutput], illuminance: VertexIlluminance) -> None:
    """Fit one stage on all cages, copies of a mesh together."""
    for split, most in (("crease", np.inf), ("reflectance", 1.0)):
        alike: dict[int, list[CageOutput]] = {}
        for output in outputs:
            alike.setdefault(id(output.fit(split)), []).append(output)
        for copies in alike.values():
            rows, columns = copies[0].wanted(split, illuminance).shape
            allowed = min(MOST_COLUMNS, MOST_VALUES // max(rows, 1))
            step = max(1, allowed // columns)
            for begin in range(0, len(copies), step):
                some = copies[begin : begin + step]
                values = np.hstack([copy.wanted(split, illuminance) for copy in some])
                start = None
                if split in some[0].fitted:
                    start = np.hstack([copy.fitted[split] for copy in some])
                fitted = some[0].fit(split).solve(values, start, most)
                for copy, part in zip(some, np.hsplit(fitted, len(some)), strict=True):
                    copy.fitted[split] = part


def _layout(
    cage: SubdivisionCage,
    corners: MeshCorners,
    reflectance: NDArray[np.float32],
    kinds: NDArray[np.int64],
    areas: NDArray[np.float64],
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
    return _CageLayout(kept, written, CageFit(stencils[rows], areas[kept.front]))


def _same_corners(one: MeshLayout, other: MeshLayout) -> bool:
    two_sided = [layout.back.stop > layout.back.start for layout in (one, other)]
    same = np.array_equal(one.corner_vertices, other.corner_vertices)
    return same and two_sided[0] == two_sided[1]


def _shifted(layout: PrimvarLayout, first: MeshLayout, copy: MeshLayout) -> PrimvarLayout:
    """The same values, from the vertices of a copy."""
    front = np.where(layout.front < 0, -1, layout.front + (copy.front.start - first.front.start))
    back = layout.back
    if back is not None:
        back = np.where(back < 0, -1, back + (copy.back.start - first.back.start))
    return replace(layout, front=front, back=back)


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
