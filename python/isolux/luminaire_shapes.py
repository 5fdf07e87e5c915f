"""Luminaires as triangles, so that lamps look lit in pictures.

A shape shines with its mean luminance to all directions, whatever its goniometric diagram.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .scene_description import LuminaireDescription

# Facets around a disk, a cylinder or a sphere's equator: round enough at a lamp's size.
_FACETS = 48


def luminaire_triangles(
    luminaire: LuminaireDescription,
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Points and triangles of the shining surface, counter-clockwise seen from where it shines.

    returns : points (P, 3) float64, metres, world space; triangles (T, 3) int32. Both are empty
        for a luminaire without area.
    """
    if luminaire.is_infinite or luminaire.shape == "mesh":  # nowhere, or among the meshes
        return np.zeros((0, 3)), np.zeros((0, 3), np.int32)
    width, length = luminaire.size
    angle = np.linspace(0.0, 2 * np.pi, _FACETS, endpoint=False)
    if luminaire.shape == "rect":
        local = np.array([[-1, -1, 0], [-1, 1, 0], [1, 1, 0], [1, -1, 0]], np.float64)
        local *= [width / 2, length / 2, 0.0]
        triangles = np.array([[0, 1, 2], [0, 2, 3]])
    elif luminaire.shape == "disk":
        rim = np.stack([np.cos(angle), np.sin(angle), np.zeros(_FACETS)], axis=1)
        local = width * np.vstack([np.zeros(3), rim])
        around = np.arange(_FACETS)
        triangles = np.stack(
            [np.zeros_like(around), (around + 1) % _FACETS + 1, around + 1], axis=1
        )
    else:
        # Rings around X, from -X to +X.
        if luminaire.shape == "sphere":
            from_pole = np.linspace(np.pi, 0.0, _FACETS // 2 + 1)
            along, radius = width * np.cos(from_pole), width * np.sin(from_pole)
        else:
            along, radius = np.array([-length / 2, length / 2]), np.full(2, width)
        circle = np.stack([np.zeros(_FACETS), np.cos(angle), np.sin(angle)], axis=1)
        rings = radius[:, None, None] * circle
        rings[..., 0] = along[:, None]
        local = rings.reshape(-1, 3)
        triangles = _between_rings(len(along))
    if luminaire_area(luminaire) == 0.0:
        return np.zeros((0, 3)), np.zeros((0, 3), np.int32)
    return luminaire.origin + local @ luminaire.axes, triangles.astype(np.int32)


def luminaire_area(luminaire: LuminaireDescription) -> float:
    """Area of the shining surface, m²."""
    width, length = map(float, luminaire.size)
    return {
        "rect": width * length,
        "disk": np.pi * width**2,
        "sphere": 4 * np.pi * width**2,
        "cylinder": 2 * np.pi * width * length,
    }[luminaire.shape]


def mean_luminance(luminaire: LuminaireDescription) -> NDArray[np.float64]:
    """Luminance of the surface that would give the luminous flux by Lambert's law.

    returns : (3,) float64, cd/m² by channel
    """
    return luminaire.colour * luminaire.luminous_flux / (np.pi * luminaire_area(luminaire))


def dome_luminance(
    domes: Sequence[LuminaireDescription], directions: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Luminance of all domes in unit directions, cd/m² by channel; both (n, 3) float32."""
    out = np.zeros(directions.shape, np.float32)
    for dome in domes:
        assert dome.environment is not None
        x, y, z = (directions @ dome.axes.T).T
        height, width = dome.environment.shape[:2]
        row = (0.5 - np.arcsin(np.clip(y, -1, 1)) / np.pi) * height
        column = (0.5 - np.arctan2(x, z) / (2 * np.pi)) * width
        out += dome.environment[
            np.clip(row.astype(int), 0, height - 1), np.clip(column.astype(int), 0, width - 1)
        ]
    return out


def _between_rings(rings: int) -> NDArray[np.int64]:
    """Triangles that join neighbouring rings of _FACETS points, counter-clockwise from outside."""
    ring, around = np.divmod(np.arange((rings - 1) * _FACETS), _FACETS)
    here, next_here = ring * _FACETS + around, ring * _FACETS + (around + 1) % _FACETS
    up, next_up = here + _FACETS, next_here + _FACETS
    return np.concatenate(
        [np.stack([here, next_here, next_up], axis=1), np.stack([here, next_up, up], axis=1)]
    )
