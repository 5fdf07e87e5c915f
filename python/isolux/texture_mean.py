"""The mean colour of a texture file, linear Rec. 709."""

from __future__ import annotations

import io
import tempfile
from pathlib import Path

import numpy as np
import OpenEXR
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError
from pxr import Sdf

from .errors import SceneError
from .reading_context import read_asset

# Bits of each sample in Pillow's wider modes; the others have 8.
WIDE_MODES = {"I;16": 65535.0, "I;16L": 65535.0, "I;16B": 65535.0, "I": 65535.0, "F": 1.0}


def mean_colour(asset: Sdf.AssetPath, source_colour_space: str) -> NDArray[np.float64]:
    """Mean over all texels of a texture.

    asset : the file, resolved by USD
    source_colour_space : "sRGB", "raw" or "auto", as UsdUVTexture has it: 8-bit images of three
        or four channels are sRGB, others linear
    returns : (4,) float64, red, green, blue, alpha
    Raises SceneError where the file is missing or no image that can be read.
    """
    contents = read_asset(asset)
    if contents is None:
        raise SceneError(asset.path, "no such texture", "a file that the stage can reach")
    if contents[:4] == b"\x76\x2f\x31\x01":
        return _mean_of_exr(contents, asset.path)
    try:
        image = Image.open(io.BytesIO(contents))
        # Pillow narrows 16-bit colour to 8 bits when it loads; "auto" takes it as linear.
        was_wide = any("16" in str(tile[-1]) for tile in image.tile)
        image.load()
    except (UnidentifiedImageError, OSError, ValueError, Image.DecompressionBombError) as error:
        raise SceneError(asset.path, str(error), "an image") from error
    if image.mode in WIDE_MODES:
        grey = np.asarray(image, dtype=np.float64).mean() / WIDE_MODES[image.mode]
        return np.array([grey, grey, grey, 1.0])
    is_srgb = source_colour_space == "sRGB" or (
        source_colour_space == "auto" and image.mode not in ("1", "L", "LA") and not was_wide
    )
    # The mean of a curve over 8-bit texels needs their histogram only.
    counts = np.array(image.convert("RGBA").histogram(), dtype=np.float64).reshape(4, 256)
    levels = np.arange(256) / 255.0
    linear = _srgb_to_linear(levels) if is_srgb else levels
    texels = counts[0].sum()
    return np.append(counts[:3] @ linear, counts[3] @ levels) / texels


def _srgb_to_linear(encoded: NDArray[np.float64]) -> NDArray[np.float64]:
    """IEC 61966-2-1."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def _mean_of_exr(contents: bytes, name: str) -> NDArray[np.float64]:
    # The OpenEXR package reads files only, and the texture may lie inside a usdz.
    with tempfile.NamedTemporaryFile(suffix=".exr") as copy:
        Path(copy.name).write_bytes(contents)
        try:
            with OpenEXR.File(copy.name, separate_channels=True) as image:
                means = {
                    channel: float(np.mean(values.pixels, dtype=np.float64))
                    for channel, values in image.channels().items()
                }
        except RuntimeError as error:
            raise SceneError(name, str(error), "an OpenEXR image") from error
    grey = means.get("Y", 0.0)
    return np.array([*(means.get(channel, grey) for channel in "RGB"), means.get("A", 1.0)])
