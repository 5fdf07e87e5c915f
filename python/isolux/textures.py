"""Texture files as arrays of linear Rec. 709, each read once."""

from __future__ import annotations

import io
import math
import tempfile
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf

from .colour_space import is_by_channel, to_linear_rec709
from .errors import SceneError
from .reading_context import read_asset

# The packages that read pictures are loaded with the first one: most stages have none.
if TYPE_CHECKING:
    from PIL import Image

# A picture of more texels than this is refused: it would fill the memory of a workstation.
MAX_FILE_TEXELS = 1 << 27
# Texels kept across and down, far more than a mesh has elements; beyond, means of neighbours.
MAX_SIDE = 2048
# Rows worked on at a time.
STRIP = 32

# Levels of each sample in Pillow's wider modes; the others have 255.
_WIDE_MODES = {"I;16": 65535.0, "I;16L": 65535.0, "I;16B": 65535.0, "I": 65535.0, "F": 1.0}
_OTHER_BYTE = {"RGB;16B": "RGB;16L", "RGBA;16B": "RGBA;16L"}
_WRAP_MODES = ("black", "clamp", "repeat", "mirror")


@dataclass(frozen=True, slots=True)
class Texture:
    """texels: (H, W, 4) float32, linear Rec. 709 and alpha, the first row on top;
    wrap: across and down, as the file's own metadata has it, "" where it has none;
    is_clipped: some colours lie outside of Rec. 709 and were clipped to it.
    """

    texels: NDArray[np.float32]
    wrap: tuple[str, str] = ("", "")
    is_clipped: bool = False


def read_texture(asset: Sdf.AssetPath, colour_space: str) -> Texture:
    """A picture in linear Rec. 709.

    asset : the file, resolved by USD
    colour_space : "auto": 8-bit pictures of three or four channels are sRGB, others linear, as
        UsdUVTexture has it; else a name that `colour_space` knows, such as "sRGB" or "raw"
    Raises SceneError where the file is missing, too large or no picture that can be read, and
    UnknownColourSpaceError.
    """
    from PIL import Image, UnidentifiedImageError

    contents = read_asset(asset)
    if contents is None:
        raise SceneError(asset.path, "no such texture", "a file that the stage can reach")
    if contents[:4] == b"\x76\x2f\x31\x01":
        texels, wrap = _read_exr(contents, asset.path)
        texels, is_clipped = _to_working_space(texels, 1.0, colour_space)
        return Texture(texels, wrap, is_clipped)
    try:
        with warnings.catch_warnings():  # of sizes, where the limit is our own, and of odd tags
            warnings.simplefilter("ignore")
            picture = Image.open(io.BytesIO(contents))
            _require_size(picture.size, asset.path)
            texels, levels, is_wide = _samples(picture, contents)
    except (
        UnidentifiedImageError,
        OSError,
        ValueError,
        SyntaxError,  # Pillow's, of a broken PNG
        Image.DecompressionBombError,
    ) as error:
        raise SceneError(asset.path, str(error), "an image") from error
    if colour_space == "auto":
        colour_space = "sRGB" if texels.shape[2] >= 3 and not is_wide else "raw"
    texels, is_clipped = _to_working_space(texels, levels, colour_space)
    return Texture(texels, is_clipped=is_clipped)


def _require_size(size: tuple[int, int], name: str) -> None:
    if size[0] * size[1] > MAX_FILE_TEXELS:
        found = f"{size[0]} x {size[1]} texels"
        raise SceneError(name, found, f"at most {MAX_FILE_TEXELS} texels")


def _samples(picture: Image.Image, contents: bytes) -> tuple[NDArray, float, bool]:
    """(H, W, 1 to 4) samples as the file has them, the level that means 1, more than 8 bits."""
    from PIL import Image

    modes = [str(tile[-1]) for tile in getattr(picture, "tile", [])]
    is_wide = picture.mode in _WIDE_MODES or any("16" in mode for mode in modes)
    if picture.mode in _WIDE_MODES:
        return np.asarray(picture)[..., None], _WIDE_MODES[picture.mode], True
    if picture.format == "PNG" and len(modes) == 1 and modes[0] in _OTHER_BYTE:
        # Pillow keeps the first byte of each sample; told the other byte order, the second.
        low = Image.open(io.BytesIO(contents))
        low.tile = [low.tile[0]._replace(args=_OTHER_BYTE[modes[0]])]
        high = np.asarray(picture).astype(np.uint16)
        return high * np.uint16(256) + np.asarray(low), 65535.0, True
    if picture.mode in ("1", "L"):
        return np.asarray(picture.convert("L"))[..., None], 255.0, is_wide
    if picture.mode == "LA":
        return np.asarray(picture), 255.0, is_wide
    has_alpha = picture.mode in ("RGBA", "PA", "RGBa", "La") or "transparency" in picture.info
    return np.asarray(picture.convert("RGBA" if has_alpha else "RGB")), 255.0, is_wide


def _to_working_space(
    samples: NDArray[Any], levels: float, space: str
) -> tuple[NDArray[np.float32], bool]:
    """(H, W, 4) float32 texels, no more than MAX_SIDE across and down; whether some are clipped.

    levels : the level that means 1
    """
    height, width, _ = samples.shape
    size = min(height, MAX_SIDE), min(width, MAX_SIDE)
    texels = np.empty((*size, 4), np.float32)
    is_clipped = False
    for row in range(0, size[0], STRIP):  # in strips, for the sake of memory
        end = min(row + STRIP, size[0])
        top, bottom = row * height / size[0], end * height / size[0]
        first = math.floor(top)
        strip, clipped = _linear(samples[first : math.ceil(bottom)], levels, space)
        is_clipped |= clipped
        if size != (height, width):
            strip = _means_between(strip, np.linspace(top - first, bottom - first, end - row + 1))
            strip = _means_between(strip.swapaxes(0, 1), np.linspace(0, width, size[1] + 1))
            strip = strip.swapaxes(0, 1)
        texels[row:end] = strip
    return texels, is_clipped


def _means_between(rows: NDArray[np.floating], edges: NDArray[np.float64]) -> NDArray[np.floating]:
    """(n, ...) means of rows between n + 1 even edges, which may lie within a row."""
    count = len(edges) - 1
    if len(rows) % count == 0 and edges[0] == 0 and edges[-1] == len(rows):
        return rows.reshape(count, -1, *rows.shape[1:]).mean(axis=1)
    sums = np.zeros((len(rows) + 1, *rows.shape[1:]))
    np.cumsum(rows, axis=0, out=sums[1:])
    whole = np.minimum(edges.astype(np.int64), len(rows) - 1)
    shape = (-1,) + (1,) * (rows.ndim - 1)
    below = sums[whole] + (edges - whole).reshape(shape) * rows[whole]
    return np.diff(below, axis=0) / np.diff(edges).reshape(shape)


def _linear(samples: NDArray[Any], levels: float, space: str) -> tuple[NDArray[np.float32], bool]:
    """(H, W, 4) linear Rec. 709 and alpha of (H, W, 1 to 4) samples; whether some are clipped."""
    channels = samples.shape[2]
    texels = np.ones((*samples.shape[:2], 4), np.float32)
    colours = samples[..., :3] if channels >= 3 else samples[..., :1]
    is_clipped = False
    if is_by_channel(space) and samples.dtype.kind == "u":  # by a table: there are few levels
        ramp = np.arange(levels + 1)[:, None] / levels
        table, _ = to_linear_rec709(ramp, space)
        texels[..., :3] = table.astype(np.float32)[colours, 0]
    else:
        texels[..., :3] = colours / np.float32(levels)
        texels[..., :3], is_clipped = to_linear_rec709(texels[..., :3], space)
    if channels in (2, 4):
        texels[..., 3] = samples[..., -1] / np.float32(levels)
    return texels, is_clipped


def _read_exr(contents: bytes, name: str) -> tuple[NDArray[np.float32], tuple[str, str]]:
    import OpenEXR

    # The package reads files only, and the texture may lie inside a usdz.
    with tempfile.NamedTemporaryFile(suffix=".exr") as copy:
        Path(copy.name).write_bytes(contents)
        try:
            with OpenEXR.File(copy.name, header_only=True) as image:
                low, high = image.header()["dataWindow"]
                size = (int(high[0]) - int(low[0]) + 1, int(high[1]) - int(low[1]) + 1)
                modes = str(image.header().get("wrapmodes", "")).replace("periodic", "repeat")
            _require_size(size, name)
            with OpenEXR.File(copy.name, separate_channels=True) as image:
                channels = {c: v.pixels.astype(np.float32) for c, v in image.channels().items()}
        except (RuntimeError, ValueError, KeyError, TypeError) as error:
            raise SceneError(name, str(error), "an OpenEXR image") from error
    shape = max((values.shape for values in channels.values()), default=(0, 0))
    if 0 in shape:
        raise SceneError(name, "no channels", "an OpenEXR image")
    grey = channels.get("Y", np.zeros(shape, np.float32))
    bands = [channels.get(channel, grey) for channel in "RGB"]
    bands.append(channels.get("A", np.ones(shape, np.float32)))
    if any(band.shape != shape for band in bands):
        raise SceneError(name, "channels of several sizes", "an OpenEXR image of one size")
    texels = np.stack(bands, axis=-1)
    if not np.isfinite(texels).all():
        raise SceneError(name, "texels that are NaN or infinite", "finite ones")
    across, down = (
        mode if mode in _WRAP_MODES else "" for mode in (modes + "," + modes).split(",")[:2]
    )
    return texels, (across, down)
