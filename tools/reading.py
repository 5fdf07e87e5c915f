"""Time and memory of reading, building, solving and writing stages of a million faces.

    python tools/reading.py [--faces N] [--turns T] [--photons P] [--threads N] [STAGE ...]

Without stages: the scene `hills` in one mesh, in one mesh with normals, and in 100 meshes. Reading
is measured against usd-core alone, which opens the stage and hands over the arrays that Isolux
reads of its meshes: points, counts, indices, normals, transforms. Crate files hand over points and
normals as views into the file; `in memory` copies those, `as views` leaves them unread.

Each figure comes from a process of its own, warmed up with a small stage; usd-core and Isolux take
turns, so that a machine that slows down favours neither. Ratios are what counts.
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from bench_report import commit, cpu_name, print_table
from numpy.typing import NDArray
from pxr import Usd, UsdGeom
from solve_runs import peak_resident

sys.path.insert(0, str(Path(__file__).parents[1]))  # the scene generators
from usd_scenes.hills.generate import generate

SMALL_FACES = 100  # of the stage that warms a process up
AGAIN = 3  # reads in one process; the middle one counts
SCENES = {
    "one mesh": {"meshes": 1, "normals": False},
    "one mesh, normals": {"meshes": 1, "normals": True},
    "100 meshes": {"meshes": 100, "normals": False},
}
Figures = dict[str, float]


def hand_over(path: str, take: Callable[[object], NDArray] = np.array) -> list[NDArray]:
    """What usd-core gives of all meshes; `take` makes an array of a value."""
    stage = Usd.Stage.Open(path)
    transforms = UsdGeom.XformCache()
    arrays = []
    for prim in Usd.PrimRange(stage.GetPseudoRoot()):
        if not prim.IsA(UsdGeom.Mesh):
            continue
        mesh = UsdGeom.Mesh(prim)
        arrays.append(np.array(transforms.GetLocalToWorldTransform(prim)))
        values = (
            mesh.GetPointsAttr().Get(),
            mesh.GetFaceVertexCountsAttr().Get(),
            mesh.GetFaceVertexIndicesAttr().Get(),
            mesh.GetNormalsAttr().Get(),
        )
        arrays += [take(value) for value in values if value is not None]
    return arrays


def read(path: str) -> object:
    from isolux.stage_reader import read_stage  # not in the process that measures usd-core

    return read_stage(path)


def measure_reading(work: Callable[[str], object], small: str, path: str) -> Figures:
    """Seconds of the median read; bytes of the resident peak beyond what the process held."""
    work(small)
    before = peak_resident(os.getpid())
    seconds, peak = [], 0
    for _ in range(AGAIN):
        started = time.perf_counter()
        held = work(path)
        seconds.append(time.perf_counter() - started)
        peak = peak or peak_resident(os.getpid()) - before
        del held  # not on the time of the next
        gc.collect()
    return {"seconds": sorted(seconds)[AGAIN // 2], "first": seconds[0], "peak": peak}


def measure_run(small: str, path: str, photons: int, threads: int) -> Figures:
    """Phases of one run in their order: seconds, and bytes resident after each."""
    from isolux.results import ResultsWriter
    from isolux.settings import SolverSettings
    from isolux.solver import ProgressiveSolver
    from isolux.stage_opening import open_stage
    from isolux.stage_reader import read_stage

    read_stage(small)
    start = resident()
    clock = time.perf_counter()
    stage = open_stage(path)
    scene = read_stage(stage)
    figures: Figures = {"read": time.perf_counter() - clock, "held by read": resident() - start}
    settings = SolverSettings(threads=threads, photons=photons, stages=1, method="dept")
    solver = ProgressiveSolver(scene, settings)
    figures["build"] = solver.build_seconds
    figures["held by build"] = resident() - start - figures["held by read"]
    core = solver._core_scene
    figures |= {"vertices": core.vertex_count, "elements": core.element_count}
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "out.usda"
        writer = ResultsWriter(stage, output, scene, {})
        clock = time.perf_counter()
        for solution in solver.stages():
            figures["solve"] = time.perf_counter() - clock
            clock = time.perf_counter()
            writer.write(solution)
            figures["write"] = time.perf_counter() - clock
        figures["size"] = sum(file.stat().st_size for file in Path(folder).iterdir())
    figures["peak"] = peak_resident(os.getpid()) - start
    figures["points"] = sum(len(mesh.points) for mesh in scene.meshes)
    return figures


def measure_tree(path: str, threads: int) -> Figures:
    """Bytes that the bare ray tracing tree takes, its triangles included."""
    from isolux import _core
    from isolux.core_scene import mesh_triangles
    from isolux.stage_reader import read_stage

    points, triangles, first = [], [], 0
    for mesh in read_stage(path).meshes:
        corners, _ = mesh_triangles(mesh)
        points.append(mesh.points)
        triangles.append(mesh.face_vertex_indices[corners] + np.int32(first))
        first += len(mesh.points)
    all_points, all_triangles = np.concatenate(points), np.concatenate(triangles)
    before = resident()
    tree = _core.RayCaster(all_points, all_triangles, threads)
    held = resident() - before
    del tree
    return {"tree": held}


def resident() -> int:
    """Bytes that this process holds in memory, pages of mapped files left out."""
    lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith("RssAnon"))


def in_a_process(*arguments: object) -> Figures:
    """This tool's figures of one measurement."""
    command = [sys.executable, __file__, "--measure", *map(str, arguments)]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    return json.loads(done.stdout)


def spread(values: Sequence[float]) -> str:
    low, middle, high = np.quantile(values, [0.25, 0.5, 0.75])
    return f"{middle:.2f} ({low:.2f}–{high:.2f})"


def column(path: Path, small: Path, options: argparse.Namespace) -> dict[str, str]:
    """One stage's figures as text."""
    turns: dict[str, list[Figures]] = {"views": [], "memory": [], "isolux": []}
    for _ in range(options.turns):
        for name, figures in turns.items():
            figures.append(in_a_process(name, small, path))
    seconds = {name: [turn["seconds"] for turn in all_] for name, all_ in turns.items()}
    first = {name: [turn["first"] for turn in all_] for name, all_ in turns.items()}
    run = in_a_process("run", small, path, options.photons, options.threads)
    tree = in_a_process("tree", path, options.threads)["tree"]
    points, vertices, elements = run["points"], run["vertices"], run["elements"]

    def ratio(of: dict[str, list[float]], to: str) -> str:
        return spread(np.divide(of["isolux"], of[to]))

    return {
        "points, illumination vertices, elements": f"{points:,}, {vertices:,}, {elements:,}",
        "usd-core hands over in memory, ms": spread(np.multiply(seconds["memory"], 1e3)),
        "as views, ms": spread(np.multiply(seconds["views"], 1e3)),
        "read_stage, ms": spread(np.multiply(seconds["isolux"], 1e3)),
        "read_stage / in memory": ratio(seconds, "memory"),
        "read_stage / as views": ratio(seconds, "views"),
        "first read of a process / in memory": ratio(first, "memory"),
        "bytes a point: usd-core at its peak": f"{turns['memory'][0]['peak'] / points:.0f}",
        "read_stage at its peak": f"{turns['isolux'][0]['peak'] / points:.0f}",
        "scene as read": f"{run['held by read'] / points:.0f}",
        "build, s": f"{run['build']:.2f}",
        "bytes an element: scene as built": f"{run['held by build'] / elements:.0f}",
        "of them Embree's": f"{tree / elements:.0f}",
        f"solve with {options.photons:,} photons, s": f"{run['solve']:.2f}",
        "write, s": f"{run['write']:.2f}",
        "results, MiB": f"{run['size'] / 2**20:.0f}",
        "peak memory of the run, MiB": f"{run['peak'] / 2**20:.0f}",
        "the same, bytes an element": f"{run['peak'] / elements:.0f}",
    }


def measure(name: str, *arguments: str) -> Figures:
    """What a process of its own does."""
    if name == "run":
        small, path, photons, threads = arguments
        return measure_run(small, path, int(photons), int(threads))
    if name == "tree":
        path, threads = arguments
        return measure_tree(path, int(threads))
    work = {"memory": hand_over, "views": lambda path: hand_over(path, np.asarray), "isolux": read}
    return measure_reading(work[name], *arguments)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("stages", nargs="*", type=Path, metavar="STAGE")
    parser.add_argument("--faces", type=int, default=1_000_000)
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--photons", type=int, default=1_000_000)
    parser.add_argument("--threads", type=int, default=len(os.sched_getaffinity(0)))
    options = parser.parse_args(arguments)

    print(f"{cpu_name()}, {options.threads} threads, commit {commit()}")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        small = folder / "small.usdc"
        generate(small, SMALL_FACES, normals=True)
        stages = {path.stem: path for path in options.stages}
        if not stages:
            for scene, parameters in SCENES.items():
                stages[scene] = folder / f"{scene}.usdc"
                generate(stages[scene], options.faces, **parameters)
        columns = {scene: column(path, small, options) for scene, path in stages.items()}
    rows = [[name, *(of[name] for of in columns.values())] for name in next(iter(columns.values()))]
    print_table("Median (quartiles)", ["", *columns], rows)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--measure"]:
        print(json.dumps(measure(*sys.argv[2:])))
    else:
        main()
