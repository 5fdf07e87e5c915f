"""Error of indirect light against processor time: filtered photons, buckets, final gather.

    python tools/gather_study.py STAGE... [--vertices M]

The truth is path-traced at vertices drawn by area; errors are relative to the mean indirect
illuminance, "of total" to the mean of all light. Seconds are of one thread, photons included,
direct light left out.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from reference import INDIRECT, TOTAL, path_traced_reference

from isolux import _core
from isolux.components import DirectLight
from isolux.settings import SolverSettings
from isolux.solution import LUMINANCE_WEIGHTS
from isolux.solver import build_core_scene
from isolux.stage_reader import read_stage

PHOTONS = (30_000, 100_000, 300_000, 1_000_000)
RAYS = (30_000, 100_000, 300_000, 1_000_000, 3_000_000)


def study(stage: Path, vertices: int, cache: Path | None) -> None:
    scene = read_stage(stage)
    core = build_core_scene(scene, SolverSettings(), -1)
    reference = path_traced_reference(scene, core, vertices, batches=8, strata=16, cache=cache)
    indirect = float(np.mean(reference.luminance_pair(INDIRECT)[0]))
    share = indirect / float(np.mean(reference.luminance_pair(TOTAL)[0]))
    areas = core.vertex_areas
    print(f"\n{stage.name}: {core.vertex_count} vertices, {share:.0%} of the light is indirect")
    print("method    photons      rays  seconds  indirect  of total  reported")

    direct, _ = DirectLight(core, SolverSettings(), 1).at_vertices(
        np.zeros(core.vertex_count, np.float32), lambda share: None
    )

    def row(method: str, photons: int, found: dict, values: np.ndarray, seconds: float) -> None:
        error = reference.error(np.zeros_like(values), values, INDIRECT).rms
        mean = float(areas @ (values @ LUMINANCE_WEIGHTS) / areas.sum())
        reported = found.get("rms_error_indirect", found.get("indirect_rms", 0.0) / mean)
        print(
            f"{method:8}{photons:9}{found.get('rays', 0):10}"
            f"{seconds:9.2f}{error:10.2%}{error * share:10.2%}{reported:10.2%}",
            flush=True,
        )

    for photons in PHOTONS:
        started = time.process_time()
        buckets = _core.PhotonBuckets(core)
        _core.trace_photons(core, buckets, 1, 0, photons, 1)
        traced = time.process_time() - started
        light = buckets.illuminance(core)
        row("buckets", photons, {}, light[:, 1], traced)
        started = time.process_time()
        lighting = _core.IlluminationFilter(core)
        filtered = lighting.filter(core, buckets, 0.05, 0.25, False, 1)
        seconds = traced + time.process_time() - started
        row("filter", photons, filtered, filtered["indirect"], seconds)
        total = np.ascontiguousarray(light.sum(axis=1))
        in_buckets = np.ascontiguousarray(light[:, 1])
        for rays in RAYS:
            started = time.process_time()
            gather = _core.FinalGather(core, 1)
            flux = core.luminous_flux / photons
            found = gather.advance(total, rays, 1, in_buckets, flux, direct)
            seconds = traced + time.process_time() - started
            row("gather", photons, found, found["indirect"], seconds)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("stages", type=Path, nargs="+", metavar="STAGE")
    parser.add_argument("--vertices", type=int, default=2000, help="of the reference")
    parser.add_argument("--cache", type=Path, help="folder of earlier references")
    options = parser.parse_args()
    for stage in options.stages:
        study(stage, options.vertices, options.cache)


if __name__ == "__main__":
    main()
