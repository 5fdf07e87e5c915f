"""Lines and numbers of photometric files, which come in many encodings and line endings."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..errors import DarkDiagramError, PhotometryError

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.IGNORECASE)

_SMALLEST_STEP = 2e-5  # deg, between neighbouring angles
_LARGEST_NUMBER = 1e100  # products of three stay finite
_LARGEST_CANDELA = 1e30  # sums stay finite; its inverse counts as no light


def decode_lines(content: bytes) -> list[str]:
    """Lines of a text in UTF-8 (with or without a byte order mark) or else Latin-1.

    Lines end in CR, LF or both; nothing else ends a line, and a CP/M end-of-file mark ends all.
    """
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("latin-1")
    return re.split(r"\r\n|\r|\n", text.split("\x1a", 1)[0])


def number(text: str) -> float | None:
    """A decimal number that can be meant, whatever the locale; None where the text is none."""
    if not _NUMBER.fullmatch(text):
        return None
    value = float(text)
    return value if abs(value) <= _LARGEST_NUMBER else None


def require_increasing(
    angles: NDArray[np.float64], what: str, subject: str, lines: Sequence[int] | None = None
) -> None:
    """Raises PhotometryError at the first angle, in degrees, that is not above the one before."""
    falls = np.flatnonzero(np.diff(angles) < _SMALLEST_STEP)
    if len(falls):
        i = int(falls[0])
        raise PhotometryError(
            subject,
            f"{angles[i + 1]:g} after {angles[i]:g}{_in_line(lines, i + 1)}",
            f"{what} that increase",
        )


def require_candela(
    candela: NDArray[np.float64], subject: str, lines: Sequence[int] | None = None
) -> None:
    """Raises PhotometryError at the first intensity that can't be, or where all are zero."""
    wrong = np.flatnonzero(~((candela >= 0.0) & (candela <= _LARGEST_CANDELA)))
    if len(wrong):
        i = int(wrong[0])
        raise PhotometryError(
            subject, f"{candela[i]:g} cd{_in_line(lines, i)}", "finite candela of at least 0"
        )
    if candela.max() < 1.0 / _LARGEST_CANDELA:
        raise DarkDiagramError(subject, "candela that are all zero", "a luminaire that gives light")


def _in_line(lines: Sequence[int] | None, index: int) -> str:
    return "" if lines is None else f" in line {lines[index]}"
