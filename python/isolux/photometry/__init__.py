"""Photometric files and inline goniometric diagrams, read into one kind of diagram."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ..errors import PhotometryError
from .diagram import inline_diagram, luminous_flux, scale
from .eulumdat import is_eulumdat, parse_eulumdat
from .file_text import decode_lines
from .ies import is_ies, parse_ies
from .photometric_file import LuminousOpening, PhotometricFile

__all__ = [
    "LARGEST_FILE",
    "LuminousOpening",
    "PhotometricFile",
    "inline_diagram",
    "luminous_flux",
    "read_photometric_bytes",
    "read_photometric_file",
    "scale",
]

LARGEST_FILE = 16 * 1024 * 1024  # bytes; the largest real ones have some hundred thousand
_FLUX_DOUBT = 0.05  # relative difference of declared and integrated flux worth a warning


def read_photometric_file(path: str | Path) -> PhotometricFile:
    """Reads an IES LM-63 or EULUMDAT file; the content tells which. Raises PhotometryError."""
    try:
        with Path(path).open("rb") as file:
            content = file.read(LARGEST_FILE + 1)
    except OSError as error:
        raise PhotometryError(
            str(path), (error.strerror or str(error)).lower(), "a photometric file"
        ) from error
    return read_photometric_bytes(content, str(path))


def read_photometric_bytes(content: bytes, name: str) -> PhotometricFile:
    """Reads the content of a photometric file, as an asset resolver hands it out.

    content : the file's bytes
    name : file or asset, for messages; its extension decides where the content doesn't
    Raises PhotometryError.
    """
    if len(content) > LARGEST_FILE:
        raise PhotometryError(
            name, f"more than {LARGEST_FILE} bytes", "a photometric file of at most that size"
        )
    lines = decode_lines(content)
    extension = Path(name.rstrip("])")).suffix.lower()
    if is_ies(lines) or extension == ".ies":
        file = parse_ies(lines, name)
    elif is_eulumdat(lines) or extension == ".ldt":
        file = parse_eulumdat(lines, name)
    else:
        raise PhotometryError(name, "neither", "an IES LM-63 or EULUMDAT file")
    return replace(file, warnings=file.warnings + _flux_doubts(file))


def _flux_doubts(file: PhotometricFile) -> tuple[str, ...]:
    flux = luminous_flux(file.diagram)
    if file.declared_flux and abs(flux / file.declared_flux - 1.0) > _FLUX_DOUBT:
        return (f"The candela give {flux:.4g} lm, the file declares {file.declared_flux:.4g} lm.",)
    if file.lamp_flux and flux > (1.0 + _FLUX_DOUBT) * file.lamp_flux:
        return (f"The candela give {flux:.4g} lm, more than the lamps' {file.lamp_flux:.4g} lm.",)
    return ()
