"""Prims that USD or the solver can't take: a finding each, and the rest of the stage is read."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray
from pxr import Tf, Usd

from . import _core
from .attribute_values import ArrayError
from .reading_context import ReadingContext
from .scene_description import LuminaireDescription
from .usd_messages import usd_message


@contextmanager
def skipped_where_unreadable(prim: Usd.Prim, context: ReadingContext) -> Iterator[None]:
    """A prim on which USD itself fails, or whose arrays are none, is a finding and no end."""
    try:
        yield
    except ArrayError as error:
        context.note(prim, str(prim.GetTypeName()), "skipped", str(error))
    except Tf.ErrorException as error:
        context.note(prim, str(prim.GetTypeName()), "skipped", f"USD: {usd_message(error)}")


TOO_FAR = "points that are NaN, infinite or over 10⁹ m away"


def are_in_reach(points: NDArray[np.float64]) -> bool:
    """Whether points, in metres, are numbers to the solver; TOO_FAR says what else they are."""
    limit = _core.FARTHEST_POINT
    return bool(points.max(initial=0.0) <= limit and points.min(initial=0.0) >= -limit)


def is_in_reach(luminaire: LuminaireDescription, prim: Usd.Prim, context: ReadingContext) -> bool:
    """Whether distances to a luminaire are numbers to the solver; else a finding."""
    lengths = np.abs([*luminaire.origin, *luminaire.size])
    if (lengths <= _core.FARTHEST_POINT).all():
        return True
    reason = f"a place or a size of {lengths.max():.3g} m, over 10⁹ m"
    context.note(prim, str(prim.GetTypeName()), "skipped", reason)
    return False
