"""A photon depends on the seed and its number alone: threads and ranges change no bit."""

from dataclasses import replace

import numpy as np
import pytest
from pxr import Usd, UsdGeom
from usd_scenes.furnace_sphere.generate import icosphere
from usd_scenes.office.generate import generate as generate_office
from usd_scenes.shapes import box

from core_scenes import Traced, build, luminaire, surface
from isolux import _core
from isolux.results import ResultsWriter
from isolux.settings import SolverSettings
from isolux.solver import ProgressiveSolver
from isolux.stage_reader import read_stage
from small_room import write_room
from validation.rows import INVARIANCE

pytestmark = pytest.mark.validation(INVARIANCE)

PHOTONS = 40_000
MESHES = [
    surface(box((4, 4, 4), 0.25).flipped(), (0.7, 0.5, 0.3)),
    surface(icosphere(2), (0.2, 0.4, 0.8), double_sided=True),
]
LAMPS = [
    luminaire(900.0, (1.5, 1.5, 1.5), colour=(1.2, 0.95, 0.9)),
    luminaire(300.0, (-1, 0, 1.99), "rect", (0.5, 0.5)),
]
SCENE = build(MESHES, LAMPS)


def traced(ranges, threads=1, seed=5):
    """Ranges (first, count) one after the other into the same buckets."""
    buckets = _core.PhotonBuckets(SCENE)
    for first, count in ranges:
        _core.trace_photons(SCENE, buckets, seed, first, count, threads)
    return buckets


def merged(ranges):
    """Ranges into buckets of their own, then into one."""
    buckets = _core.PhotonBuckets(SCENE)
    for one in ranges:
        buckets.merge(traced([one]))
    return buckets


def everything(buckets, threads=1):
    """All that comes out, by name."""
    lighting = _core.IlluminationFilter(SCENE)
    filtered = lighting.filter(SCENE, buckets, 0.05, 0.25, False, threads)
    return {"hits": buckets.hit_counts, **buckets.ends, **filtered}


def assert_same_bits(outcome, reference):
    for name, value in reference.items():
        assert np.asarray(outcome[name]).tobytes() == np.asarray(value).tobytes(), name


@pytest.fixture(scope="module")
def one_range():
    return everything(traced([(0, PHOTONS)]))


QUARTERS = [(i * PHOTONS // 4, PHOTONS // 4) for i in range(4)]
UNEVEN = [(0, 1), (1, 4095), (4096, 30_001), (34_097, 5903)]


@pytest.mark.parametrize(
    "other",
    [
        lambda: everything(traced([(0, PHOTONS)], threads=2), threads=2),
        lambda: everything(traced([(0, PHOTONS)], threads=3), threads=1),
        lambda: everything(merged(QUARTERS)),
        lambda: everything(merged(QUARTERS[::-1])),
        lambda: everything(traced(UNEVEN)),
        lambda: everything(traced(UNEVEN[::-1], threads=2), threads=2),
    ],
    ids=["2 threads", "3 threads", "4 merged", "merged backwards", "uneven", "uneven backwards"],
)
def test_threads_and_ranges_change_no_bit(one_range, other):
    assert_same_bits(other(), one_range)


def test_another_seed_has_other_photons_and_the_same_light(one_range):
    other = traced([(0, PHOTONS)], seed=6)
    hits = one_range["hits"].astype(float)
    difference = other.hit_counts - hits
    assert (difference != 0).mean() > 0.5
    assert difference.sum(axis=0)[1] == pytest.approx(0, abs=4 * np.sqrt(4 * hits[:, 1].sum()))


def test_the_first_photons_are_those_of_a_longer_run():
    first, rest = traced([(0, 10_000)]), traced([(10_000, PHOTONS - 10_000)])
    first.merge(rest)
    assert np.array_equal(first.hit_counts, traced([(0, PHOTONS)]).hit_counts)
    assert Traced(SCENE, first, MESHES).buckets.ends["emitted"] == PHOTONS


METHODS = {
    "composite": ("office", "vertex", {"DEPT", "DDL", "gather"}),
    "composite refined": ("office", "refined", {"DEPT", "DDL", "gather"}),
    "ddl+idept": ("office", "vertex", {"DDL", "IDEPT"}),
    "ddl+hpr": ("box", "refined", {"DDL", "HPR"}),
}


@pytest.mark.parametrize("name", METHODS)
def test_a_replay_on_two_threads_gives_the_bits_of_one(tmp_path, name):
    """A run whose T1 the clock chose, on one thread, then its steps, by counts alone, on two."""
    scene_name, output_mode, components = METHODS[name]
    source = tmp_path / "source.usda"
    if scene_name == "office":
        generate_office(source, density=0.25)
    else:
        write_room(source)
    scene = read_stage(source)
    settings = SolverSettings(
        method=name.split()[0], output_mode=output_mode, subdivision_iterations=1,
        photons=60_000, stages=4,
    )  # fmt: skip
    steps, arrays = (), []
    for threads in (1, 2):
        output = tmp_path / f"{threads}.usda"
        writer = ResultsWriter(source, output, scene, {})
        solver = ProgressiveSolver(scene, replace(settings, threads=threads))
        for solution in solver.stages(replay=steps):
            writer.write(solution)
        steps = solution.steps
        assert {step.component for step in steps} == components
        arrays.append(primvars(output))
    first, second = arrays
    assert first.keys() == second.keys()
    assert sum("isolux:indirect at 2" in key for key in first) >= 2
    assert [name for name in first if first[name] != second[name]] == []


def primvars(path):
    """The bytes of each primvar at each of its times."""
    out = {}
    stage = Usd.Stage.Open(str(path))
    for prim in stage.Traverse():
        for primvar in UsdGeom.PrimvarsAPI(prim).GetPrimvars():
            for time in primvar.GetTimeSamples():
                values = np.array(primvar.ComputeFlattened(time))
                out[f"{prim.GetPath()}.{primvar.GetName()} at {time}"] = values.tobytes()
    return out
