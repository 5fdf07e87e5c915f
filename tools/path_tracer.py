"""Light at points of a scene by path tracing with next-event estimation, for `reference.py`.

Direct light is gathered over each luminaire's surface, indirect light along paths of
cosine-distributed bounces with next-event estimation at every hit and Russian roulette without a
limit of bounces. Both are unbiased. All is double precision but the rays themselves.
"""

from __future__ import annotations

import numpy as np
from luminaire_sampling import Array, Emitters, LuminaireChoice, cosine_directions
from numpy.typing import NDArray

from isolux import _core
from isolux.scene_description import SceneDescription

# Rays start and end this share of the scene's half size off a surface: 32 roundings of a float.
OFFSET = 2.0**-19
SHAPES = ("rect", "disk", "sphere", "cylinder")
CHUNK = 1 << 16  # paths or samples that are followed side by side; they fit the cache


def refuse_what_paths_lack(scene: SceneDescription) -> None:
    """Stop at what neither the path-traced reference nor the peers' adapters know."""
    for luminaire in scene.luminaires:
        if luminaire.shape not in SHAPES:
            raise SystemExit(
                f"{luminaire.path}: a {luminaire.shape} light; the reference knows {SHAPES}"
            )
        if luminaire.lit_meshes is not None or luminaire.shadow_meshes is not None:
            raise SystemExit(
                f"{luminaire.path}: light links; the reference knows lights that light all"
            )
    for mesh in scene.meshes:
        if mesh.opacity is not None and not (mesh.opacity == 1).all():
            raise SystemExit(f"{mesh.path}: not opaque; the reference knows opaque meshes")


class PathTracer:
    """Gathers light at points of a scene."""

    def __init__(self, scene: SceneDescription) -> None:
        corners, normals, reflectance, double_sided = [], [], [], []
        for mesh in scene.meshes:
            triangles, faces = _core.triangulate(
                mesh.points, mesh.face_vertex_counts, mesh.face_vertex_indices, mesh.hole_faces,
                mesh.flip_winding,
            )  # fmt: skip
            p = mesh.points[mesh.face_vertex_indices[triangles]]
            normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
            corners.append(p)
            normals.append(normal / np.linalg.norm(normal, axis=1, keepdims=True))
            of_face = faces if len(mesh.reflectance) > 1 else np.zeros_like(faces)
            reflectance.append(mesh.reflectance[of_face].astype(np.float64))
            double_sided.append(np.full(len(p), mesh.double_sided))
        self._corners = np.concatenate(corners)
        self._normals = np.concatenate(normals)
        self._reflectance = np.concatenate(reflectance)
        self._double_sided = np.concatenate(double_sided)
        points = self._corners.reshape(-1, 3)
        self._caster = _core.RayCaster(
            points, np.arange(len(points), dtype=np.int32).reshape(-1, 3)
        )
        low, high = points.min(axis=0), points.max(axis=0)
        self._offset = OFFSET * float((high - low).max()) / 2
        self._emitters = Emitters(scene.luminaires, self._offset)
        self._choice = LuminaireChoice(self._emitters, low, high)

    def direct(
        self, positions: Array, normals: Array, samples: int, random: np.random.Generator
    ) -> Array:
        """(n, 3) lx by channel: jittered samples of each luminaire, about so many of all."""
        emitters = self._emitters
        strata = max(1, int(np.sqrt(samples / emitters.count)))
        per_point = emitters.count * strata**2
        which = np.repeat(np.arange(emitters.count), strata**2)
        out = np.zeros((len(positions), 3))
        step = max(1, CHUNK // per_point)
        for first in range(0, len(positions), step):
            some = slice(first, first + step)
            x = positions[some] + self._offset * normals[some]
            n = np.repeat(normals[some], per_point, axis=0)
            u = np.tile(_strata(strata), (len(x) * emitters.count, 1))
            u = (u + random.random(u.shape)) / strata
            light = self._unoccluded(
                np.tile(which, len(x)), np.repeat(x, per_point, axis=0), n, u
            ).reshape(len(x), emitters.count, -1)
            out[some] = light.mean(axis=2) @ emitters.colour
        return out

    def indirect(
        self, positions: Array, normals: Array, strata: int, random: np.random.Generator
    ) -> Array:
        """(n, 3) lx by channel: strata² paths from each point."""
        paths = strata**2
        out = np.zeros((len(positions), 3))
        step = max(1, CHUNK // paths)
        for first in range(0, len(positions), step):
            some = slice(first, first + step)
            n = np.repeat(normals[some], paths, axis=0)
            x = np.repeat(positions[some] + self._offset * normals[some], paths, axis=0)
            u = np.tile(_strata(strata), (len(x) // paths, 1))
            light = self._along_paths(x, n, (u + random.random(u.shape)) / strata, random)
            out[some] = light.reshape(-1, paths, 3).mean(axis=1)
        return out

    def _along_paths(
        self, x: Array, normals: Array, u: Array, random: np.random.Generator
    ) -> Array:
        """(n, 3) lx: what one path from each point brings, its first direction by u (n, 2)."""
        out = np.zeros_like(x)
        path = np.arange(len(x))
        throughput = np.ones_like(x)
        directions = cosine_directions(normals, u)
        while len(path):
            triangle, barycentric, _ = self._caster.closest_hits(x, directions.astype(np.float32))
            normals = self._normals[triangle]
            back = np.einsum("ni,ni->n", normals, directions) > 0
            kept = np.flatnonzero((triangle >= 0) & (~back | self._double_sided[triangle]))
            path, triangle, throughput = path[kept], triangle[kept], throughput[kept]
            normals = np.where(back[kept, None], -normals[kept], normals[kept])
            v, w = barycentric[kept].astype(np.float64).T[..., None]
            p, q, r = self._corners[triangle].transpose(1, 0, 2)
            x = p * (1 - v - w) + q * v + r * w + self._offset * normals
            throughput = throughput * self._reflectance[triangle]
            out[path] += throughput * self._one_luminaire(x, normals, random)
            survival = np.minimum(1.0, throughput.max(axis=1))
            on = np.flatnonzero(random.random(len(path)) < survival)
            path, x, normals = path[on], x[on], normals[on]
            throughput = throughput[on] / survival[on, None]
            directions = cosine_directions(normals, random.random((len(on), 2)))
        return out

    def _one_luminaire(self, x: Array, normals: Array, random: np.random.Generator) -> Array:
        """(n, 3) lx by channel: direct light by one luminaire, chosen by its probable share."""
        which, probability = self._choice.choose(x, random.random(len(x)))
        light = self._unoccluded(which, x, normals, random.random((len(x), 2))) / probability
        return light[:, None] * self._emitters.colour[which]

    def _unoccluded(self, which: NDArray[np.int64], x: Array, normals: Array, u: Array) -> Array:
        light, end = self._emitters.illuminance(which, x, normals, u)
        lit = np.flatnonzero(light > 0)
        out = np.zeros_like(light)
        out[lit] = self._caster.transmitted(x[lit], end[lit]) * light[lit]
        return out


def _strata(count: int) -> Array:
    i, j = np.meshgrid(np.arange(count), np.arange(count), indexing="ij")
    return np.stack([i, j], axis=-1).reshape(-1, 2).astype(np.float64)
