"""How the cost of each component grows with elements, luminaires and photons: log-log slopes.

    python tools/cost_slopes.py [--threads N] [--quick]

elements    the office at several densities: building, a million photons, a filter over as many
            photons as vertices, direct light and a gather of a few rays at all vertices
luminaires  the hall with ever more of them and the same flux in all: direct light at all vertices
            to the same accuracy (tools/light_scaling.py holds that against the truth)
photons     the office: tracing, and one filter over them

Processor seconds, so that other work on the machine matters little.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from bench_report import print_table
from light_scaling import NOTHING
from light_scaling import generate as generate_hall
from usd_scenes.office.generate import generate as generate_office

from isolux import _core
from isolux.components import (
    FIRST_DIRECT_ACCURACY,
    DirectLight,
    FinalGather,
    PhotonTracing,
    photometric,
)
from isolux.composite import LEAST_GATHER_RAYS
from isolux.core_scene import build_core_scene
from isolux.settings import SolverSettings
from isolux.stage_reader import read_stage


@dataclass(frozen=True, slots=True)
class Ranges:
    """Where the costs are taken.

    densities : of the office: 0.3 has 22,000 triangles, 1 has 103,000, 3.45 has 1,014,000
    luminaires : of the hall
    photons : in the office; the middle one also for all densities
    """

    densities: tuple[float, ...]
    luminaires: tuple[int, ...]
    photons: tuple[int, ...]


QUICK = Ranges((0.3, 1.0), (10, 100), (10**5, 10**6))
FULL = Ranges((0.3, 1.0, 1.9, 3.45), (10, 30, 100, 300, 1000), (10**5, 10**6, 10**7))


def cpu_seconds(work: Callable[[], object], turns: int = 1) -> float:
    """The least of so many turns."""
    taken = []
    for _ in range(turns):
        started = time.process_time()
        work()
        taken.append(time.process_time() - started)
    return min(taken)


def component_seconds(path: Path, photons: int, threads: int) -> tuple[int, dict[str, float]]:
    """Elements of a stage, and what each component takes of the processor's time on it."""
    scene, settings = read_stage(path), SolverSettings(threads=threads)
    out = {"build": cpu_seconds(lambda: build_core_scene(scene, settings, threads), turns=3)}
    core = build_core_scene(scene, settings, threads)
    out["photons"] = cpu_seconds(lambda: PhotonTracing(core, settings, threads).trace(photons))
    pilot = PhotonTracing(core, settings, threads)
    pilot.trace(core.vertex_count)
    out["filter"] = cpu_seconds(pilot.filtered)
    indirect = photometric(pilot.filtered()[0].indirect)
    lighting = DirectLight(core, settings, threads)
    lighting.aim_at(FIRST_DIRECT_ACCURACY)
    found = []
    out["direct light"] = cpu_seconds(
        lambda: found.append(lighting.at_vertices(indirect, lambda share: None))
    )
    direct, rays = found[0][0], LEAST_GATHER_RAYS * core.vertex_count
    out["gather"] = cpu_seconds(
        lambda: FinalGather(core, settings, threads).gather(pilot, direct, rays)
    )
    return core.element_count, out


def photon_seconds(path: Path, photons: int, threads: int) -> dict[str, float]:
    """What so many photons and a filter over them take of the processor's time."""
    scene, settings = read_stage(path), SolverSettings(threads=threads)
    tracing = PhotonTracing(build_core_scene(scene, settings, threads), settings, threads)
    return {
        "photons": cpu_seconds(lambda: tracing.trace(photons)),
        "filter": cpu_seconds(tracing.filtered),
    }


def luminaire_seconds(path: Path, threads: int) -> dict[str, float]:
    """What direct light at all vertices takes, beside no other light."""
    core = build_core_scene(read_stage(path), SolverSettings(), threads)
    receivers = core.receiver_positions, core.vertex_normals, NOTHING, threads
    lighting = _core.DirectLighting(core, 0, FIRST_DIRECT_ACCURACY)
    return {"direct light": cpu_seconds(lambda: lighting.illuminate(*receivers))}


def print_slopes(title: str, counts: Sequence[int], seconds: Sequence[dict[str, float]]) -> None:
    """A row a component: its seconds at each count, and the slope of all by least squares."""
    rows = []
    for name in seconds[0]:
        costs = [each[name] for each in seconds]
        slope = np.polyfit(np.log(counts), np.log(costs), 1)[0]
        rows.append([name, *(f"{cost:.2f}" for cost in costs), f"{slope:.2f}"])
    print_table(title, ["CPU seconds", *(f"{count:,}" for count in counts), "slope"], rows)


def measure_slopes(ranges: Ranges, threads: int) -> None:
    """The three tables."""
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "stage.usdc"
        middle = ranges.photons[len(ranges.photons) // 2]
        by_elements = []
        for density in ranges.densities:
            generate_office(path, density)
            by_elements.append(component_seconds(path, middle, threads))
        print_slopes(
            f"Cost against elements (office; {middle:,} photons)", *zip(*by_elements, strict=True)
        )
        by_luminaires = []
        for count in ranges.luminaires:
            generate_hall(path, count)
            by_luminaires.append(luminaire_seconds(path, threads))
        print_slopes(
            f"Cost against luminaires (hall; to {FIRST_DIRECT_ACCURACY:.0%})",
            ranges.luminaires,
            by_luminaires,
        )
        generate_office(path)
        by_photons = [photon_seconds(path, count, threads) for count in ranges.photons]
        print_slopes("Cost against photons (office)", ranges.photons, by_photons)


def main(arguments: Sequence[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--quick", action="store_true", help="two counts of each, half a minute")
    options = parser.parse_args(arguments)
    measure_slopes(QUICK if options.quick else FULL, options.threads)


if __name__ == "__main__":
    main()
