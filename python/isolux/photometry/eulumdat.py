"""EULUMDAT photometric files (.ldt) [Stockmar 1990, 1998]: one item a line, candela per kilolumen.

The header gives the symmetry, the sizes in mm and the lamp sets; then come the C-angles, the gamma
angles, and the intensities of only those C-planes that the symmetry doesn't repeat.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import PhotometryError
from .diagram import type_c_diagram
from .file_text import number, require_candela, require_increasing
from .photometric_file import LuminousOpening, PhotometricFile

Array = NDArray[np.float64]

# Line numbers, from 1.
_ITYP, _ISYM, _PLANES, _GAMMAS = 2, 3, 4, 6
_OPENING_LENGTH, _OPENING_WIDTH, _OPENING_HEIGHTS = 16, 17, (18, 19, 20, 21)
_OUTPUT_RATIO, _CONVERSION, _TILT, _LAMP_SETS, _FIRST_LAMP_SET = 23, 24, 25, 26, 27
_LAMP_SET_LINES, _DIRECT_RATIOS = 6, 10
_KEYWORD_LINES = {
    1: "MANUFACTURER", 8: "REPORT", 9: "LUMINAIRE", 10: "LUMINAIRE NUMBER", 11: "FILE", 12: "DATE",
}  # fmt: skip


def is_eulumdat(lines: list[str]) -> bool:
    """Whether the first lines can be EULUMDAT: type, symmetry and the number of planes."""
    return (
        len(lines) > _FIRST_LAMP_SET
        and lines[_ITYP - 1].strip() in ("0", "1", "2", "3")
        and lines[_ISYM - 1].strip() in ("0", "1", "2", "3", "4")
        and number(lines[_PLANES - 1].strip()) is not None
    )


def parse_eulumdat(lines: list[str], subject: str) -> PhotometricFile:
    """Reads the lines of a EULUMDAT file. Raises PhotometryError, with the line where it can."""
    items = _Items(lines, subject)
    lamp_sets = items.count(_LAMP_SETS, "the number of lamp sets")
    lamps = _lamps(items, lamp_sets, subject)
    first = _FIRST_LAMP_SET + _LAMP_SET_LINES * lamp_sets + _DIRECT_RATIOS
    gamma, c_angles, candela = _intensities(items, first, _candela_per_unit(items, lamps), subject)
    output_ratio = items.value(_OUTPUT_RATIO, "the light output ratio in %", blank=0.0)
    tilt = items.value(_TILT, "the tilt during measurement", blank=0.0)
    if tilt != 0.0:
        items.warnings.append(f"The tilt of {tilt:g} deg during measurement is not undone.")
    diagram = type_c_diagram(gamma, c_angles, candela, subject, items.warnings)
    return PhotometricFile(
        path=subject,
        format="EULUMDAT",
        diagram=diagram,
        lamp_flux=None if lamps.absolute else lamps.flux,
        declared_flux=lamps.flux * output_ratio / 100.0 if output_ratio > 0.0 else None,
        opening=_opening(items),
        input_watts=lamps.watts,
        keywords={name: lines[line - 1].strip() for line, name in _KEYWORD_LINES.items()},
        warnings=tuple(items.warnings),
    )


class _Items:
    """The items of a file, by line number from 1."""

    def __init__(self, lines: list[str], subject: str) -> None:
        self._lines = lines
        self._subject = subject
        self._comma = False
        self.warnings: list[str] = []

    def require(self, line: int, what: str) -> None:
        if line > len(self._lines):
            raise PhotometryError(
                self._subject,
                f"the end of the file in line {len(self._lines)}",
                f"{what} in line {line}",
            )

    def value(self, line: int, what: str, blank: float | None = None) -> float:
        """The number of a line; `blank` where the line is empty, if that is allowed."""
        self.require(line, what)
        text = self._lines[line - 1].strip()
        if not text and blank is not None:
            return blank
        value = number(text.replace(",", ".", 1))  # one item a line: a comma can only be decimal
        if value is None:
            raise PhotometryError(self._subject, f"{text[:40]!r} in line {line}", what)
        if "," in text and not self._comma:
            self._comma = True
            self.warnings.append(f"Decimal commas are read as points, first in line {line}.")
        return value

    def count(self, line: int, what: str, least: int = 1) -> int:
        value = self.value(line, what)
        if value < least or not value.is_integer():
            raise PhotometryError(
                self._subject,
                f"{value:g} in line {line}",
                f"{what}, a whole number from {least} on",
            )
        return int(value)

    def end_at(self, line: int) -> None:
        if any(text.strip() for text in self._lines[line:]):
            self.warnings.append("Lines after the last intensity are ignored.")

    def array(self, first: int, count: int, what: str) -> Array:
        self.require(first + count - 1, what)
        return np.array([self.value(first + i, what) for i in range(count)])


def _intensities(
    items: _Items, first: int, candela_per_unit: float, subject: str
) -> tuple[Array, Array, Array]:
    """Gamma and C-angles in deg and candela by C-plane; the angles start in line `first`."""
    symmetry = items.count(_ISYM, "the symmetry, 0 to 4", least=0)
    planes = items.count(_PLANES, "the number of C-planes")
    gammas = items.count(_GAMMAS, "the number of gamma angles", least=2)
    gamma_line, candela_line = first + planes, first + planes + gammas
    items.require(candela_line, "an intensity")  # before anything of that size is allocated
    stored = _stored_planes(symmetry, planes, subject)

    c_angles = items.array(first, planes, "a C-angle")[stored]
    gamma = items.array(gamma_line, gammas, "a gamma angle")
    candela = items.array(candela_line, gammas * len(stored), "an intensity in cd/klm")
    with np.errstate(over="ignore"):
        candela *= candela_per_unit
    require_candela(candela, subject, range(candela_line, candela_line + len(candela)))
    items.end_at(candela_line + len(candela) - 1)

    candela = candela.reshape(len(stored), gammas)
    if symmetry == 0 and planes > 1:  # the format leaves the plane at 360 deg out
        c_angles = np.append(c_angles, c_angles[0] + 360.0)
        candela = np.vstack([candela, candela[:1]])
    if symmetry == 3:
        # Stored from C270 through C0 to C90; the mirror image runs from C270 through C180 to C90.
        c_angles = 180.0 - np.where(c_angles >= 180.0, c_angles - 360.0, c_angles)
        c_angles, candela = c_angles[::-1], candela[::-1]
    require_increasing(c_angles, "C-angles", subject)
    require_increasing(gamma, "gamma angles", subject, range(gamma_line, candela_line))
    return gamma, c_angles, candela


def _stored_planes(symmetry: int, planes: int, subject: str) -> NDArray[np.int_]:
    """Indices of the C-planes whose intensities are in the file, in their order."""
    match symmetry:
        case 0:
            return np.arange(planes)
        case 1:
            return np.arange(1)
        case 2:
            return np.arange(planes // 2 + 1) % planes
        case 3:
            return (3 * planes // 4 + np.arange(planes // 2 + 1)) % planes
        case 4:
            return np.arange(planes // 4 + 1) % planes
    raise PhotometryError(subject, f"symmetry {symmetry} in line {_ISYM}", "0 to 4")


@dataclass(frozen=True)
class _Lamps:
    flux: float  # lm
    watts: float
    absolute: bool


def _lamps(items: _Items, lamp_sets: int, subject: str) -> _Lamps:
    """The first lamp set; the others are alternatives to it, with the same light in cd/klm."""
    if lamp_sets > 1:
        items.warnings.append(f"The first of {lamp_sets} alternative lamp sets is taken.")
    line = _FIRST_LAMP_SET
    count = items.value(line, "the number of lamps", blank=1.0)
    flux = items.value(line + 2, "the flux of the lamps in lm")
    if flux <= 0.0:
        raise PhotometryError(subject, f"a lamp flux of {flux:g} lm in line {line + 2}", "more")
    watts = items.value(line + 5, "the watts of the lamps", blank=0.0)
    return _Lamps(flux, watts, absolute=count < 0.0)


def _candela_per_unit(items: _Items, lamps: _Lamps) -> float:
    conversion = items.value(_CONVERSION, "the conversion factor", blank=1.0)
    if conversion == 0.0:
        items.warnings.append("A conversion factor of 0 is taken as 1.")
        conversion = 1.0
    return conversion * lamps.flux / 1000.0


def _opening(items: _Items) -> LuminousOpening:
    """Luminous area in mm: length along C90, width along C0; width 0: round."""
    length, width, height = (
        0.001 * max(items.value(line, "a size in mm", blank=0.0) for line in lines)
        for lines in ((_OPENING_LENGTH,), (_OPENING_WIDTH,), _OPENING_HEIGHTS)
    )
    if length == width == height == 0.0:
        return LuminousOpening("point", 0.0, 0.0, 0.0)
    if width == 0.0:
        return LuminousOpening("round", length, length, height)
    return LuminousOpening("rectangle", width, length, height)
