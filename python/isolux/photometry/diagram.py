"""Goniometric diagrams on one grid: gamma from nadir, C over the full circle.

Photometry is tabulated for type C (gamma, C), often for a quarter or half of the circle only, and
for types A and B (vertical, horizontal), whose polar axis lies across the luminaire.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._core import CandelaDistribution
from ..errors import PhotometryError
from ..scene_description import GoniometricDiagram
from .file_text import require_candela, require_increasing

Array = NDArray[np.float64]

_SAME_ANGLE = 1e-5  # deg, by which the ends of an angular range may miss 0, 90, 180, 270 or 360
_FLUX_TOLERANCE = 1e-3  # relative, of a change of axes before it is scaled away
_PEAK_TOLERANCE = 2e-2  # relative, by which a change of axes may lower the largest intensity
_MAX_CELLS = 2_000_000  # of the grid on which a change of axes may resample


def inline_diagram(
    gamma: ArrayLike, c_angles: ArrayLike, candela: ArrayLike, subject: str
) -> GoniometricDiagram:
    """Diagram authored as plain numbers, under the symmetry rules of type C photometry.

    gamma : (G,) deg, increasing in [0, 180]
    c_angles : (H,) deg, increasing: [0], 0-90, 0-180, 90-270 or 0-360 (360 may be left out)
    candela : (H, G) or flat in that order, cd, >= 0
    subject : prim path, for messages
    Raises PhotometryError where the numbers don't make a diagram that gives light.
    """
    gammas, planes = (np.asarray(angles, np.float64).ravel() for angles in (gamma, c_angles))
    values = np.asarray(candela, np.float64).ravel()
    if len(gammas) < 2 or len(planes) < 1:
        raise PhotometryError(
            subject,
            f"{len(gammas)} gamma angles and {len(planes)} C-angles",
            "at least 2 gamma angles and 1 C-angle",
        )
    if len(values) != len(gammas) * len(planes):
        raise PhotometryError(
            subject,
            f"{len(values)} candela values",
            f"{len(planes)} C-angles x {len(gammas)} gamma angles = {len(planes) * len(gammas)}",
        )
    if not (np.isfinite(gammas).all() and np.isfinite(planes).all()):
        raise PhotometryError(subject, "a NaN or infinite angle", "finite angles")
    require_increasing(gammas, "gamma angles", subject)
    require_increasing(planes, "C-angles", subject)
    require_candela(values, subject)
    return type_c_diagram(gammas, planes, values.reshape(len(planes), -1), subject, [])


def type_c_diagram(
    gamma: Array, c_angles: Array, candela: Array, subject: str, warnings: list[str]
) -> GoniometricDiagram:
    """Unfolds the symmetries of type C photometry: 0, 0-90, 0-180, 90-270, 0-360.

    gamma : (G,) deg, increasing; c_angles : (H,) deg, increasing; candela : (H, G) cd, >= 0
    """
    if gamma[0] < 0.0 or gamma[-1] > 180.0:
        raise PhotometryError(
            subject, f"vertical angles {gamma[0]:g} to {gamma[-1]:g} deg", "0 to 180 deg"
        )
    c_angles, candela = _unfold(c_angles, candela, subject, warnings)
    return GoniometricDiagram(np.radians(gamma), np.radians(c_angles), candela)


def type_ab_diagram(
    photometric_type: Literal["A", "B"],
    vertical: Array,
    horizontal: Array,
    candela: Array,
    subject: str,
    warnings: list[str],
) -> GoniometricDiagram:
    """Resamples type A or B photometry onto (gamma, C).

    The axis (0, 0) is nadir; vertical angles open from there towards C0 and horizontal ones towards
    C90 [CIE 121]. The horizontal angle of type B is a latitude about the C90 axis, the vertical
    angle of type A one about the C0 axis; the other angle is the longitude.

    vertical : (V,) deg, horizontal : (H,) deg, increasing; candela : (H, V) cd, >= 0
    """
    if len(horizontal) > 1 and horizontal[0] == 0.0:
        warnings.append("Horizontal angles start at 0: taken as laterally symmetric.")
        horizontal, candela = _mirror(horizontal, candela, about=0.0)
    if photometric_type == "A":
        latitude, longitude, axes = vertical, horizontal, _TYPE_A_AXES
    else:
        latitude, longitude, axes = horizontal, vertical, _TYPE_B_AXES
        candela = candela.T
    for angles, limit in ((latitude, 90.0), (longitude, 180.0)):
        if len(angles) < 2 or angles[0] < -limit or angles[-1] > limit:
            raise PhotometryError(
                subject,
                f"type {photometric_type} angles {angles[0]:g} to {angles[-1]:g} deg",
                f"two or more angles from {-limit:g} to {limit:g} deg",
            )
    own = CandelaDistribution(
        np.radians(latitude + 90.0), np.radians(longitude + 180.0), np.ascontiguousarray(candela)
    )
    return _change_axes(own, axes, latitude, longitude, candela.max(), subject, warnings)


def luminous_flux(diagram: GoniometricDiagram) -> float:
    """Flux of a diagram by integration over all directions, lm."""
    return CandelaDistribution(diagram.gamma, diagram.c_angles, diagram.candela).luminous_flux


def scale(diagram: GoniometricDiagram, factor: float) -> GoniometricDiagram:
    """The same directions at `factor` times the intensity."""
    return replace(diagram, candela=diagram.candela * factor)


def _unfold(c: Array, candela: Array, subject: str, warnings: list[str]) -> tuple[Array, Array]:
    """Planes from 0 to 360 deg inclusive, or the only plane at 0."""
    first, last = c[0], c[-1]
    if len(c) == 1:
        return np.zeros(1), candela
    if _same(first, 0.0) and _same(last, 90.0):
        c, candela = _mirror(c, candela, about=90.0)
        c, candela = _mirror(c, candela, about=180.0)
    elif _same(first, 0.0) and _same(last, 180.0):
        c, candela = _mirror(c, candela, about=180.0)
    elif _same(first, 90.0) and _same(last, 270.0):
        c, candela = _start_at_zero(*_mirror(c, candela, about=270.0))
    elif _same(first, 0.0) and max(180.0, 360.0 - np.diff(c).max() - _SAME_ANGLE) < last < 360.0:
        warnings.append("The plane at 360 deg is missing: the one at 0 deg closes the circle.")
        c, candela = np.append(c, 360.0), np.vstack([candela, candela[:1]])
    if not (_same(c[0], 0.0) and _same(c[-1], 360.0)):
        raise PhotometryError(
            subject,
            f"horizontal angles {first:g} to {last:g} deg",
            "0, 0-90, 0-180, 90-270 or 0-360 deg",
        )
    c = c.copy()
    c[0], c[-1] = 0.0, 360.0
    return c, candela


def _same(angle: float, nominal: float) -> bool:
    return abs(angle - nominal) <= _SAME_ANGLE


def _mirror(angles: Array, candela: Array, about: float) -> tuple[Array, Array]:
    """Both sides of a plane of symmetry at one end of the angles."""
    if abs(angles[0] - about) < abs(angles[-1] - about):
        reflected, values = 2.0 * about - angles[:0:-1], candela[:0:-1]
        return np.concatenate([reflected, angles]), np.vstack([values, candela])
    reflected, values = 2.0 * about - angles[-2::-1], candela[-2::-1]
    return np.concatenate([angles, reflected]), np.vstack([candela, values])


def _start_at_zero(c: Array, candela: Array) -> tuple[Array, Array]:
    """Turns a closed circle of planes that starts between 0 and 360 deg to start at 0."""
    cut = int(np.searchsorted(c, 360.0 - _SAME_ANGLE))
    if not _same(c[cut], 360.0):
        share = (360.0 - c[cut - 1]) / (c[cut] - c[cut - 1])
        plane = candela[cut - 1] + share * (candela[cut] - candela[cut - 1])
        c, candela = np.insert(c, cut, 360.0), np.insert(candela, cut, plane, axis=0)
    turned = np.concatenate([c[cut:] - 360.0, c[1 : cut + 1]])
    return turned, np.vstack([candela[cut:], candela[1 : cut + 1]])


# Rows: X, Y and Z of a diagram whose zenith is the type's pole and whose C180 is nadir, in local
# axes.
_TYPE_A_AXES = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
_TYPE_B_AXES = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def _change_axes(
    own: CandelaDistribution,
    axes: Array,
    latitude: Array,
    longitude: Array,
    largest: float,
    subject: str,
    warnings: list[str],
) -> GoniometricDiagram:
    # The file's own angles, as angles from nadir, say where it is fine: the gamma grid starts from
    # them, and both grids are halved until flux and peak agree with the file in its own axes. What
    # is left of the difference in flux is scaled away.
    nadir_angles = np.abs(np.concatenate([latitude, longitude]))
    reach = 180.0  # largest angle from nadir
    if max(-longitude[0], longitude[-1]) <= 90.0:
        cosines = np.cos(np.radians([max(-a[0], a[-1]) for a in (latitude, longitude)]))
        reach = float(np.degrees(np.arccos(cosines.prod())))
    inside = np.round(nadir_angles[nadir_angles < reach - _SAME_ANGLE], 6)
    gamma = _divide(np.append(np.unique(np.append(inside, 0.0)), reach), 1.0)
    c = np.linspace(0.0, 360.0, 145)
    while True:
        diagram = _resample(own, axes, np.radians(gamma), np.radians(c))
        flux = luminous_flux(diagram)
        error = flux / own.luminous_flux - 1.0
        peak = float(diagram.candela.max() / largest)
        if abs(error) <= _FLUX_TOLERANCE and peak >= 1.0 - _PEAK_TOLERANCE:
            break
        if 4 * len(gamma) * len(c) > _MAX_CELLS:
            warnings.append(
                f"Resampled to type C: {100.0 * error:+.2g} % of flux, since scaled away, and "
                f"{100.0 * peak:.4g} % of the peak."
            )
            break
        gamma, c = _halve(gamma), _halve(c)
    if flux == 0.0:
        raise PhotometryError(subject, "a peak too narrow to resample", "type C photometry")
    return scale(diagram, own.luminous_flux / flux)


def _resample(own: CandelaDistribution, axes: Array, gamma: Array, c: Array) -> GoniometricDiagram:
    sine = np.sin(gamma)
    x, y = np.cos(c)[:, None] * sine, np.sin(c)[:, None] * sine
    directions = np.stack([x, y, np.broadcast_to(-np.cos(gamma), x.shape)], axis=-1)
    candela = own.intensity(directions.reshape(-1, 3) @ axes.T)
    return GoniometricDiagram(gamma, c, candela.reshape(x.shape))


def _halve(angles: Array) -> Array:
    middles = 0.5 * (angles[:-1] + angles[1:])
    return np.insert(angles, np.arange(1, len(angles)), middles)


def _divide(angles: Array, widest: float) -> Array:
    """The angles with equal parts between neighbours, none of them wider than `widest`."""
    pieces = [
        np.linspace(a, b, int(np.ceil((b - a) / widest)), endpoint=False)
        for a, b in pairwise(angles)
    ]
    return np.concatenate([*pieces, angles[-1:]])
