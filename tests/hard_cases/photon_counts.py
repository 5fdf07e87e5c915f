"""Hard cases of reflectances and of counting photons: 10 to 13, 24 to 27."""

from __future__ import annotations

import numpy as np
import pytest
from usd_scenes.shapes import box, rectangle

from core_scenes import luminaire, surface, trace
from hard_cases.hard_case import hard_case
from hard_cases.small_stages import (
    FLUX,
    at_corners,
    findings_at,
    mean_everywhere,
    mesh,
    point_light,
    read,
    rect_light,
    solved,
    solver_of,
)
from isolux import _core
from isolux.errors import SceneError
from isolux.settings import SolverSettings
from isolux.solver import ProgressiveSolver

SHAPE = box((4, 4, 4), 1.0).flipped()
LAMP = point_light(FLUX, (0.3, 0.2, 0.1))
# Directions from the middle of a face of a cube to that face: a sixth.
FLOOR = rectangle((-2, -2, -2), (4, 0, 0), (0, 4, 0), 1.0)


@hard_case(
    10,
    "reflectance 0",
    "Direct light alone: indirect light is exactly 0.",
    "0 by every method; Φ/A direct in the mean",
)
def black() -> None:
    scene = read(mesh("Room", SHAPE) + LAMP)
    for method in ("dept", "composite", "ddl+idept", "ddl+hpr"):
        lit = solved(scene, method)
        assert not lit.indirect.any()
        assert mean_everywhere(lit)[0] == pytest.approx(FLUX / 96, rel=0.05), method


@hard_case(
    11,
    "reflectance 1 in a closed room",
    "Taken as 0.99, with a finding that names the prim; the run ends.",
    "Φ/(A(1−0.99)), direct and indirect",
)
def white() -> None:
    scene = read(mesh("Room", SHAPE, 1.0) + LAMP)
    assert [finding.kind for finding in findings_at(scene, "/Room")] == ["reflectance"]
    lit = solved(scene, photons=10_000)
    assert lit.stage.absorbed == lit.stage.photons
    # The number of bounces of a photon is geometric: it deviates as it is.
    assert mean_everywhere(lit).sum() == pytest.approx(FLUX / (96 * 0.01), rel=4 / 100)


@hard_case(
    12,
    "reflectance above 1, below 0, NaN",
    "Refused in one line that names the prim and the value.",
    "SceneError at the prim",
)
def impossible() -> None:
    for value, told in ((1.2, "1.2"), (-0.1, "-0.1"), (float("nan"), "nan")):
        with pytest.raises(SceneError) as raised:
            read(mesh("Room", SHAPE, value) + LAMP)
        assert "/Room" in str(raised.value)
        assert told in str(raised.value)


@hard_case(
    13,
    "0 or 1 photon at a vertex",
    "Such a vertex has an interval of plausible means, and never no error.",
    "P(0 | high) = P(1 | low) = P(1 | high) = 5 % of the Poisson distribution; over 100 seeds of "
    "100 photons on 150 vertices nine intervals of ten hold the true mean",
)
def few_photons() -> None:
    for n in (0, 1):
        low, high = _core.poisson_interval(n, False)
        ends = (high,) if n == 0 else (low, high)
        assert [end**n * np.exp(-end) for end in ends] == pytest.approx([0.05] * len(ends))
    for photons in (1, 2, 30):
        lit = solved(mesh("Room", SHAPE, 0.5) + LAMP, photons=photons)
        assert (lit.relative_deviation > 0.05).all()
        assert lit.stage.rms_error > 0 or np.isnan(lit.stage.rms_error)
    room = surface(SHAPE)
    means = trace([room], [luminaire()], 1_000_000).hits[:, 0] / 10_000
    covered = []
    for seed in range(100):
        counts = trace([room], [luminaire()], 100, seed=seed + 2).buckets.hit_counts[:, 0]
        low, high = np.array([_core.poisson_interval(n, False) for n in counts.tolist()]).T
        covered.append(((low <= means) & (means <= high)).mean())
    assert np.mean(covered) > 0.9


@hard_case(
    24,
    "an open scene",
    "What escapes is counted; nothing stalls.",
    "5/6 of the photons escape past one face of a cube around the light; absorbed + escaped = "
    "emitted",
)
def open_scene() -> None:
    lit = solved(mesh("Floor", FLOOR, 0.9) + point_light(FLUX, (0, 0, 0)))
    stage = lit.stage
    assert stage.absorbed + stage.back_absorbed + stage.escaped == stage.photons
    met = stage.absorbed / 0.1 / stage.photons  # of those that meet the floor a tenth stays
    assert met == pytest.approx(1 / 6, abs=4 / 0.1 * np.sqrt(1 / 60 / stage.photons))
    for method in ("composite", "ddl+hpr"):
        assert not solved(mesh("Floor", FLOOR, 0.9) + LAMP, method).indirect.any()


@hard_case(
    25,
    "10⁹ photons and more",
    "Counts are exact beyond 2³²; photons past 2³² are new ones; sums lose nothing.",
    "buckets added to themselves 20 times: 2²⁰ times the counts, the same illuminance; "
    "photons around number 2³² against the first ones by χ²",
)
def many_photons() -> None:
    once = trace([surface(SHAPE)], [luminaire(FLUX)], 20_000)
    hits, light = once.buckets.hit_counts.copy(), once.illuminance
    doubled = _core.PhotonBuckets(once.scene)
    doubled.merge(once.buckets)
    for _ in range(20):
        copy = _core.PhotonBuckets(once.scene)
        copy.merge(doubled)
        doubled.merge(copy)
    assert doubled.ends["emitted"] == 20_000 << 20 > 2**34
    assert doubled.hit_counts.dtype == np.uint64
    assert np.array_equal(doubled.hit_counts, hits << np.uint64(20))
    lit = doubled.illuminance(once.scene)[:, 0] @ [0.2126, 0.7152, 0.0722]
    assert lit == pytest.approx(light[:, 0], rel=1e-6)
    filtered = _core.IlluminationFilter(once.scene).filter(
        once.scene, doubled, 0.05, 0.25, False, 2
    )
    assert np.isfinite(filtered["direct"]).all()
    assert 0 < filtered["rms_error"] < once.filtered()["rms_error"]

    late = _core.PhotonBuckets(once.scene)
    _core.trace_photons(once.scene, late, 1, 2**32 - 10_000, 20_000, 2)
    assert late.ends["emitted"] == late.hit_counts.sum() == 20_000
    new = _core.PhotonBuckets(once.scene)
    _core.trace_photons(once.scene, new, 1, 2**32, 20_000, 2)
    assert not np.array_equal(new.hit_counts, hits)
    total = (hits + late.hit_counts)[:, 0]
    squares = (hits[:, 0].astype(float) - late.hit_counts[:, 0].astype(float)) ** 2 / total
    assert squares.sum() == pytest.approx(len(total), abs=4 * np.sqrt(2 * len(total)))


@hard_case(
    26,
    "one vertex; a light that reaches nothing",
    "Valid values of 0.",
    "0",
)
def nothing_to_light() -> None:
    point = 'def Mesh "Point" {\n    point3f[] points = [(0, 0, 0)]\n}\n'
    scene = read(mesh("Room", SHAPE, 0.5) + LAMP + point)
    assert [finding.action for finding in findings_at(scene, "/Point")] == ["skipped"]
    away = mesh("Floor", FLOOR, 0.5) + rect_light(100.0, (1, 1), (0, 0, -3))
    for method in ("dept", "composite", "ddl+idept", "ddl+hpr"):
        lit = solved(away, method)
        assert at_corners(lit, "/Floor").shape == FLOOR.indices.shape
        assert not at_corners(lit, "/Floor").any()


@hard_case(
    26,
    "an empty stage, a stage without lights, light that arrives nowhere",
    "Valid values of 0, and a finding that says what is missing.",
    "0 lx at every corner, by every method and output mode; no values without meshes",
    part="b",
)
def no_light() -> None:
    room = mesh("Room", SHAPE, 0.5)
    level = "((0, 0, 1, 0), (0, 1, 0, 0), (-1, 0, 0, 0), (0, 0, 0, 1))"
    floor = mesh("Floor", FLOOR, 0.5)
    floor += f"""def DistantLight "Sun" {{
        float inputs:angle = 0
        matrix4d xformOp:transform = {level}
        uniform token[] xformOpOrder = ["xformOp:transform"]\n}}\n"""
    for text, told in (
        (room, "no luminaire"),
        (LAMP, "no visible mesh"),
        ("", "no visible mesh to light and no luminaire"),
        (floor, "no light arrives"),
    ):
        for method in ("auto", "dept", "composite", "ddl+idept", "ddl+hpr"):
            for mode in ("vertex", "refined"):
                solver = solver_of(text, method, output_mode=mode)
                (lit,) = solver.stages()
                assert len(lit.layouts) == text.count("def Mesh")
                for path in lit.layouts:
                    assert not at_corners(lit, path).any()
                assert lit.stage.rms_error == 0
                findings = solver.scene.findings + solver.findings()
                (reason,) = [f.reason for f in findings if f.path == "/"]
                assert reason.startswith(told)


@hard_case(
    27,
    "the same seed on 1 or N threads",
    "The same bits.",
    "a run on one thread, replayed on two and on three",
)
def same_bits() -> None:
    scene = read(
        mesh("Room", SHAPE, 0.5)
        + mesh("Table", rectangle((-1, -1, 0), (1, 0, 0), (0, 1, 0), 0.5), 0.4)
        + rect_light(100.0, (1.0, 1.0), (0.3, 0.4, 2.0))
    )
    for method, mode in (("dept", "vertex"), ("composite", "refined"), ("ddl+hpr", "vertex")):
        steps, bits = (), set()
        for threads in (1, 2, 3):
            settings = SolverSettings(
                method=method, output_mode=mode, photons=20_000, stages=3, threads=threads,
                subdivision_iterations=1,
            )  # fmt: skip
            *_, lit = ProgressiveSolver(scene, settings).stages(replay=steps)
            steps = lit.steps
            bits.add(lit.direct.tobytes() + lit.indirect.tobytes())
        assert len(bits) == 1, method
