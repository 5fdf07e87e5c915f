"""Radiance's pictures, .hdr: a shared exponent for the three channels of a texel [Ward 1991]."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from .errors import SceneError

RADIANCE_SIGNATURES = (b"#?RADIANCE", b"#?RGBE")
# Rows of such widths may be packed.
PACKED_WIDTHS = range(8, 32768)


def read_radiance_hdr(contents: bytes, name: str, most_texels: int) -> NDArray[np.float32]:
    """(H, W, 3) float32, linear, from the top row on. Raises SceneError where it can't be read."""
    end = contents.find(b"\n\n")
    size = re.match(rb"([-+])Y (\d{1,9}) ([-+])X (\d{1,9})\n", contents[end + 2 :][:64])
    if end < 0 or size is None or b"32-bit_rle_xyze" in contents[:end]:
        raise SceneError(name, "a header that is not read", "32-bit_rle_rgbe in rows")
    height, width = int(size[2]), int(size[4])
    if not 0 < height * width <= most_texels:
        raise SceneError(name, f"{width} × {height} texels", f"1 to {most_texels:,}")
    packed = memoryview(contents)[end + 2 + size.end() :]
    rows = []
    for _ in range(height):
        row, packed = _read_row(packed, width, name)
        rows.append(row)
    rgbe = np.stack(rows)
    mantissa, exponent = rgbe[..., :3].astype(np.float32), rgbe[..., 3:].astype(np.int32)
    texels = np.where(exponent > 0, np.ldexp(mantissa + 0.5, exponent - 136), 0.0)
    texels = texels[:: 1 if size[1] == b"-" else -1, :: 1 if size[3] == b"+" else -1]
    return np.ascontiguousarray(texels, np.float32)


def _read_row(packed: memoryview, width: int, name: str) -> tuple[NDArray[np.uint8], memoryview]:
    """(W, 4) uint8 of one row, and what comes after it."""
    is_packed = width in PACKED_WIDTHS and bytes(packed[:2]) == b"\2\2"
    if not is_packed:
        if len(packed) < 4 * width:
            raise SceneError(name, "an end in the middle of a row", "whole rows")
        return np.frombuffer(packed[: 4 * width], np.uint8).reshape(width, 4), packed[4 * width :]
    packed = packed[4:]
    row = np.empty((4, width), np.uint8)
    for channel in row:
        filled = 0
        while filled < width:
            count = packed[0] if len(packed) > 1 else 0
            length = count - 128 if count > 128 else count
            values = packed[1:2] if count > 128 else packed[1 : 1 + length]
            if length == 0 or filled + length > width or len(values) not in (1, length):
                raise SceneError(name, "a run of texels that goes beyond its row", "whole rows")
            channel[filled : filled + length] = np.frombuffer(values, np.uint8)
            filled += length
            packed = packed[1 + len(values) :]
    return row.T, packed
