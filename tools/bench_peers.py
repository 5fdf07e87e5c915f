"""Error against time: our solver beside other programs, on the same stages, in one run.

    python tools/bench_peers.py STAGE... [--peers P,P] [--threads N] [--seconds S]
        [--time-budgets S,S] [--cpu-time] [--csv FILE] [--figure FILE] [--cache FOLDER]
    python tools/bench_peers.py STAGE... --agreement FILE [--peers P,P] [--cache FOLDER]
    python tools/bench_peers.py --from CSV [--figure FILE]

Compared is the total illuminance at all illumination vertices: relative RMS error of luminance,
weighted by area, against a path-traced reference at 1000 of them. Each peer runs at rising
qualities, about four times the work each, while the next is expected to fit S seconds of solving;
one whose lowest takes four times as long is left out. Ours runs once for each time budget, with a
seed of its own; a longer one is left out where a shorter one was exact enough.
With --agreement the peers are asked at the reference's vertices alone, twice, at qualities where
their noise is low: two must agree with the reference, or an adapter is wrong.
"""

from __future__ import annotations

import argparse
import csv
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import get_type_hints

import numpy as np
from bench_report import commit, cpu_name, print_table
from convergence import error_curve
from peers.agreement import QUANTITY, agreement
from peers.export import export_scene, lit_vertices
from peers.figure import plot_errors
from peers.peer_process import NAMES, QUALITIES, PeerProcess, Seconds
from peers.peer_scene import LackingError, PeerScene
from peers.time_to_error import Place, slowest, time_to
from reference import REFERENCE_NOISE, TOTAL, PathTracedReference, path_traced_reference

from isolux import _core
from isolux.core_scene import build_core_scene
from isolux.scene_description import SceneDescription
from isolux.settings import SolverSettings
from isolux.stage_reader import read_stage

OURS = "isolux"
GOALS = (0.05, 0.02, 0.01)
ENOUGH = 0.0075  # below the last goal; no higher quality is tried
LONGEST_FIRST_RUN = 4.0  # times the seconds that a run may take
# Samples of each of two runs for the agreement, at 1000 points: minutes of one core a scene.
AGREEMENT_QUALITIES = {
    "mitsuba": 4096,
    "cycles": 4096,
    "luxcore": 4096,
    "radiance": 256,
    "radiance-cached": 1024,
}


@dataclass(frozen=True, slots=True)
class Point:
    """One run; of ours, one progressive stage. Errors as ratios.

    settings : of the peer, its quality; of ours, the component
    start_seconds : imports and reading
    whole_seconds : start, build and solve, as a process that does this run alone
    """

    scene: str
    triangles: int
    vertices: int
    program: str
    settings: str
    seed: int
    start_seconds: float
    build_seconds: float
    solve_seconds: float
    whole_seconds: float
    rms_error: float
    error_bar: float
    median_error: float
    percentile_95_error: float


@dataclass(frozen=True, slots=True)
class Subject:
    """A stage, and what is known of it."""

    name: str
    path: Path
    scene: SceneDescription
    core: _core.Scene
    reference: PathTracedReference

    @property
    def places(self) -> np.ndarray:
        """Of the reference's vertices among those that peers are asked for."""
        return np.searchsorted(lit_vertices(self.core), self.reference.vertices)


def read_subject(path: Path, cache: Path) -> Subject:
    scene = read_stage(path)
    core = build_core_scene(scene, SolverSettings(), -1)
    reference = path_traced_reference(scene, core, noise=REFERENCE_NOISE, cache=cache)
    print(
        f"{path.stem}: {core.element_count:,} triangles, {core.vertex_count:,} vertices; "
        f"reference noise {reference.noise(TOTAL):.2%}",
        flush=True,
    )
    return Subject(path.stem, path, scene, core, reference)


def measure_ours(subject: Subject, settings: SolverSettings, cpu_time: bool) -> list[Point]:
    """The progressive stages of one run."""
    clock = time.process_time if cpu_time else time.perf_counter
    began = clock()
    read_stage(subject.path)
    start = clock() - began + _import_seconds(cpu_time)
    curve = error_curve(subject.name, subject.scene, subject.reference, settings, clock)
    return [
        Point(
            scene=subject.name,
            triangles=subject.core.element_count,
            vertices=subject.core.vertex_count,
            program=OURS,
            settings=point.component,
            seed=settings.seed,
            start_seconds=start,
            build_seconds=point.build_seconds,
            solve_seconds=point.seconds,
            whole_seconds=start + point.build_seconds + point.seconds,
            rms_error=point.true_error,
            error_bar=point.error_bar,
            median_error=point.median_error,
            percentile_95_error=point.percentile_95_error,
        )
        for point in curve
    ]


def _import_seconds(cpu_time: bool) -> float:
    """Of a Python that imports the solver."""
    code = "import isolux.solver, isolux.stage_reader, time; print(time.process_time())"
    began = time.perf_counter()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return float(done.stdout) if cpu_time else time.perf_counter() - began


def measure_peer(
    subject: Subject,
    peer: str,
    python: str,
    threads: int,
    seconds: float,
    cpu_time: bool,
) -> list[Point]:
    """At rising qualities, until the error is small enough or the next would take too long."""
    of: Callable[[Seconds], float] = (lambda s: s.processor) if cpu_time else (lambda s: s.wall)
    points: list[Point] = []
    exported = export_scene(subject.scene, subject.core)
    places = subject.places
    with PeerProcess(peer, exported, threads, python) as process:
        for number, quality in enumerate(QUALITIES[peer]):
            if points:
                ratio = quality / QUALITIES[peer][number - 1]
                expected = points[-1].solve_seconds * ratio
                if expected > seconds or points[-1].rms_error < ENOUGH:
                    break
            longest = LONGEST_FIRST_RUN * seconds
            values, spent = process.illuminance(quality, number, longest)
            full = np.zeros((subject.core.vertex_count, 3))
            full[subject.reference.vertices] = values[places]
            error = subject.reference.error(full, np.zeros_like(full), TOTAL)
            points.append(
                Point(
                    scene=subject.name,
                    triangles=subject.core.element_count,
                    vertices=subject.core.vertex_count,
                    program=peer,
                    settings=str(quality),
                    seed=number,
                    start_seconds=of(process.start),
                    build_seconds=of(process.build),
                    solve_seconds=of(spent),
                    whole_seconds=of(process.start) + of(process.build) + of(spent),
                    rms_error=error.rms,
                    error_bar=error.error_bar,
                    median_error=error.median,
                    percentile_95_error=error.percentile_95,
                )
            )
            print(f"  {peer} {quality}: {of(spent):.1f} s, {error.rms:.2%}", flush=True)
    return points


def at_reference(subject: Subject) -> PeerScene:
    """The scene, asked at the reference's vertices alone."""
    scene = export_scene(subject.scene, subject.core)
    places = subject.places
    return replace(scene, positions=scene.positions[places], normals=scene.normals[places])


def write_agreement(
    path: Path, subjects: Sequence[Subject], peers: Sequence[str], python: str
) -> None:
    """One row a scene and peer; rows of other scenes and peers that are there stay."""
    columns = [
        "scene", "program", "quantity", "samples", "mean_ratio", "mean_error_bar", "rms_difference",
        "error_bar", "noise", "within", "commit",
    ]  # fmt: skip
    rows: dict[tuple[str, str], dict[str, str]] = {}
    if path.exists():
        with path.open(newline="", encoding="utf-8") as file:
            rows = {(row["scene"], row["program"]): row for row in csv.DictReader(file)}
    path.parent.mkdir(parents=True, exist_ok=True)
    made_by = commit()  # what was loaded, whatever the checkout becomes meanwhile
    for subject in subjects:
        asked = at_reference(subject)
        for peer in peers:
            quality = AGREEMENT_QUALITIES[peer]
            try:
                with PeerProcess(peer, asked, 1, python) as process:
                    runs = [process.illuminance(quality, seed)[0] for seed in (1, 2)]
            except LackingError as lacking:
                print(f"  {subject.name}, {peer}: left out: {lacking}", flush=True)
                continue
            found = agreement((runs[0], runs[1]), subject.reference)
            values = {name: f"{value:.5f}" for name, value in asdict(found).items()}
            within = "yes" if found.within else "no"
            key = {"scene": subject.name, "program": NAMES[peer], "quantity": QUANTITY}
            rows[key["scene"], key["program"]] = {
                **key, "samples": str(2 * quality), **values, "within": within,
                "commit": made_by,
            }  # fmt: skip
            print(f"  {subject.name}, {peer}: {found}, within: {within}", flush=True)
            with path.open("w", newline="", encoding="utf-8") as file:
                table = csv.DictWriter(file, columns, lineterminator="\n")
                table.writeheader()
                table.writerows(rows.values())


def runs(points: Sequence[Point], scene: str, program: str) -> list[list[Place]]:
    """Seconds of building and solving, and errors: of ours by seed, of a peer by its quality."""
    by_seed: dict[int, list[Place]] = {}
    for point in points:
        if (point.scene, point.program) == (scene, program) and point.rms_error > 0:
            place = Place(point.build_seconds + point.solve_seconds, point.rms_error)
            by_seed.setdefault(point.seed if program == OURS else 0, []).append(place)
    return list(by_seed.values())


def print_times(points: Sequence[Point]) -> None:
    """Times to the goals, and how many times sooner ours are there than the fastest peer.

    Ours is the slowest seed.
    """
    rows = []
    for scene in dict.fromkeys(point.scene for point in points):
        programs = dict.fromkeys(point.program for point in points if point.scene == scene)
        for goal in GOALS:
            times = {p: slowest(goal, runs(points, scene, p), p) for p in programs}
            ours = times.pop(OURS, None)
            by_seed = [time_to(goal, run, OURS) for run in runs(points, scene, OURS)]
            known = [reached for reached in times.values() if reached is not None]
            ratio = "–"
            if ours is not None and known:
                fastest = min(known, key=lambda reached: reached.seconds)
                mark = "~" if fastest.extrapolated or ours.extrapolated else ""
                ratio = f"{mark}{fastest.seconds / ours.seconds:.0f}"
            cells = [str(times.get(p) or "–") for p in NAMES]
            spread = ", ".join(str(reached or "–") for reached in by_seed)
            rows.append([scene, f"{goal:.0%}", str(ours or "–"), spread, *cells, ratio])
    columns = ["scene", "to", "isolux, s", "by run", *NAMES.values(), "fastest peer / isolux"]
    print_table("Seconds of building and solving to an RMS error", columns, rows)
    print("\n~: past the longest run, by error ∝ seconds^-1/2; –: not reached, or not run")


def plot_points(path: Path, points: Sequence[Point], provenance: dict[str, object]) -> None:
    scenes = dict.fromkeys(point.scene for point in points)
    curves: dict[str, dict[str, Sequence[Sequence[Place]]]] = {}
    titles = {}
    for scene in scenes:
        of = [point for point in points if point.scene == scene]
        titles[scene] = f"{scene}, {of[0].triangles:,} triangles"
        programs = dict.fromkeys(point.program for point in of)
        curves[scene] = {program: runs(points, scene, program) for program in programs}
    subtitle = "{machine}, {threads} threads, {clock} seconds, commit {commit}".format(**provenance)
    plot_errors(path, curves, {OURS: "Isolux", **NAMES}, titles, subtitle)


def read_points(path: Path) -> tuple[list[Point], dict[str, object]]:
    """What `write_points` wrote."""
    kinds = get_type_hints(Point)
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    points = [Point(**{name: kind(row[name]) for name, kind in kinds.items()}) for row in rows]
    return points, {name: value for name, value in rows[0].items() if name not in kinds}


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("stages", type=Path, nargs="*")
    parser.add_argument("--peers", default=",".join(QUALITIES), help="comma-separated")
    parser.add_argument("--peers-python", default=sys.executable, help="of where they are")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=30.0, help="of solving, each run at most")
    parser.add_argument("--time-budgets", default="20,20,120", help="s, of our runs")
    parser.add_argument("--cpu-time", action="store_true", help="count the processor's seconds")
    folder = Path(__file__).parents[1] / "build/bench"
    parser.add_argument("--csv", type=Path, default=folder / "peers.csv")
    parser.add_argument("--figure", type=Path, default=folder / "peers.png")
    parser.add_argument("--cache", type=Path, default=folder, help="folder of references")
    parser.add_argument("--agreement", type=Path, help="CSV; asks for agreement instead of times")
    parser.add_argument("--from", type=Path, dest="known", help="CSV of an earlier run")
    options = parser.parse_args(arguments)
    if options.known:
        points, known = read_points(options.known)
        print_times(points)
        plot_points(options.figure, points, known)
        return
    peers = options.peers.split(",") if options.peers else []
    if unknown := set(peers) - set(QUALITIES):
        parser.error(f"no peer {', '.join(unknown)}; there are {', '.join(QUALITIES)}")
    if options.agreement:
        subjects = [read_subject(path, options.cache) for path in options.stages]
        write_agreement(options.agreement, subjects, peers, options.peers_python)
        return
    settings = SolverSettings(threads=options.threads)
    budgets = [float(seconds) for seconds in options.time_budgets.split(",")]
    points = []
    provenance: dict[str, object] = {
        "commit": commit(),
        "machine": cpu_name(),
        "threads": options.threads,
        "clock": "processor" if options.cpu_time else "wall",
    }
    for path in options.stages:
        subject = read_subject(path, options.cache)
        ended: list[tuple[float, float]] = []  # budgets, errors
        for seed, budget in enumerate(budgets):
            shorter = [error for other, error in ended if other < budget]
            if shorter and max(shorter) < ENOUGH:
                continue
            run = replace(settings, seed=seed).with_budget(time_budget=budget)
            points += measure_ours(subject, run, options.cpu_time)
            last = points[-1]
            ended.append((budget, last.rms_error))
            print(f"  {OURS}: {last.solve_seconds:.1f} s, {last.rms_error:.2%}", flush=True)
        for peer in peers:
            try:
                points += measure_peer(
                    subject, peer, options.peers_python, options.threads, options.seconds,
                    options.cpu_time,
                )  # fmt: skip
            except LackingError as lacking:
                print(f"  {peer}: left out: {lacking}", flush=True)
        write_points(options.csv, points, provenance)  # after each stage: it takes long
    print_times(points)
    plot_points(options.figure, points, provenance)
    print(f"\n{options.csv}\n{options.figure}")


def write_points(path: Path, points: Sequence[Point], provenance: dict[str, object]) -> None:
    """One CSV row a run; the columns of the provenance come first."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.DictWriter(file, [*provenance, *(field.name for field in fields(Point))])
        rows.writeheader()
        rows.writerows({**provenance, **asdict(point)} for point in points)


if __name__ == "__main__":
    main()
