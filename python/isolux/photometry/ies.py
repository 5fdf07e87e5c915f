"""IES LM-63 photometric files, 1986 to 2019.

A header of labels or keywords, `TILT=`, then free-format numbers: the lamps, the angles and the
candela, plane by plane. The versions differ in the header, in the opening's encoding and in the
twelfth number after TILT, which multiplied the candela until 2002 and is a code in 2019.
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from ..errors import PhotometryError
from .diagram import type_ab_diagram, type_c_diagram
from .file_text import number, require_candela, require_increasing
from .photometric_file import LuminousOpening, OpeningShape, PhotometricFile

Array = NDArray[np.float64]

_METRES = {1: 0.3048, 2: 1.0}
_TYPES = {1: "C", 2: "B", 3: "A"}
_VERSION = re.compile(r"\s*IES(?:NA)?\s*:?\s*(?:LM-63-)?((?:19|20)?\d\d)\b", re.IGNORECASE)
_KEYWORD = re.compile(r"\s*\[([^\]]+)\]\s*(.*?)\s*$")
_TILT = re.compile(r"\s*TILT\s*=\s*(.*?)\s*$", re.IGNORECASE)
# Between blanks: digits, one comma, digits. Legal only where the comma parts two numbers.
_DECIMAL_COMMA = re.compile(r"(?:^|\s)([+-]?\d+,\d+)(?=\s|$)")


def is_ies(lines: list[str]) -> bool:
    """Whether these lines can only be LM-63: they have its TILT= line."""
    return any(_TILT.match(line) for line in lines)


def parse_ies(lines: list[str], subject: str) -> PhotometricFile:
    """Reads the lines of an LM-63 file. Raises PhotometryError, with the line where it can."""
    tilt_line = next((i for i, line in enumerate(lines) if _TILT.match(line)), None)
    if tilt_line is None:
        raise PhotometryError(subject, "no TILT= line", "an IES LM-63 file")
    year = _year(lines[:tilt_line])
    numbers = _Numbers(subject, lines, tilt_line + 1)
    try:
        return _parse_numbers(numbers, year, lines[: tilt_line + 1], subject)
    except PhotometryError as error:
        raise numbers.decimal_comma() or error from None


class _Numbers:
    """The numbers after TILT=, in order, each with its line (counted from 1)."""

    def __init__(self, subject: str, lines: list[str], first: int) -> None:
        self._subject = subject
        self._lines = lines
        self._first = first
        self._words = [
            (word, i + 1)
            for i, line in enumerate(lines[first:], first)
            for word in re.split(r"[\s,]+", line)
            if word
        ]
        self._next = 0

    @property
    def left(self) -> int:
        return len(self._words) - self._next

    def take(self, what: str) -> float:
        return float(self.take_all(1, what)[0][0])

    def take_count(self, what: str) -> int:
        value = self.take(what)
        if value < 1.0 or not value.is_integer():
            raise PhotometryError(self._subject, f"{value:g}{self._place()}", f"{what}, 1 or more")
        return int(value)

    def take_one_of(self, allowed: dict[int, str], what: str) -> int:
        value = self.take(what)
        if value not in allowed:
            names = ", ".join(f"{code} ({name})" for code, name in allowed.items())
            raise PhotometryError(
                self._subject, f"{what} {value:g}{self._place()}", f"one of {names}"
            )
        return int(value)

    def take_all(self, count: int, what: str) -> tuple[Array, list[int]]:
        """The next `count` numbers, in an array, and their lines."""
        if count > self.left:  # before anything of that size is allocated
            end = len(self._lines)
            raise PhotometryError(
                self._subject,
                f"only {self.left} of {count} numbers before the end of the file in line {end}",
                what,
            )
        words = self._words[self._next : self._next + count]
        values = np.empty(count)
        for i, (word, line) in enumerate(words):
            value = number(word)
            if value is None:
                raise PhotometryError(self._subject, f"{word[:40]!r} in line {line}", what)
            values[i] = value
        self._next += count
        return values, [line for _, line in words]

    def rest(self) -> str | None:
        """A sentence about what follows the last number, if anything does."""
        if not self.left:
            return None
        word, line = self._words[self._next]
        if number(word) is None:
            return f"Text after the candela is ignored from line {line} on."
        if comma := self.decimal_comma():
            raise comma
        return f"{self.left} numbers more than announced are ignored from line {line} on."

    def decimal_comma(self) -> PhotometryError | None:
        """Why the counts can't be right, if some line looks written with decimal commas."""
        for i, line in enumerate(self._lines[self._first :], self._first + 1):
            if match := _DECIMAL_COMMA.search(line):
                return PhotometryError(
                    self._subject,
                    f"{match[1]!r} in line {i}, which reads as two numbers",
                    "decimal points instead of decimal commas",
                )
        return None

    def _place(self) -> str:
        return f" in line {self._words[self._next - 1][1]}"


def _parse_numbers(
    numbers: _Numbers, year: int, header: list[str], subject: str
) -> PhotometricFile:
    warnings: list[str] = []
    keywords = _keywords(header)
    _pass_tilt(numbers, header[-1], warnings)

    lamps = numbers.take("the number of lamps")
    lumens = numbers.take("the lumens per lamp")
    multiplier = numbers.take("the candela multiplier")
    vertical_count = numbers.take_count("the number of vertical angles")
    horizontal_count = numbers.take_count("the number of horizontal angles")
    photometric_type = _TYPES[numbers.take_one_of(_TYPES, "photometric type")]
    units = numbers.take_one_of({1: "feet", 2: "metres"}, "units type")
    width, length, height = (
        numbers.take(f"the {side} of the luminous opening") * _METRES[units]
        for side in ("width", "length", "height")
    )
    multiplier *= numbers.take("the ballast factor")
    twelfth = numbers.take("the ballast-lamp factor")
    if year < 2019:
        multiplier *= twelfth
    watts = numbers.take("the input watts")

    what = "vertical angles"
    vertical, lines = numbers.take_all(vertical_count, what)
    if vertical_count < 2:
        raise PhotometryError(subject, f"one vertical angle in line {lines[0]}", "two or more")
    require_increasing(vertical, what, subject, lines)
    what = "horizontal angles"
    horizontal, lines = numbers.take_all(horizontal_count, what)
    require_increasing(horizontal, what, subject, lines)
    what = f"candela for {horizontal_count} x {vertical_count} angles"
    candela, lines = numbers.take_all(vertical_count * horizontal_count, what)
    with np.errstate(over="ignore"):
        candela *= multiplier
    require_candela(candela, subject, lines)
    candela = candela.reshape(horizontal_count, vertical_count)
    if rest := numbers.rest():
        warnings.append(rest)

    if photometric_type == "C":
        diagram = type_c_diagram(vertical, horizontal, candela, subject, warnings)
    else:
        diagram = type_ab_diagram(
            "A" if photometric_type == "A" else "B",
            vertical,
            horizontal,
            candela,
            subject,
            warnings,
        )
    unit = keywords.get("_INTENSITYUNITS", "cd")
    if unit.lower() not in ("cd", "candela"):
        warnings.append(f"Intensities are said to be in {unit}: taken as cd.")
    return PhotometricFile(
        path=subject,
        format=f"IES LM-63-{year}",
        diagram=diagram,
        lamp_flux=lamps * lumens if lamps > 0.0 and lumens > 0.0 else None,
        declared_flux=None,
        opening=_opening(width, length, height, year),
        input_watts=watts,
        keywords=keywords,
        warnings=tuple(warnings),
    )


def _year(header: list[str]) -> int:
    first = next((line for line in header if line.strip()), "")
    match = _VERSION.match(first)
    if match is None:
        return 1986  # this version has no line of its own
    year = int(match[1])
    return year if year > 99 else year + 1900


def _keywords(header: list[str]) -> dict[str, str]:
    """Values by keyword; a keyword that comes again, and [MORE], add a line."""
    keywords: dict[str, str] = {}
    last = ""
    for line in header:
        if match := _KEYWORD.match(line):
            key, value = match[1].strip().upper(), match[2]
            last = last if key == "MORE" and last else key
            keywords[last] = f"{keywords[last]}\n{value}" if last in keywords else value
    return keywords


def _pass_tilt(numbers: _Numbers, tilt_line: str, warnings: list[str]) -> None:
    """Lamp output against the luminaire's tilt, which is unknown here: read over."""
    match = _TILT.match(tilt_line)
    tilt = match[1] if match else ""
    if tilt.upper() == "INCLUDE":
        numbers.take("the lamp-to-luminaire geometry")
        count = numbers.take_count("the number of tilt angles")
        numbers.take_all(count, "tilt angles")
        numbers.take_all(count, "tilt factors")
        warnings.append("TILT factors are ignored: the lamp's tilt is not known.")
    elif tilt.upper() != "NONE":
        warnings.append(f"TILT file {tilt!r} is not read: the lamp's tilt is not known.")


def _opening(width: float, length: float, height: float, year: int) -> LuminousOpening:
    """The luminous opening; length lies along C0, width along C90, negative sizes mean round.

    Up to 1995 a zero beside a negative size repeats it: disk (-D, 0, 0), sphere (-D, 0, -D),
    lying cylinder (0, L, -D). From 2002 each size stands for itself: (-D, -D, 0), (-D, -D, -D).
    """
    shape: OpeningShape = "rectangle"
    if min(width, length, height) < 0.0:
        shape = "round"
        if length == 0.0 and (height >= 0.0 or year < 2002):
            length = width if width < 0.0 else height
        if width == 0.0 and year < 2002:
            width = height
    elif width == length == height == 0.0:
        shape = "point"
    return LuminousOpening(shape, abs(length), abs(width), abs(height))
