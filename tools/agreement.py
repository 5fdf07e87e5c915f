"""Do all methods find the same indirect light? Each against path tracing, in three scenes.

    python tools/agreement.py [--scenes NAME,NAME] [--photons N] [--vertices M]
        [--cache FOLDER]

The truth is pointwise: at vertices of a fine tessellation, drawn by area. Photons, filtered, and
the gather of the composite solve the fine tessellation; radiosity, meant for few polygons, solves
a coarse one of the same surfaces and is asked for its light at the same points. Each method has a
seed of its own. Errors are relative to the mean indirect illuminance.

A photon's bucket holds the light of an area, which differs from that at the vertex most where
something stands on an element; this part shrinks with the elements alone.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from bench_report import commit, cpu_name, print_table
from numpy.typing import NDArray
from reference import INDIRECT, path_traced_reference

from isolux import _core
from isolux.components import DIRECT_ACCURACY
from isolux.core_scene import build_core_scene
from isolux.scene_description import SceneDescription
from isolux.settings import Method, SolverSettings
from isolux.solution import LUMINANCE_WEIGHTS
from isolux.solver import ProgressiveSolver
from isolux.stage_reader import read_stage

sys.path.insert(0, str(Path(__file__).parents[1]))  # the scene generators
from usd_scenes.box_room.generate import expected_illuminance
from usd_scenes.box_room.generate import generate as generate_box_room
from usd_scenes.cornell_box.generate import generate as generate_cornell_box
from usd_scenes.study.generate import COARSE_STEP
from usd_scenes.study.generate import generate as generate_study

BOX_REFLECTANCE = 0.5
# Few photons in a bucket are joined with their neighbours until within this: noise as low as bias.
FILTER_ACCURACY = 0.01
# The gather needs no more photons than this; they stand for 10 rays each.
GATHER_PHOTONS = 1_000_000
RADIOSITY_ACCURACY = 0.01
# Below so many it is the faster way to the indirect light, by the paper [Volevich 2000, §3.2].
RADIOSITY_POLYGONS = 500

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Room:
    """One scene in two tessellations of the same surfaces.

    coarse, fine : write a stage
    expected : mean indirect illuminance in closed form, lx; 0: there is none
    """

    coarse: Callable[[Path], None]
    fine: Callable[[Path], None]
    expected: float = 0.0


ROOMS = {
    "box_room": Room(
        lambda path: generate_box_room(path, BOX_REFLECTANCE, cells=4),
        lambda path: generate_box_room(path, BOX_REFLECTANCE, cells=32),
        expected_illuminance(BOX_REFLECTANCE)[1],
    ),
    "cornell_box": Room(
        lambda path: generate_cornell_box(path, density=0.1),
        lambda path: generate_cornell_box(path, density=2.0),
    ),
    "study": Room(
        lambda path: generate_study(path, COARSE_STEP),
        generate_study,
    ),
}


@dataclass(frozen=True, slots=True)
class Outcome:
    """Indirect light of one method.

    indirect : (V, 3) lx at the vertices, at those of the reference at least
    reported_error : relative RMS error as the method itself tells it
    spent : photons and rays, in words
    """

    indirect: Array
    reported_error: float
    spent: str


def by_solver(
    scene: SceneDescription, method: Method, seed: int, photons: int, threads: int
) -> Outcome:
    """The last stage of a run."""
    settings = SolverSettings(
        method=method, seed=seed, stages=3, threads=threads, filter_accuracy=FILTER_ACCURACY
    )
    solver = ProgressiveSolver(scene, settings.with_budget(photons=photons))
    *_, solution = solver.stages()
    stage = solution.stage
    spent = f"{stage.photons:,} photons"
    if stage.indirect_rays:
        spent += f", {stage.indirect_rays:,} gathered rays"
    return Outcome(solution.indirect.astype(np.float64), stage.rms_error_indirect, spent)


def by_radiosity(
    scene: SceneDescription, fine: _core.Scene, vertices: NDArray[np.int64], seed: int, threads: int
) -> Outcome:
    """HPR of a coarse scene, at vertices of a fine one."""
    core = build_core_scene(scene, SolverSettings(), threads)
    radiosity = _core.ProgressiveRadiosity(core, seed, RADIOSITY_ACCURACY)
    positions, normals = radiosity.receivers()
    none = np.zeros(len(positions), np.float32)
    lighting = _core.DirectLighting(core, seed, DIRECT_ACCURACY)
    radiosity.begin(lighting.illuminate(positions, normals, none, threads)["illuminance"])
    progress = radiosity.advance(2**60, threads)
    found = radiosity.indirect(
        np.ascontiguousarray(fine.receiver_positions[vertices]),
        np.ascontiguousarray(fine.vertex_normals[vertices]),
        threads,
    )
    indirect = np.zeros((fine.vertex_count, 3))
    indirect[vertices] = found["illuminance"]
    mean = float((found["illuminance"] @ LUMINANCE_WEIGHTS).mean())
    rms = float(np.sqrt((found["standard_error"].astype(np.float64) ** 2).mean()))
    polygons = sum(len(mesh.face_vertex_counts) for mesh in scene.meshes)
    rays = progress["rays"] + found["rays"]
    spent = f"{polygons} polygons, {len(none):,} leaves, {rays:,} rays"
    return Outcome(indirect, rms / mean, spent)


def compare(
    name: str, photons_per_vertex: int, vertices: int, strata: int, threads: int, cache: Path
) -> list[list[str]]:
    """Rows of one scene; their columns are those of `main`."""
    room = ROOMS[name]
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / f"{which}.usdc" for which in ("coarse", "fine")]
        room.coarse(paths[0])
        room.fine(paths[1])
        coarse, fine = map(read_stage, paths)
    assert sum(len(mesh.face_vertex_counts) for mesh in coarse.meshes) < RADIOSITY_POLYGONS
    core = build_core_scene(fine, SolverSettings(), threads)
    truth = path_traced_reference(fine, core, vertices, strata=strata, cache=cache)
    sample = f"{len(truth.vertices):,} of {core.vertex_count:,} vertices"
    rows = [
        [
            name, "path tracing", f"{truth.mean(INDIRECT):.2f}",
            f"noise {truth.noise(INDIRECT):.2%}", "", "", "",
            f"{sample}, {len(truth.batches) * strata**2:,} paths each", "",
        ]
    ]  # fmt: skip
    if room.expected:
        rows.append([name, "closed form", f"{room.expected:.2f}", *[""] * 6])
    photons = photons_per_vertex * core.vertex_count
    gathered = min(photons, GATHER_PHOTONS)
    methods: dict[str, Callable[[], Outcome]] = {
        "HPR": lambda: by_radiosity(coarse, core, truth.vertices, 1, threads),
        "DEPT": lambda: by_solver(fine, "dept", 2, photons, threads),
        "IDEPT": lambda: by_solver(fine, "ddl+idept", 3, photons, threads),
        "composite": lambda: by_solver(fine, "composite", 4, gathered, threads),
    }
    for method, run in methods.items():
        started = time.process_time()
        outcome = run()
        seconds = time.process_time() - started
        error = truth.error(np.zeros_like(outcome.indirect), outcome.indirect, INDIRECT)
        own = float(truth.weights @ (outcome.indirect[truth.vertices] @ LUMINANCE_WEIGHTS))
        rows.append(
            [
                name, method, f"{own:.2f}", f"{error.rms:.2%} ± {error.error_bar:.2%}",
                f"{error.median:.2%}", f"{error.percentile_95:.2%}",
                f"{outcome.reported_error:.2%}", outcome.spent, f"{seconds:.0f}",
            ]
        )  # fmt: skip
        print(f"{name}, {method}: {error.rms:.2%}", file=sys.stderr, flush=True)
    return rows


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--scenes", default=",".join(ROOMS), help="comma-separated")
    parser.add_argument(
        "--photons", type=int, default=1600, help="of DEPT and of IDEPT, for each vertex"
    )
    parser.add_argument("--vertices", type=int, default=4000, help="of the reference")
    parser.add_argument("--strata", type=int, default=16, help="16 strata² paths a vertex")
    parser.add_argument("--threads", type=int, default=1)
    folder = Path(__file__).parents[1] / "build/bench"
    parser.add_argument("--cache", type=Path, default=folder, help="folder of references")
    options = parser.parse_args(arguments)
    names = options.scenes.split(",")
    if unknown := set(names) - set(ROOMS):
        parser.error(f"no scene {', '.join(unknown)}; there are {', '.join(ROOMS)}")
    rows = [
        row
        for name in names
        for row in compare(
            name, options.photons, options.vertices, options.strata, options.threads, options.cache
        )
    ]
    columns = [
        "scene", "method", "mean, lx", "relative RMS", "median", "95 %", "reported", "of", "CPU s",
    ]  # fmt: skip
    print_table(
        "Indirect light against path tracing at the vertices of a fine tessellation, area-weighted "
        f"({cpu_name()}, {options.threads} threads, commit {commit()})",
        columns,
        rows,
    )
    print(
        "\nThe noise of path tracing is taken out of the RMS, but not of median and 95 %; ± is the "
        "standard\nerror of the RMS by the choice of vertices."
    )


if __name__ == "__main__":
    main()
