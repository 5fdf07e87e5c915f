"""A mesh in another place: only its points, its normals and its own space are new."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .scene_description import MeshCopy, MeshDescription


class Motion:
    """From one place of a prototype to another.

    matrix : (4, 4) float64, for row vectors: world space, metres
    linear : (3, 3) float64, its upper left
    for_normals : (3, 3) float64 on the front side before and after, their length aside
    """

    def __init__(self, moved: NDArray[np.float64], metres: float) -> None:
        self.matrix = moved.copy()
        self.matrix[3, :3] *= metres
        self.linear = self.matrix[:3, :3]
        (a, b, c), (d, e, f), (g, h, i) = self.linear.tolist()
        cofactors = np.array(
            [
                [e * i - f * h, f * g - d * i, d * h - e * g],
                [c * h - b * i, a * i - c * g, b * g - a * h],
                [b * f - c * e, c * d - a * f, a * e - b * d],
            ]
        )
        self.mirrors = bool(cofactors[0] @ self.linear[0] < 0)
        # The inverse transpose keeps outward normals outward, under mirroring as well.
        self.for_normals = -cofactors if self.mirrors else cofactors

    def copied(self, mesh: MeshDescription, path: str, source_path: str) -> MeshDescription:
        """The mesh in the other place."""
        first = mesh.copy_of
        normals = mesh.corner_normals
        if normals is not None:
            turned = normals @ self.for_normals
            lengths = np.sqrt(np.einsum("ij,ij->i", turned, turned))[:, None]
            normals = (turned / np.where(lengths > 0, lengths, 1.0)).astype(np.float32)
        return replace(
            mesh,
            path=path,
            source_path=source_path,
            points=mesh.points @ self.linear + self.matrix[3, :3],
            corner_normals=normals,
            flip_winding=mesh.flip_winding != self.mirrors,
            copy_of=MeshCopy(first.path, first.matrix @ self.matrix)
            if first
            else MeshCopy(mesh.path, self.matrix),
            to_world=self.matrix if mesh.to_world is None else mesh.to_world @ self.matrix,
        )
