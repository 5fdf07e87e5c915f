"""Textures of domes: images as luminance over latitude and longitude, as OpenEXR has them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf

from .errors import SceneError
from .radiance_hdr import RADIANCE_SIGNATURES, read_radiance_hdr
from .reading_context import read_asset
from .textures import MAX_FILE_TEXELS, MAX_SIDE, read_texture

# Bytes by which a Radiance picture is known.
SIGNATURE_LENGTH = 16


def read_texels(asset: Sdf.AssetPath) -> NDArray[np.float32]:
    """(H, W, 3) float32, linear: 8-bit images are sRGB.

    Raises SceneError where the file is missing or no image that can be read.
    """
    if (read_asset(asset, SIGNATURE_LENGTH) or b"").startswith(RADIANCE_SIGNATURES):
        texels = read_radiance_hdr(read_asset(asset) or b"", asset.path, MAX_FILE_TEXELS)
    else:
        texels = read_texture(asset, "auto").texels[..., :3]
    if not np.isfinite(texels).all() or (texels < 0).any():
        raise SceneError(asset.path, "texels that are negative or no numbers", "luminance")
    return texels


def as_latlong(texels: NDArray[np.float32], layout: str) -> NDArray[np.float32]:
    """An image as a map of latitude and longitude, at most MAX_SIDE wide: finer ones are averaged.

    layout : latlong, or angular or mirroredBall, whose middle is +Z and whose top is +Y
    """
    if layout in ("angular", "mirroredBall"):
        rows = min(len(texels), MAX_SIDE // 2)
        return _sampled(texels, _ball_points(rows, layout))
    return _averaged(texels, MAX_SIDE // 2, MAX_SIDE)


def _ball_points(rows: int, layout: str) -> NDArray[np.float64]:
    """(2, H, W) points of a ball's picture in [−1, 1], for each direction of a map."""
    latitude = np.pi * (0.5 - (np.arange(rows) + 0.5) / rows)[:, None]
    longitude = np.pi * (1 - (np.arange(2 * rows) + 0.5) / rows)
    x, z = np.cos(latitude) * np.sin(longitude), np.cos(latitude) * np.cos(longitude)
    y = np.broadcast_to(np.sin(latitude), x.shape)
    across = np.maximum(np.hypot(x, y), 1e-12)
    angle = np.arctan2(across, z)
    # A mirror turns a ray by twice the angle of its own normal.
    radius = angle / np.pi if layout == "angular" else np.sin(angle / 2)
    return np.stack([x, y]) / across * radius


def _sampled(texels: NDArray[np.float32], points: NDArray[np.float64]) -> NDArray[np.float32]:
    height, width = texels.shape[:2]
    column = np.clip((points[0] + 1) / 2 * width, 0, width - 1).astype(int)
    row = np.clip((1 - points[1]) / 2 * height, 0, height - 1).astype(int)
    return np.ascontiguousarray(texels[row, column])


def _averaged(texels: NDArray[np.float32], rows: int, columns: int) -> NDArray[np.float32]:
    """Whole texels joined until there are no more than so many rows and columns."""
    for axis, most in ((0, rows), (1, columns)):
        count = texels.shape[axis]
        if count > most:
            starts = np.arange(most) * count // most
            widths = np.diff(starts, append=count).astype(np.float32)
            shape = (-1, 1, 1) if axis == 0 else (1, -1, 1)
            texels = np.add.reduceat(texels, starts, axis=axis) / widths.reshape(shape)
    return np.ascontiguousarray(texels, np.float32)
