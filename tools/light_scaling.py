"""Cost and error of direct light by the number of luminaires, in the hall: a table and its slope.

    python tools/light_scaling.py [--accuracy A] [--density D] [--threads N] [--receivers R]
                                   [--alone]

All vertices are lit, beside the indirect light of a photon pilot, as the composite solver does; or
alone. The error, relative to the mean of all light that was there, is that of so many vertices
against every luminaire's own light: a few luminaires at a time and with shadow rays enough, so that
no light tree has a part in it.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from isolux import _core
from isolux.scene_description import SceneDescription
from isolux.settings import SolverSettings
from isolux.solution import LUMINANCE_WEIGHTS
from isolux.solver import build_core_scene
from isolux.stage_reader import read_stage

sys.path.insert(0, str(Path(__file__).parents[1]))  # the scene generators
from usd_scenes.hall.generate import generate

COUNTS = (10, 100, 1000, 2600)
ONE_BY_ONE = 32  # luminaires that DirectLighting takes without a light tree
PILOT_PHOTONS = 200_000
REFERENCE_ACCURACY = 0.1  # of the accuracy measured

NOTHING = np.zeros(0, np.float32)


def brute_force(
    scene: SceneDescription,
    positions: NDArray[np.float64],
    normals: NDArray[np.float32],
    accuracy: float,
    threads: int,
) -> NDArray[np.float64]:
    """(R,) lx: the sum over all luminaires, each with its own shadow rays."""
    total = np.zeros(len(positions))
    for first in range(0, len(scene.luminaires), ONE_BY_ONE):
        some = scene.luminaires[first : first + ONE_BY_ONE]
        core = build_core_scene(replace(scene, luminaires=some), SolverSettings(), threads)
        # Errors of the parts are independent, and each part's are relative to its own light.
        found = _core.DirectLighting(core, 1000 + first, accuracy).illuminate(
            positions, normals, NOTHING, threads
        )
        total += found["illuminance"] @ LUMINANCE_WEIGHTS
    return total


def pilot_indirect(core: _core.Scene, threads: int) -> NDArray[np.float32]:
    """(V,) lx: indirect light by photon tracing, filtered with the default settings."""
    settings = SolverSettings()
    buckets = _core.PhotonBuckets(core)
    _core.trace_photons(core, buckets, 0, 0, PILOT_PHOTONS, threads)
    filtered = _core.IlluminationFilter(core).filter(
        core, buckets, settings.filter_accuracy, settings.filter_sharing, False, threads
    )
    return np.asarray(filtered["indirect"] @ LUMINANCE_WEIGHTS, np.float32)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Cost of direct light by number of luminaires.")
    parser.add_argument("--accuracy", type=float, default=0.01)
    parser.add_argument("--density", type=float, default=1.0, help="of the hall's mesh")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--receivers", type=int, default=1000, help="compared with brute force")
    parser.add_argument("--alone", action="store_true", help="no indirect light beside")
    arguments = parser.parse_args()

    print("| luminaires | CPU s | wall s | shadow rays | a vertex | true RMS error | reported |")
    print("|---|---|---|---|---|---|---|")
    seconds, rays = [], []
    for count in COUNTS:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "hall.usdc"
            generate(path, count, arguments.density)
            scene = read_stage(path)
        core = build_core_scene(scene, SolverSettings(), arguments.threads)
        lit = np.flatnonzero(core.vertex_normals.any(axis=1))
        positions, normals = core.receiver_positions[lit], core.vertex_normals[lit]
        areas = core.vertex_areas[lit]
        indirect = NOTHING if arguments.alone else pilot_indirect(core, arguments.threads)[lit]
        clock, start = time.process_time(), time.perf_counter()
        found = _core.DirectLighting(core, 1, arguments.accuracy).illuminate(
            positions, normals, indirect, arguments.threads
        )
        seconds.append(time.process_time() - clock)
        rays.append(found["shadow_rays"])
        wall = time.perf_counter() - start

        rng = np.random.default_rng(1)
        some = rng.choice(len(lit), min(arguments.receivers, len(lit)), replace=False)
        truth = brute_force(
            scene,
            positions[some],
            normals[some],
            REFERENCE_ACCURACY * arguments.accuracy,
            arguments.threads,
        )
        error = found["illuminance"][some] @ LUMINANCE_WEIGHTS - truth
        total = truth if arguments.alone else truth + indirect[some]
        mean = np.average(total, weights=areas[some])
        true, reported = (
            np.sqrt(np.average(np.square(e, dtype=float), weights=areas[some])) / mean
            for e in (error, found["standard_error"][some])
        )
        print(
            f"| {count} | {seconds[-1]:.2f} | {wall:.2f} | {found['shadow_rays']:,} "
            f"| {found['shadow_rays'] / len(lit):.0f} | {true:.2%} | {reported:.2%} |",
            flush=True,
        )
    slopes = [np.polyfit(np.log(COUNTS), np.log(cost), 1)[0] for cost in (seconds, rays)]
    print(
        f"\n{len(lit):,} vertices; CPU seconds grow with the luminaires to the {slopes[0]:.2f}, "
        f"shadow rays to the {slopes[1]:.2f}"
    )


if __name__ == "__main__":
    main()
