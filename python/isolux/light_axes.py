"""Where a light's local axes lie in the world, whatever its transform leaves of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .reading_context import SINGULAR_SCALE


def light_axes(linear: NDArray[np.float64]) -> tuple[NDArray[np.float64], bool] | None:
    """Orthonormal axes as rows, and whether local +Y lies along minus the second one.

    linear : (3, 3) float64, the images of the local axes as rows
    returns : None where more than one direction is flattened, so that the light faces nowhere
    """
    # Products of tiny scales would vanish; a power of two leaves the bits.
    linear = np.ldexp(linear, -np.frexp(np.abs(linear).max())[1])
    local_x, local_y, local_z = linear
    is_mirrored = False
    if _span_a_plane(local_x, local_y, linear):
        # The luminous plane's normal, on the side of local +Z: a shear may tilt Z itself.
        normal = np.cross(local_x, local_y)
        is_mirrored = bool(normal @ local_z < 0)
        axis_x = local_x / np.linalg.norm(local_x)
        axis_z = normal / np.linalg.norm(normal) * (-1 if is_mirrored else 1)
    elif _span_a_plane(local_z, local_x, linear):
        axis_x = local_x / np.linalg.norm(local_x)
        axis_z = _unit(np.cross(axis_x, np.cross(local_z, axis_x)))
    elif _span_a_plane(local_y, local_z, linear):
        axis_x = _unit(np.cross(local_y, local_z))
        axis_z = local_z / np.linalg.norm(local_z)
    else:
        return None
    return np.array([axis_x, np.cross(axis_z, axis_x), axis_z]), is_mirrored


def _span_a_plane(
    a: NDArray[np.float64], b: NDArray[np.float64], linear: NDArray[np.float64]
) -> bool:
    lengths = np.linalg.norm([a, b], axis=1)
    if lengths.min() <= SINGULAR_SCALE * np.linalg.norm(linear):
        return False
    sine = np.linalg.norm(np.cross(a / lengths[0], b / lengths[1]))
    return bool(sine > SINGULAR_SCALE)


def _unit(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    return vector / np.linalg.norm(vector)
