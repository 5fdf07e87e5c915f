"""Pictures as files: PNG for the eye, OpenEXR for numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR
from PIL import Image, PngImagePlugin

from .atomic_file import replace_atomically
from .colour import display_colours, log_average_exposure
from .errors import SceneError, SettingsError
from .render import Picture

# Rec. 709 primaries and D65: red, green, blue, white as x, y.
_REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)


def check_picture(path: Path, exposure: float | None) -> None:
    """Raise SettingsError where `write_picture` would: before the work, not after."""
    if path.suffix.lower() not in (".png", ".exr"):
        raise SettingsError(str(path), f"the suffix '{path.suffix}'", ".png or .exr")
    if path.suffix.lower() == ".exr" and exposure is not None:
        raise SettingsError(str(path), f"an exposure of {exposure:g} EV", "none: EXR keeps cd/m²")


def write_picture(picture: Picture, path: Path, exposure: float | None = None) -> float | None:
    """Write a picture in the format that its suffix says.

    exposure : EV at ISO 100 for a PNG; None: from the log-average luminance
    returns : the EV used; None for an EXR, which keeps cd/m²
    raises : SettingsError for another suffix, or an exposure for an EXR;
        SceneError where the file can't be written
    """
    check_picture(path, exposure)
    if path.suffix.lower() == ".png":
        return write_png(picture, path, exposure)
    write_exr(picture, path)
    return None


def write_png(picture: Picture, path: Path, exposure: float | None = None) -> float:
    """Write 8-bit display colours; returns the EV used. See `write_picture`."""
    if exposure is None:
        exposure = log_average_exposure(picture.rgb, picture.coverage)
    notes = PngImagePlugin.PngInfo()
    for key, value in _provenance(picture).items():
        notes.add_text(key, str(value))
    notes.add_text("isolux:exposureValue", f"{exposure:.3f}")
    image = Image.fromarray(display_colours(picture.rgb, exposure))
    with replace_atomically(path) as temporary:
        image.save(temporary, "PNG", pnginfo=notes)
    return exposure


def write_exr(picture: Picture, path: Path) -> None:
    """Write 32-bit floats, RGB in cd/m² (linear Rec. 709) weighted by coverage, A the coverage."""
    header = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "chromaticities": _REC709,
        # The luminance of (1, 1, 1), cd/m^2: the values are absolute.
        "whiteLuminance": 1.0,
        **_provenance(picture),
    }
    rgba = np.dstack([picture.rgb, picture.coverage]).astype(np.float32)
    with replace_atomically(path) as temporary:
        try:
            OpenEXR.File(header, {"RGBA": rgba}).write(str(temporary))
        except RuntimeError as error:
            raise SceneError(str(path), str(error), "a file to write") from error


def _provenance(picture: Picture) -> dict[str, str | float]:
    shown: dict[str, str | float] = {
        "isolux:camera": picture.camera or "framed on the interior",
        "isolux:unit": "cd/m^2",
    }
    if picture.time is not None:
        shown["isolux:time"] = float(picture.time)
    return shown
