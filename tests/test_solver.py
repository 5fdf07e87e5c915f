"""Progressive solving from Python: when stages are due, when a run ends, what a solution holds."""

import math
from dataclasses import replace

import numpy as np
import pytest
from pxr import Usd, UsdGeom
from usd_scenes.cornell_box.generate import generate as generate_cornell_box
from usd_scenes.furnace_sphere.generate import generate as generate_furnace_sphere

import isolux
from isolux.results import ResultsWriter
from isolux.schedule import StagePlan, stage_goals
from isolux.target_error import TargetError
from small_room import FLOOR, LAMP, write_room, write_stage

FLOOR_CORNERS, WALL_CORNERS = 4, 20


@pytest.fixture
def scene(tmp_path):
    return isolux.read_stage(write_room(tmp_path / "room.usda"))


@pytest.mark.parametrize(
    ("photons", "stages", "counts"),
    [
        (80_000, 4, [10_000, 20_000, 40_000, 80_000]),
        (1000, 1, [1000]),
        (1001, 2, [501, 1001]),
        (3, 8, [1, 2, 3]),
    ],
)
def test_photons_double_from_stage_to_stage(scene, photons, stages, counts):
    settings = isolux.SolverSettings(
        method="dept", target_error=0.0, photons=photons, stages=stages
    )
    solver = isolux.ProgressiveSolver(scene, settings)
    assert [solution.stage.photons for solution in solver.stages()] == counts


def test_seconds_double_from_stage_to_stage():
    settings = isolux.SolverSettings(target_error=0.0, time_budget=8.0, stages=4)
    goals = list(stage_goals(settings, settings.stages))
    assert [(goal.photons, goal.seconds) for goal in goals] == [
        (math.inf, seconds) for seconds in (1.0, 2.0, 4.0, 8.0)
    ]


def test_a_target_error_is_met_at_the_last_stage_and_not_before(tmp_path):
    generate_furnace_sphere(tmp_path / "sphere.usda")
    settings = isolux.SolverSettings(method="dept", target_error=0.02)
    solver = isolux.ProgressiveSolver(isolux.read_stage(tmp_path / "sphere.usda"), settings)
    stages = [s.stage for s in solver.stages()]
    assert len(stages) >= settings.stages
    assert stages[-1].rms_error <= 0.02
    assert all(stage.rms_error > 0.02 for stage in stages[settings.stages - 1 : -1])
    assert not any(finding.kind == "target error" for finding in solver.findings())


@pytest.mark.usefixtures("undivided")
@pytest.mark.parametrize("method", ["dept", "ddl+idept"])
def test_a_target_error_below_what_coarse_walls_allow_ends_the_run_and_is_told(scene, method):
    """Walls of four vertices: no number of photons tells how light varies across them."""
    settings = isolux.SolverSettings(method=method, target_error=0.01)
    solver = isolux.ProgressiveSolver(scene, settings)
    *_, last = solver.stages()
    assert last.stage.rms_error > 0.01
    (told,) = [finding for finding in solver.findings() if finding.kind == "target error"]
    assert "0.01 asked" in told.reason


@pytest.mark.parametrize(
    ("errors", "ends"),
    [
        ([0.04, 0.028, 0.02, 0.014, 0.0099], [False] * 4 + [True]),  # noise
        ([0.04, 0.03, 0.026, 0.0255, 0.025], [False] * 4 + [True]),  # a floor
        ([0.04, 0.03, 0.024, 0.019, 0.017], [False] * 5),  # near one, but falling
    ],
)
def test_a_gather_ends_at_its_target_or_where_rays_no_longer_help(scene, errors, ends):
    settings = isolux.SolverSettings(method="composite", target_error=0.01)
    target = TargetError(settings, "composite")
    solver = isolux.ProgressiveSolver(scene, settings.with_budget(photons=1000))
    *_, last = solver.stages()
    told = [
        target.ends(StagePlan("gather"), replace(last.stage, rms_error=error)) for error in errors
    ]
    assert told == ends
    assert len(list(target.findings())) == (ends[-1] and errors[-1] > 0.01)


def test_radiosity_is_refused_where_it_would_take_minutes(tmp_path):
    generate_cornell_box(tmp_path / "box.usdc")
    settings = isolux.SolverSettings(method="ddl+hpr")
    with pytest.raises(isolux.SettingsError, match=r"ddl\+hpr for 30,582 mesh elements.*4,000"):
        isolux.ProgressiveSolver(isolux.read_stage(tmp_path / "box.usdc"), settings)


def test_cancelling_keeps_the_photons_traced_so_far(scene):
    settings = isolux.SolverSettings(target_error=0.0, photons=10**12, stages=1)
    progress = []
    solver = isolux.ProgressiveSolver(scene, settings)
    (solution,) = solver.stages(progress.append, lambda: len(progress) == 3)
    assert solution.stage.photons == progress[-1].photons < 10**12
    assert solution.illuminance("/World/Floor").min() > 0


def test_cancelling_before_another_photon_shows_no_stage_again(scene):
    settings = isolux.SolverSettings(method="dept", target_error=0.0, photons=80_000, stages=4)
    shown = []
    answers = iter([False])  # asked after the first stage, then before the second's photons

    def cancelled():
        return bool(shown) and next(answers, True)

    for solution in isolux.ProgressiveSolver(scene, settings).stages(cancelled=cancelled):
        shown.append(solution.stage.photons)
    assert shown == [10_000]


def test_progress_grows_to_the_whole(scene):
    settings = isolux.SolverSettings(target_error=0.0, photons=50_000)
    progress = []
    for _ in isolux.ProgressiveSolver(scene, settings).stages(progress.append):
        pass
    fractions = [p.fraction for p in progress]
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    assert progress[-1].time_left == pytest.approx(0.0, abs=1e-9)


def test_a_solution_gives_illuminance_at_the_corners_of_a_mesh(tmp_path):
    settings = isolux.SolverSettings(method="dept", target_error=0.0, photons=20_000)
    solutions = list(isolux.solve(write_room(tmp_path / "room.usda"), settings))
    assert [s.stage.index for s in solutions] == list(range(1, 9))
    for path, corners in (("/World/Floor", FLOOR_CORNERS), ("/World/Walls", WALL_CORNERS)):
        illuminance = solutions[-1].illuminance(path)
        assert (illuminance.shape, illuminance.dtype) == ((corners, 3), np.float32)
        assert np.isfinite(illuminance).all()
    with pytest.raises(isolux.SceneError, match=r"/World/Roof.*/World/Floor"):
        solutions[-1].illuminance("/World/Roof")


_SETTINGS = """token isolux:method = "dept"
 int64 isolux:photons = 500
 int isolux:stages = 2"""


def test_settings_of_the_stage_hold_unless_others_are_given(tmp_path):
    room = write_room(tmp_path / "room.usda", _SETTINGS)
    assert [s.stage.photons for s in isolux.solve(room)] == [250, 500]
    given = isolux.SolverSettings(method="dept", target_error=0.0, photons=90, stages=1)
    assert [s.stage.photons for s in isolux.solve(room, given)] == [90]


def test_the_mesh_can_be_refined_later_by_another_threshold(tmp_path):
    """Stricter: vertices come. As before: they go, and leave the very same mesh."""
    source = write_room(tmp_path / "room.usda")
    settings = isolux.SolverSettings(
        method="ddl+hpr", output_mode="refined", subdivision_iterations=2
    )
    solver = isolux.ProgressiveSolver(isolux.read_stage(source), settings)
    for _ in solver.stages():
        pass
    coarse, fine, again = solver.refine(0.05, 2), solver.refine(0.01, 3), solver.refine(0.05, 2)
    assert fine.stage.elements > coarse.stage.elements
    assert fine.stage.shadow_rays > coarse.stage.shadow_rays
    assert again.stage.shadow_rays == fine.stage.shadow_rays  # all samples were known
    assert (again.refined.elements == coarse.refined.elements).all()
    assert (again.direct == coarse.direct).all()

    writer = ResultsWriter(source, tmp_path / "out.usda", solver.scene, {})
    for solution in (coarse, fine, again):
        writer.write(solution)
    stage = Usd.Stage.Open(str(tmp_path / "out.usda"))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/World/Floor"))
    primvar = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("isolux:direct")
    times = primvar.GetTimeSamples()
    assert len(times) == 3
    first, second, third = (np.array(primvar.ComputeFlattened(time)) for time in times)
    assert len(first) == len(mesh.GetPointsAttr().Get())
    assert first.shape == second.shape == third.shape
    # Vertices of another mesh are lost to a stage, those of the scene never.
    np.testing.assert_array_equal(first[:4], third[:4])


def test_refining_wants_direct_light(scene):
    settings = isolux.SolverSettings(method="dept", target_error=0, photons=1000)
    solver = isolux.ProgressiveSolver(scene, settings)
    with pytest.raises(isolux.SettingsError, match="no direct light yet"):
        solver.refine(0.01, 3)


def test_a_beam_that_falls_between_the_points_of_a_mesh_is_told(tmp_path):
    """A disk of 0.2 m close above a floor of one quad lights none of its four corners."""
    lamp = LAMP.replace("SphereLight", "DiskLight").replace("(0, 0, 2)", "(0, 0, 0.02)")
    source = write_stage(tmp_path / "beam.usda", FLOOR, lamp)
    solver = isolux.ProgressiveSolver(isolux.read_stage(source), isolux.SolverSettings())
    for _ in solver.stages():
        pass
    (finding,) = solver.findings()
    assert (finding.path, finding.kind, finding.action) == ("/World/Floor", "tessellation", "noted")
    assert "finer than the mesh" in finding.reason
