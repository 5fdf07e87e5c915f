"""Pointwise reference: illuminance at some illumination vertices by path tracing.

    python tools/reference.py STAGE [--vertices M] [--batches B] [--strata S] [--noise R]

It shares the scene description and the bare ray caster with the solver, nothing else: no mesh of
results, no photon, no filter, no code of the luminaires. How it gathers light stands in
`path_tracer.py` and `luminaire_sampling.py`. Independent batches tell the standard error.
"""

from __future__ import annotations

import argparse
import hashlib
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from luminaire_sampling import Array
from numpy.typing import NDArray
from path_tracer import PathTracer, refuse_what_paths_lack

from isolux import _core
from isolux.core_scene import build_core_scene
from isolux.scene_description import SceneDescription
from isolux.settings import SolverSettings
from isolux.solution import LUMINANCE_WEIGHTS
from isolux.stage_reader import read_stage

DIRECT, INDIRECT, TOTAL = (0,), (1,), (0, 1)
# Direct light at the point itself: one shadow ray each, where a path takes several rays. Flat of
# several rooms, 128 samples in a batch: the noise of direct light is twice that of indirect light.
DIRECT_SAMPLES_PER_PATH = 2
# Where a noise is asked for: the most batches, at which the darkest benchmark has 2 %.
MOST_BATCHES = 32
# Of what speeds and convergence are told against: the last goal is an error of 1 %.
REFERENCE_NOISE = 0.01
VERSION = 2  # of what the numbers mean, for the cache


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
    noise: float = math.inf,
    cache: Path | None = None,
) -> PathTracedReference:
    """Trace the reference, or take it from the cache.

    scene, core : as described and as built; the latter only tells where its vertices are
    vertices : M; all where there are no more
    batches : independent, two or more; the least
    strata : along both axes of the cosine-distributed first bounces: a batch has strata²
        paths a vertex
    noise : relative RMS error of the reference itself, down to which batches are added, up to
        MOST_BATCHES
    cache : folder of earlier references, whose batches are taken; None: always trace
    """
    refuse_what_paths_lack(scene)
    areas = core.vertex_areas * (np.abs(core.vertex_normals).max(axis=1) > 0)
    complete = np.count_nonzero(areas) <= vertices
    chosen = np.flatnonzero(areas) if complete else _at_even_steps(areas, vertices, seed)
    weights = areas[chosen] / areas.sum() if complete else np.full(vertices, 1 / vertices)
    positions = np.asarray(core.receiver_positions, np.float64)[chosen]
    normals = np.asarray(core.vertex_normals, np.float64)[chosen]
    known = np.empty((0, len(chosen), 2, 3))
    file = None
    if cache is not None:
        file = (
            cache / f"reference_{_digest(scene, positions, normals, (VERSION, strata, seed))}.npz"
        )
        if file.exists():
            with np.load(file) as cached:
                known = cached["batches"]
    light = known[:batches]
    tracer: PathTracer | None = None
    while True:
        reference = PathTracedReference(chosen, weights, complete, light)
        count = len(light)
        if count >= batches and (count >= MOST_BATCHES or reference.noise(TOTAL) <= noise):
            return reference
        if count == len(known):
            tracer = tracer or PathTracer(scene)
            random = np.random.default_rng([seed, count])
            direct = tracer.direct(positions, normals, DIRECT_SAMPLES_PER_PATH * strata**2, random)
            indirect = tracer.indirect(positions, normals, strata, random)
            known = np.concatenate([known, np.stack([direct, indirect], axis=1)[None]])
            if file is not None:  # each at once: they take long
                file.parent.mkdir(parents=True, exist_ok=True)
                np.savez_compressed(file, vertices=chosen, batches=known)
        light = known[: count + 1]


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
    parser.add_argument("--noise", type=float, default=math.inf, help="as a ratio")
    parser.add_argument("--cache", type=Path)
    options = parser.parse_args(arguments)
    scene = read_stage(options.stage)
    core = build_core_scene(scene, SolverSettings(), -1)
    started = time.perf_counter()
    reference = path_traced_reference(
        scene, core, options.vertices, options.batches, options.strata,
        noise=options.noise, cache=options.cache,
    )  # fmt: skip
    print(f"{time.perf_counter() - started:.1f} s")
    for name, part in (("direct", DIRECT), ("indirect", INDIRECT), ("total", TOTAL)):
        mean = reference.mean(part)
        print(f"{name:9} mean {mean:.2f} lx, standard error {reference.noise(part):.2%} (RMS)")


if __name__ == "__main__":
    main()
