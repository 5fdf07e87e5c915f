"""The texture of a node: its tiles, and a finding where they can't be read."""

from __future__ import annotations

from collections import OrderedDict
from functools import partial

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdShade

from .colour_space import CLIPPED, UnknownColourSpaceError, colour_space_fault
from .errors import SceneError
from .reading_context import ReadingContext
from .shader_values import Textured, TextureLayout
from .textures import Texture, read_texture

# Texels kept for the next material or mesh; what is beyond is read again.
KEPT_BYTES = 1 << 29


class TextureReader:
    """Reads each file once in each colour space, as far as KEPT_BYTES reach."""

    def __init__(self, context: ReadingContext) -> None:
        self._context = context
        self._kept: OrderedDict[tuple[str, str], Texture] = OrderedDict()

    def texture(
        self,
        prim: Usd.Prim,
        asset: Sdf.AssetPath,
        source: Usd.Attribute | None,
        space: str,
        layout: TextureLayout,
        fallback: NDArray[np.float64] | None,
    ) -> Textured | None:
        """The texture of a node; None, with a finding, where it has none that can be read.

        source : the attribute that names the file
        fallback : (4,) as authored
        """
        fault = colour_space_fault(space)
        if fault:
            reason = f"its colour space {space} can't be used ({fault}): taken as raw"
            self._context.note(prim, "sourceColorSpace", "approximated", reason)
            space = "raw"
        is_udim = UsdShade.UdimUtils.IsUdimIdentifier(asset.path)
        files = {0: asset}
        if is_udim:
            files = _tiles(asset, source)
        instead = "" if fallback is None else "; its fallback instead"
        tiles, is_clipped, metadata = {}, False, ("", "")
        for number, file in files.items():
            try:
                texture = self._file(file, space)
            except (SceneError, UnknownColourSpaceError) as error:
                found = error.found if isinstance(error, SceneError) else str(error)
                reason = f"texture {file.path or 'without a file'}: {found}{instead}"
                self._context.note(prim, _kind(prim), "skipped", reason)
                continue
            tiles[number] = partial(self._texels, file, space)
            is_clipped |= texture.is_clipped
            metadata = texture.wrap
        if not tiles:
            if is_udim and not files:
                reason = f"texture {asset.path}: no tiles{instead}"
                self._context.note(prim, _kind(prim), "skipped", reason)
            return None
        reason = "a face takes the mean of its part of the texture"
        self._context.note(prim, _kind(prim), "approximated", reason)
        if is_clipped:
            self._context.note(prim, _kind(prim), "repaired", CLIPPED)
        across, down = (
            mode if mode in ("repeat", "mirror", "clamp", "black") else found or "black"
            for mode, found in zip(layout.wrap, metadata, strict=True)
        )
        wrap = ("clamp", "clamp") if is_udim else (across, down)
        outside = fallback if is_udim and fallback is not None else np.zeros(4)
        return Textured(tiles, outside, TextureLayout(layout.coordinates, wrap, is_udim))

    def _texels(self, asset: Sdf.AssetPath, space: str) -> NDArray[np.float32]:
        return self._file(asset, space).texels

    def _file(self, asset: Sdf.AssetPath, space: str) -> Texture:
        key = (asset.resolvedPath, space)
        if key in self._kept:
            self._kept.move_to_end(key)
            return self._kept[key]
        texture = read_texture(asset, space)
        self._kept[key] = texture
        while (
            len(self._kept) > 1 and sum(t.texels.nbytes for t in self._kept.values()) > KEPT_BYTES
        ):
            self._kept.popitem(last=False)
        return texture


def _tiles(asset: Sdf.AssetPath, source: Usd.Attribute | None) -> dict[int, Sdf.AssetPath]:
    """Files of a UDIM set by their number; the path is relative to the layer that says it."""
    specs = source.GetPropertyStack() if source else []
    if not specs:
        return {}
    found = UsdShade.UdimUtils.ResolveUdimTilePaths(asset.path, specs[0].layer)
    return {int(number): Sdf.AssetPath(path, path) for path, number in found}


def _kind(prim: Usd.Prim) -> str:
    return str(UsdShade.Shader(prim).GetShaderId())
