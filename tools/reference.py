"""Pointwise reference: illuminance at some illumination vertices by path tracing.

    python tools/reference.py STAGE [--vertices M] [--batches B] [--strata S]

It shares the scene description and the bare ray caster with the solver, nothing else: no mesh of
results, no photon, no filter, no code of the luminaires. Direct light is gathered over each
luminaire's surface, indirect light along paths of cosine-distributed bounces with next-event
estimation at every hit and Russian roulette without a limit of bounces. Both are unbiased.

All is double precision but the rays themselves. Independent batches tell the standard error.
"""

from __future__ import annotations

import argparse
import hashlib
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from isolux import _core
from isolux.core_scene import build_core_scene
from isolux.scene_description import GoniometricDiagram, LuminaireDescription, SceneDescription
from isolux.settings import SolverSettings
from isolux.solution import LUMINANCE_WEIGHTS
from isolux.stage_reader import read_stage

Array = NDArray[np.float64]

DIRECT, INDIRECT, TOTAL = (0,), (1,), (0, 1)
# Rays start and end this share of the scene's half size off a surface: 32 roundings of a float.
OFFSET = 2.0**-19
CHUNK = 1 << 16  # paths or samples that are followed side by side; they fit the cache
GRID_CELLS, GRID_ENTRIES = 16, 1 << 22  # along each axis; cells times luminaires at most
VERSION = 1  # of what the numbers mean, for the cache


@dataclass(frozen=True, slots=True)
class Error:
    """How far a solution is from the reference, all relative to the mean illuminance.

    rms : the reference's own variance is subtracted
    error_bar : standard error of `rms`, from how much the vertices differ
    median, percentile_95 : of the absolute differences, reference noise included
    """

    rms: float
    error_bar: float
    median: float
    percentile_95: float


@dataclass(frozen=True, slots=True)
class PathTracedReference:
    """Illuminance at illumination vertices: all of them, or M at even steps along their area.

    vertices : (M,) int64, of the core scene
    weights : (M,) float64, share of the area that each stands for
    complete : these are all vertices with light
    batches : (B, M, 2, 3) float64, lx by channel: direct and indirect of independent batches
    """

    vertices: NDArray[np.int64]
    weights: Array
    complete: bool
    batches: Array

    def illuminance(self, part: tuple[int, ...]) -> Array:
        """(M, 3) lx by channel. part : DIRECT, INDIRECT or TOTAL"""
        return self.batches[:, :, part].sum(axis=2).mean(axis=0)

    def standard_error(self, part: tuple[int, ...]) -> Array:
        """(M, 3) lx by channel, of `illuminance`."""
        return _standard_error(self.batches[:, :, part].sum(axis=2))

    def luminance_pair(self, part: tuple[int, ...]) -> tuple[Array, Array]:
        """(M,) photometric illuminance and its standard error, lx."""
        batches = self.batches[:, :, part].sum(axis=2) @ LUMINANCE_WEIGHTS
        return batches.mean(axis=0), _standard_error(batches)

    def mean(self, part: tuple[int, ...]) -> float:
        """Area-weighted mean photometric illuminance, lx."""
        return float(self.weights @ self.luminance_pair(part)[0])

    def noise(self, part: tuple[int, ...]) -> float:
        """The reference's own relative RMS error."""
        mean, error = self.luminance_pair(part)
        square = self.weights @ error**2
        return float(np.sqrt(square) / (self.weights @ mean)) if mean.any() else 0.0

    def error(self, direct: NDArray, indirect: NDArray, part: tuple[int, ...]) -> Error:
        """Of a solution.

        direct, indirect : (n, 3) lx by channel, n at least the number of illumination vertices
        part : DIRECT, INDIRECT or TOTAL
        """
        truth, noise = self.luminance_pair(part)
        pair = [values[self.vertices] @ LUMINANCE_WEIGHTS for values in (direct, indirect)]
        difference = sum(pair[i] for i in part) - truth
        mean = self.weights @ truth
        if mean == 0.0:
            return Error(0.0, 0.0, 0.0, 0.0)
        squares = difference**2 - noise**2
        square = self.weights @ squares
        # Of a sample of the vertices, how much they differ is the uncertainty; of all, their noise.
        spread = (squares - square) ** 2
        if self.complete:
            spread = 2 * noise**4 + 4 * noise**2 * np.maximum(0.0, squares)
        uncertainty = np.sqrt(self.weights**2 @ spread)
        rms = np.sqrt(max(0.0, square))
        bar = uncertainty / (2 * max(rms, np.sqrt(uncertainty), 1e-300))
        median, high = _percentiles(np.abs(difference), self.weights, (0.5, 0.95))
        return Error(*(float(x / mean) for x in (rms, bar, median, high)))


def path_traced_reference(
    scene: SceneDescription,
    core: _core.Scene,
    vertices: int = 1000,
    batches: int = 16,
    strata: int = 32,
    seed: int = 2**31 - 1,
    cache: Path | None = None,
) -> PathTracedReference:
    """Trace the reference, or take it from the cache.

    scene, core : as described and as built; the latter only tells where its vertices are
    vertices : M; all where there are no more
    batches : independent, two or more
    strata : along both axes of the cosine-distributed first bounces: a batch has strata²
        paths a vertex
    cache : folder of earlier references; None: always trace
    """
    areas = core.vertex_areas * (np.abs(core.vertex_normals).max(axis=1) > 0)
    complete = np.count_nonzero(areas) <= vertices
    chosen = np.flatnonzero(areas) if complete else _at_even_steps(areas, vertices, seed)
    weights = areas[chosen] / areas.sum() if complete else np.full(vertices, 1 / vertices)
    positions = np.asarray(core.receiver_positions, np.float64)[chosen]
    normals = np.asarray(core.vertex_normals, np.float64)[chosen]
    parameters = (VERSION, batches, strata, seed)
    file = None
    if cache is not None:
        file = cache / f"reference_{_digest(scene, positions, normals, parameters)}.npz"
        if file.exists():
            with np.load(file) as known:
                return PathTracedReference(chosen, weights, complete, known["batches"])
    tracer = PathTracer(scene)
    light = np.empty((batches, len(chosen), 2, 3))
    for batch in range(batches):
        random = np.random.default_rng([seed, batch])
        light[batch, :, 0] = tracer.direct(positions, normals, random)
        light[batch, :, 1] = tracer.indirect(positions, normals, strata, random)
    if file is not None:
        file.parent.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(file, vertices=chosen, batches=light)
    return PathTracedReference(chosen, weights, complete, light)


class Emitters:
    """All luminaires, evaluated side by side.

    With I(ω) the intensity towards the point and θ its angle there, each sample of a shape gives
    E = I cosθ w. A luminance that depends on direction alone is I over the projected area, so that
    w is 1/d² for a flat shape where it is sampled uniformly; 2 / (d² (1 + cosη)) for a sphere seen
    under the half angle η, sampled uniformly over its solid angle; and φ cosθ' / (d² sinα) for a
    cylinder seen over the angles ±φ around its axis, α the angle between axis and ray.
    """

    def __init__(self, luminaires: Sequence[LuminaireDescription], lift: float) -> None:
        self.count = len(luminaires)
        self.colour = np.array([luminaire.colour for luminaire in luminaires], np.float64)
        self._lift = lift
        self._origin = np.array([luminaire.origin for luminaire in luminaires], np.float64)
        self._axes = np.array([luminaire.axes for luminaire in luminaires], np.float64)
        self._size = np.array([luminaire.size for luminaire in luminaires], np.float64)
        self.flux = np.array([luminaire.luminous_flux for luminaire in luminaires], np.float64)
        self._shape = np.array([luminaire.shape for luminaire in luminaires])
        # Equal diagrams are looked up at once.
        self._diagrams: list[GoniometricDiagram] = []
        self._diagram = np.full(self.count, -1)
        self._scale = np.ones(self.count)
        known: dict[bytes, int] = {}
        for i, luminaire in enumerate(luminaires):
            if luminaire.diagram is not None:
                d = luminaire.diagram
                key = b"/".join(np.asarray(a).tobytes() for a in (d.gamma, d.c_angles, d.candela))
                if key not in known:
                    known[key] = len(self._diagrams)
                    self._diagrams.append(d)
                self._diagram[i] = known[key]
                self._scale[i] = luminaire.luminous_flux / diagram_flux(d)

    def intensity(self, which: NDArray[np.int64], towards: Array) -> Array:
        """(n,) cd of luminaire `which` (n,) in unit world directions (n, 3)."""
        local = np.einsum("nij,nj->ni", self._axes[which], towards)
        shape, flux = self._shape[which], self.flux[which]
        flat = (shape == "disk") | (shape == "rect")
        out = np.where(flat, flux / np.pi * np.maximum(0.0, -local[:, 2]), flux / (4 * np.pi))
        across = np.hypot(local[:, 1], local[:, 2])
        out = np.where(shape == "cylinder", flux / np.pi**2 * across, out)
        diagram = self._diagram[which]
        for i, table in enumerate(self._diagrams):
            of = np.flatnonzero(diagram == i)
            out[of] = diagram_intensity(table, local[of]) * self._scale[which[of]]
        return out

    def illuminance(
        self, which: NDArray[np.int64], x: Array, normals: Array, u: Array
    ) -> tuple[Array, Array]:
        """One sample of each luminaire `which` (n,) as seen from points (n, 3).

        u : (n, 2) in [0, 1)
        returns : (n,) lx of luminance before occlusion; (n, 3) where the shadow ray ends
        """
        axes, size = self._axes[which], self._size[which]
        seen_from = np.einsum("nij,nj->ni", axes, x - self._origin[which])  # local
        local_normals = np.einsum("nij,nj->ni", axes, normals)
        weight = np.zeros(len(which))
        y, lift = np.zeros((len(which), 3)), np.zeros((len(which), 3))
        shape = self._shape[which]
        for name, sample in (
            ("rect", _sample_flat), ("disk", _sample_flat),
            ("sphere", _sample_sphere), ("cylinder", _sample_cylinder),
        ):  # fmt: skip
            of = np.flatnonzero(shape == name)
            if len(of):
                y[of], lift[of], weight[of] = sample(
                    name, seen_from[of], local_normals[of], size[of], u[of]
                )
        end = self._origin[which] + np.einsum("nji,nj->ni", axes, y + self._lift * lift)
        to_light = np.einsum("nji,nj->ni", axes, y - seen_from)
        distance = np.linalg.norm(to_light, axis=1)
        lit = (distance > 0) & (weight > 0)
        to_light[lit] /= distance[lit, None]
        cosine = np.where(lit, np.einsum("ni,ni->n", to_light, normals), 0.0)
        out = np.zeros(len(which))
        seen = np.flatnonzero(cosine > 0)
        out[seen] = self.intensity(which[seen], -to_light[seen]) * cosine[seen] * weight[seen]
        return out, end


def _sample_flat(
    name: str, x: Array, normals: Array, size: Array, u: Array
) -> tuple[Array, Array, Array]:
    """Uniform over the shape; close to it, half of the samples along cosine-distributed rays.

    These bound the light of a single sample; both by the balance heuristic [Veach 1995].
    """
    if name == "rect":
        area = size.prod(axis=1)
        beside = np.linalg.norm(np.maximum(0.0, np.abs(x[:, :2]) - size / 2), axis=1)
    else:
        area = np.pi * size[:, 0] ** 2
        beside = np.maximum(0.0, np.hypot(x[:, 0], x[:, 1]) - size[:, 0])
    nearest = np.maximum(beside**2 + x[:, 2] ** 2, 1e-300)
    share = 0.5 * np.clip(area / nearest - 1, 0.0, 1.0)  # of the rays
    y = np.zeros_like(x)
    uniform = u[:, 0] >= share
    low, span = np.where(uniform, share, 0.0), np.where(uniform, 1 - share, share)
    v = np.stack([(u[:, 0] - low) / span, u[:, 1]], axis=1)
    if name == "rect":
        y[:, :2] = (v - 0.5) * size
    else:
        radius, angle = size[:, 0] * np.sqrt(v[:, 0]), 2 * np.pi * v[:, 1]
        y[:, 0], y[:, 1] = radius * np.cos(angle), radius * np.sin(angle)
    ray = _cosine_directions(normals, v)
    meets = x[:, 2] * ray[:, 2] < 0
    length = -x[:, 2] / np.where(meets, ray[:, 2], 1.0)
    cast = np.flatnonzero(~uniform)
    y[cast] = (x + length[:, None] * ray)[cast]
    y[:, 2] = 0.0
    inside = (
        (np.abs(y[:, :2]) <= size / 2).all(axis=1)
        if name == "rect"
        else np.hypot(y[:, 0], y[:, 1]) <= size[:, 0] * (1 + 1e-12)
    )
    to_y = y - x
    square = np.maximum((to_y**2).sum(axis=1), 1e-300)
    cosine = np.maximum(0.0, (to_y * normals).sum(axis=1)) / np.sqrt(square)
    # Density of both ways over the uniform one's.
    density = 1 - share + share * area * cosine * np.abs(x[:, 2]) / (np.pi * square**1.5)
    lift = np.zeros_like(x)
    lift[:, 2] = np.sign(x[:, 2])  # off a ceiling that it is flush with
    weight = np.where(inside & (uniform | meets), 1.0 / (density * square), 0.0)
    return y, lift, weight


def _sample_sphere(
    name: str, x: Array, normals: Array, size: Array, u: Array
) -> tuple[Array, Array, Array]:
    radius = size[:, 0]
    distance = np.linalg.norm(x, axis=1)
    outside = distance > radius
    distance = np.where(outside, distance, np.inf)
    sine2 = (radius / distance) ** 2
    least = np.sqrt(1 - sine2)  # cosine of the half angle
    from_axis = sine2 / (1 + least) * u[:, 0]  # 1 - cosine: keeps its digits for small spheres
    cosine, sine = 1 - from_axis, np.sqrt(from_axis * (2 - from_axis))
    s, t, w = _frame(-x / np.linalg.norm(x, axis=1, keepdims=True))
    angle = 2 * np.pi * u[:, 1:]
    ray = (s * np.cos(angle) + t * np.sin(angle)) * sine[:, None] + w * cosine[:, None]
    far = np.where(outside, distance, 0.0)
    along = far * cosine - np.sqrt(np.maximum(0.0, radius**2 - (far * sine) ** 2))
    y = x + ray * along[:, None]
    length = np.maximum(np.linalg.norm(y, axis=1, keepdims=True), 1e-300)
    return y, y / length, np.where(outside, 2.0 / (distance**2 * (1 + least)), 0.0)


def _sample_cylinder(
    name: str, x: Array, normals: Array, size: Array, u: Array
) -> tuple[Array, Array, Array]:
    radius, length = size.T
    across = np.hypot(x[:, 1], x[:, 2])
    half = np.arccos(np.minimum(1.0, radius / np.maximum(across, 1e-300)))  # 0: inside
    angle = np.arctan2(x[:, 2], x[:, 1]) + (2 * u[:, 1] - 1) * half
    normal = np.stack([np.zeros_like(angle), np.cos(angle), np.sin(angle)], axis=1)
    y = normal * radius[:, None]
    y[:, 0] = (u[:, 0] - 0.5) * length
    to_x = x - y
    square = (to_x**2).sum(axis=1)
    cosine = np.maximum(0.0, (to_x * normal).sum(axis=1))
    sine = np.hypot(to_x[:, 1], to_x[:, 2])
    weight = half * cosine / np.maximum(sine * square, 1e-300)
    return y, normal, weight


def diagram_intensity(diagram: GoniometricDiagram, directions: Array) -> Array:
    """(n,) cd in local directions (n, 3), bilinear in (gamma, C); 0 outside the gamma range."""
    gamma = np.arctan2(np.hypot(directions[:, 0], directions[:, 1]), -directions[:, 2])
    j, t = _locate(diagram.gamma, gamma)
    inside = (gamma >= diagram.gamma[0] - 1e-9) & (gamma <= diagram.gamma[-1] + 1e-9)
    table = np.asarray(diagram.candela, np.float64)
    if len(diagram.c_angles) == 1:
        between = table[0, j] * (1 - t) + table[0, j + 1] * t
    else:
        c = np.arctan2(directions[:, 1], directions[:, 0]) % (2 * np.pi)
        i, s = _locate(diagram.c_angles, c)
        low = table[i, j] * (1 - s) + table[i + 1, j] * s
        high = table[i, j + 1] * (1 - s) + table[i + 1, j + 1] * s
        between = low * (1 - t) + high * t
    return np.where(inside, between, 0.0)


def diagram_flux(diagram: GoniometricDiagram) -> float:
    """lm, by Gauss-Legendre quadrature in gamma and the trapezoid rule in C, which are exact."""
    nodes, weights = np.polynomial.legendre.leggauss(16)
    low, high = diagram.gamma[:-1, None], diagram.gamma[1:, None]
    t = (nodes + 1) / 2
    table = np.asarray(diagram.candela, np.float64)
    if len(diagram.c_angles) == 1:
        profile = 2 * np.pi * table[0]
    else:
        profile = ((table[1:] + table[:-1]) / 2 * np.diff(diagram.c_angles)[:, None]).sum(axis=0)
    between = profile[:-1, None] * (1 - t) + profile[1:, None] * t
    sine = np.sin(low + (high - low) * t)
    return float((between * sine * weights * (high - low) / 2).sum())


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

    def direct(self, positions: Array, normals: Array, random: np.random.Generator) -> Array:
        """(n, 3) lx by channel: jittered samples of each luminaire."""
        emitters = self._emitters
        # Few luminaires get more samples each.
        strata = int(np.clip(np.sqrt(128 / emitters.count), 1, 8))
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
        directions = _cosine_directions(normals, u)
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
            directions = _cosine_directions(normals, random.random((len(on), 2)))
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


class LuminaireChoice:
    """Probabilities of the luminaires by cell of a grid: by intensity and distance.

    They change the variance alone: none is zero.
    """

    def __init__(self, emitters: Emitters, low: Array, high: Array) -> None:
        n = int(min(GRID_CELLS, (GRID_ENTRIES / emitters.count) ** (1 / 3)))
        self._n, self._low = n, low
        self._cell = np.maximum(high - low, 1e-12 * (high - low).max()) / n
        index = np.stack(np.unravel_index(np.arange(n**3), (n, n, n)), axis=1)
        centres = low + (index + 0.5) * self._cell
        near = (self._cell**2).sum() / 4
        weights = np.empty((n**3, emitters.count))
        for i in range(emitters.count):
            away = centres - emitters._origin[i]
            square = (away**2).sum(axis=1)
            unit = away / np.sqrt(np.maximum(square, 1e-300))[:, None]
            intensity = emitters.intensity(np.full(len(unit), i), unit)
            floor = emitters.flux[i] / (4 * np.pi) / 4
            weights[:, i] = (intensity + floor) / (square + near)
        self._probability = weights / weights.sum(axis=1, keepdims=True)
        cumulative = np.cumsum(self._probability, axis=1)
        cumulative /= cumulative[:, -1:]
        # Rows laid end to end, each a unit higher than the one before.
        self._cumulative = (cumulative + np.arange(n**3)[:, None]).reshape(-1)
        self._count = emitters.count

    def choose(self, x: Array, u: Array) -> tuple[NDArray[np.int64], Array]:
        """Luminaires (n,) for points (n, 3), and the probability of each."""
        i = np.clip(((x - self._low) / self._cell).astype(np.int64), 0, self._n - 1)
        cell = (i[:, 0] * self._n + i[:, 1]) * self._n + i[:, 2]
        place = np.searchsorted(self._cumulative, cell + u, side="right")
        which = np.clip(place - cell * self._count, 0, self._count - 1)
        return which, self._probability[cell, which]


def _at_even_steps(areas: Array, count: int, seed: int) -> NDArray[np.int64]:
    """Vertices at even steps along the summed area."""
    cumulative = np.cumsum(areas)
    shift = np.random.default_rng([seed]).random()
    at = (np.arange(count) + shift) / count * cumulative[-1]
    return np.minimum(np.searchsorted(cumulative, at, side="right"), len(areas) - 1)


def _percentiles(values: Array, weights: Array, shares: Sequence[float]) -> Array:
    order = np.argsort(values)
    return np.interp(shares, np.cumsum(weights[order]), values[order])


def _standard_error(batches: Array) -> Array:
    return batches.std(axis=0, ddof=1) / np.sqrt(len(batches))


def _strata(count: int) -> Array:
    i, j = np.meshgrid(np.arange(count), np.arange(count), indexing="ij")
    return np.stack([i, j], axis=-1).reshape(-1, 2).astype(np.float64)


def _locate(angles: Array, at: Array) -> tuple[NDArray[np.int64], Array]:
    """Interval below each angle and the place in it."""
    i = np.clip(np.searchsorted(angles, at, side="right") - 1, 0, len(angles) - 2)
    return i, np.clip((at - angles[i]) / (angles[i + 1] - angles[i]), 0.0, 1.0)


def _frame(w: Array) -> tuple[Array, Array, Array]:
    """Unit vectors (n, 3) across unit w, and w."""
    x, y, z = w.T
    side = np.where(z < 0, -1.0, 1.0)
    a = -1 / (side + z)
    b = x * y * a
    s = np.stack([1 + side * x * x * a, side * b, -side * x], axis=1)
    return s, np.stack([b, side + y * y * a, -y], axis=1), w


def _cosine_directions(normals: Array, u: Array) -> Array:
    s, t, w = _frame(normals)
    radius, angle = np.sqrt(u[:, :1]), 2 * np.pi * u[:, 1:]
    across = (s * np.cos(angle) + t * np.sin(angle)) * radius
    return across + w * np.sqrt(1 - u[:, :1])


def _digest(
    scene: SceneDescription, positions: Array, normals: Array, parameters: tuple[int, ...]
) -> str:
    """Of all that the numbers depend on."""
    digest = hashlib.sha256(repr(parameters).encode())
    arrays: list[object] = [positions, normals]
    for mesh in scene.meshes:
        arrays += [mesh.points, mesh.face_vertex_counts, mesh.face_vertex_indices]
        arrays += [mesh.hole_faces, mesh.reflectance, mesh.double_sided, mesh.flip_winding]
    for light in scene.luminaires:
        arrays += [light.origin, light.axes, light.size, light.colour, light.luminous_flux]
        digest.update(light.shape.encode())
        if light.diagram is not None:
            arrays += [light.diagram.gamma, light.diagram.c_angles, light.diagram.candela]
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:16]


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("stage", type=Path)
    parser.add_argument("--vertices", type=int, default=1000)
    parser.add_argument("--batches", type=int, default=16)
    parser.add_argument("--strata", type=int, default=32)
    parser.add_argument("--cache", type=Path)
    options = parser.parse_args(arguments)
    scene = read_stage(options.stage)
    core = build_core_scene(scene, SolverSettings(), -1)
    started = time.perf_counter()
    reference = path_traced_reference(
        scene, core, options.vertices, options.batches, options.strata, cache=options.cache
    )
    print(f"{time.perf_counter() - started:.1f} s")
    for name, part in (("direct", DIRECT), ("indirect", INDIRECT), ("total", TOTAL)):
        mean = reference.mean(part)
        print(f"{name:9} mean {mean:.2f} lx, standard error {reference.noise(part):.2%} (RMS)")


if __name__ == "__main__":
    main()
