"""What attributes hold, as arrays of the type that their schema wants."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd


class ArrayError(Exception):
    """An attribute holds what its schema does not want there; the message says so."""


def number_array(
    attribute: Usd.Attribute, time: Usd.TimeCode, dtype: type, columns: int | None = None
) -> NDArray:
    """The values of an array attribute, (n,) or (n, columns); empty where it has none.

    Raises ArrayError where they are no such numbers: other types, fractions for integers.
    """
    found = attribute.Get(time)
    if found is None:
        return np.zeros(0 if columns is None else (0, columns), dtype)
    values = np.asarray(found)
    if values.size == 0:
        return np.zeros(0 if columns is None else (0, columns), dtype)
    integers = np.issubdtype(dtype, np.integer)
    row = () if columns is None else (columns,)
    kinds = "iu" if integers else "iuf"
    if values.dtype.kind not in kinds or values.ndim == 0 or values.shape[1:] != row:
        raise ArrayError(f"{attribute.GetName()} that are {type(found).__name__}")
    if integers and values.itemsize > np.dtype(dtype).itemsize:
        limits = np.iinfo(dtype)
        if values.min() < limits.min or values.max() > limits.max:
            raise ArrayError(f"{attribute.GetName()} beyond {limits.bits} bits")
    return values.astype(dtype, copy=False)


def is_like(found: Any, default: Any) -> bool:
    """Whether a value can stand where the default stands: an asset, or numbers of its shape."""
    if isinstance(default, Sdf.AssetPath):
        return isinstance(found, Sdf.AssetPath)
    if not isinstance(default, bool | int | float | tuple | list):
        return True
    values = np.asarray(found)
    is_any_length = isinstance(default, list)
    return values.dtype.kind in "biuf" and (is_any_length or values.shape == np.shape(default))
