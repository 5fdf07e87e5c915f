"""Colours of attributes in linear Rec. 709, by the colour space that their attribute names."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pxr import Usd

from .colour_space import CLIPPED, UnknownColourSpaceError, to_linear_rec709
from .reading_context import ReadingContext


def attribute_colours(
    attribute: Usd.Attribute, colours: NDArray[np.floating], context: ReadingContext
) -> NDArray[np.floating]:
    """(n, 3) colours of an attribute in linear Rec. 709.

    The space is the attribute's own, or that of its prim or an ancestor where it is typed as a
    colour [UsdColorSpaceAPI]; without any, the colours are in linear Rec. 709 already.
    """
    space = attribute.GetColorSpace()
    if not space and attribute.GetRoleName() == "Color":
        space = Usd.ColorSpaceAPI.ComputeColorSpaceName(attribute, None)
    if not space:
        return colours
    try:
        converted, is_clipped = to_linear_rec709(colours, str(space))
    except UnknownColourSpaceError as error:
        reason = f"its colour space {space} can't be used ({error}): taken as linear Rec. 709"
        context.note(attribute.GetPrim(), attribute.GetName(), "approximated", reason)
        return colours
    if is_clipped:
        context.note(attribute.GetPrim(), attribute.GetName(), "repaired", CLIPPED)
    return converted
