"""A scene in plain arrays, as every peer gets it. NumPy alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Angles at which a goniometric diagram is given, both ends included.
GAMMA_COUNT, C_COUNT = 181, 145  # 1° from nadir to zenith, 2.5° around

# Of peers that bake: a triangle around the centre of a texel, texels.
TEXEL_TRIANGLE = np.array([[-0.45, -0.4], [0.45, -0.4], [0.0, 0.45]])


class LackingError(Exception):
    """A peer, or its adapter, lacks what the scene needs."""


@dataclass(frozen=True, slots=True)
class PeerLuminaire:
    """A luminaire: no surface stops light at it.

    shape : rect (width along X, height along Y), disk (radius), sphere (radius), cylinder (radius,
        length along X)
    origin, axes : m; rows are the unit local X, Y, Z in world space; disk and rect shine to −Z
    size : (2,) m
    colour : (3,) linear Rec. 709, of luminance 1
    luminous_flux : lm
    candela : (C_COUNT, GAMMA_COUNT) cd towards the local −Z turned by gamma, C from +X to +Y;
        None: a surface of constant luminance
    """

    shape: str
    origin: Array
    axes: Array
    size: Array
    colour: Array
    luminous_flux: float
    candela: Array | None

    @property
    def area(self) -> float:
        """Of what shines, m²."""
        width, height = self.size
        return float(
            {
                "rect": width * height,
                "disk": np.pi * width**2,
                "sphere": 4 * np.pi * width**2,
                "cylinder": 2 * np.pi * width * height,
            }[self.shape]
        )

    @property
    def luminance(self) -> Array:
        """(3,) cd/m² by channel, of one without a diagram."""
        return self.colour * self.luminous_flux / (np.pi * self.area)


@dataclass(frozen=True, slots=True)
class PeerScene:
    """Surfaces, luminaires, and the points that want to know their light.

    corners : (T, 3, 3) float64, m, counter-clockwise seen from the front
    reflectance : (T, 3) float32, linear Rec. 709
    double_sided : (T,) bool; the back of others absorbs
    positions, normals : (N, 3) float64, m; off their surface by a few roundings of a float
    """

    corners: Array
    reflectance: NDArray[np.float32]
    double_sided: NDArray[np.bool_]
    luminaires: Sequence[PeerLuminaire]
    positions: Array
    normals: Array

    def receiver_triangles(self, size: float) -> Array:
        """(N, 3, 3) m: over each point, across its normal, a triangle like TEXEL_TRIANGLE.

        It is lifted by its size, lest the faces at the point, which may lean, cover a part of it.

        size : of a texel, of the scene's largest extent
        """
        n = self.normals
        across = np.cross(n, np.where(np.abs(n[:, :1]) < 0.5, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]))
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        frame = np.stack([across, np.cross(n, across)], axis=1)  # (N, 2, 3)
        size *= float(np.ptp(self.corners.reshape(-1, 3), axis=0).max())
        middles = (self.positions + size * n)[:, None]
        return middles + size * np.einsum("ki,nij->nkj", TEXEL_TRIANGLE, frame)

    def save(self, path: Path) -> None:
        arrays = {
            "corners": self.corners,
            "reflectance": self.reflectance,
            "double_sided": self.double_sided,
            "positions": self.positions,
            "normals": self.normals,
            "shape": np.array([light.shape for light in self.luminaires]),
            "origin": np.array([light.origin for light in self.luminaires]),
            "axes": np.array([light.axes for light in self.luminaires]),
            "size": np.array([light.size for light in self.luminaires]),
            "colour": np.array([light.colour for light in self.luminaires]),
            "luminous_flux": np.array([light.luminous_flux for light in self.luminaires]),
        }
        diagrams = {
            f"candela{i}": light.candela
            for i, light in enumerate(self.luminaires)
            if light.candela is not None
        }
        np.savez(path, **arrays, **diagrams)

    @classmethod
    def load(cls, path: Path) -> PeerScene:
        with np.load(path) as file:
            columns = ("shape", "origin", "axes", "size", "colour", "luminous_flux")
            rows = zip(*(file[column] for column in columns), strict=True)
            luminaires = [
                PeerLuminaire(str(shape), *rest, file.get(f"candela{i}"))
                for i, (shape, *rest) in enumerate(rows)
            ]
            surfaces = (file[name] for name in ("corners", "reflectance", "double_sided"))
            return cls(*surfaces, luminaires, file["positions"], file["normals"])
