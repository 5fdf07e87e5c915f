"""The order of the components, told by the counts of each step, without a scene."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import pytest

from isolux.composite import GATHER_RAYS_PER_PHOTON, LEAST_GATHER_RAYS, steps
from isolux.schedule import StageGoal
from isolux.settings import SolverSettings

PHOTONS_A_SECOND = 1_000_000


@dataclass
class SimulatedRun:
    """A run whose clock is its photon count: what the order sees of a solver."""

    settings: SolverSettings
    vertices: int = 1000
    reflects: bool = True
    first_iteration: float = 2.0
    elapsed: float = 0.0
    stages_shown: int = 0
    photons: int = 0
    radiosity_finished: bool = False
    mesh_finished: bool = False
    direct_passes: int = 0
    direct_wanted: int = 1
    gathered: int = 0
    finishing: dict[str, float] = field(default_factory=dict)

    @property
    def indirect_error(self):
        return 300 / math.sqrt(max(1, self.photons))

    @property
    def direct_share(self):
        return 9.0 if self.direct_passes < self.direct_wanted else 0.0

    def trace_until(self, goal: StageGoal, component):
        seconds = goal.seconds - self.finishing_seconds(component) - self.elapsed
        missing = max(0.0, goal.photons - self.photons)
        photons = min(missing, max(0.0, seconds) * PHOTONS_A_SECOND)
        self.photons += round(photons)
        self.elapsed += photons / PHOTONS_A_SECOND

    @property
    def seconds_per_photon(self):
        return 1 / PHOTONS_A_SECOND

    @property
    def seconds_per_gather_ray(self):
        return 0.25 / PHOTONS_A_SECOND

    def finishing_seconds(self, component):
        return self.finishing.get(component, 0.0)

    def first_iteration_seconds(self):
        self.finishing["DDL"] = self.first_iteration
        return self.first_iteration


def made(method, run):
    out = []
    for step in steps(method, run):
        if step.component == "DDL":
            run.elapsed += run.first_iteration
            run.direct_passes += 1
        if step.component == "gather":
            run.gathered += step.rays
            run.elapsed += step.rays * run.seconds_per_gather_ray
        run.stages_shown += step.shown
        out.append(step)
    return out


def shown(all_steps):
    return [step.component for step in all_steps if step.shown]


@pytest.mark.parametrize(
    ("stages", "expected"),
    [
        (8, 3 * ["DEPT"] + ["DDL"] + 4 * ["gather"]),
        (4, ["DEPT", "DEPT", "DDL", "gather"]),
        (3, ["DEPT", "DDL", "gather"]),
        (2, ["DDL", "gather"]),
        (1, ["gather"]),
    ],
)
def test_the_composite_goes_from_photons_to_direct_to_indirect_light(stages, expected):
    settings = SolverSettings(stages=stages, target_error=0, photons=64_000_000)
    every = made("composite", SimulatedRun(settings))
    assert shown(every) == expected
    assert [s.component for s in every][:4] == ["DEPT", "DEPT", "DEPT", "DDL"]
    photons = [step.photons for step in every]
    assert photons == sorted(photons)
    assert photons[-1] == 64_000_000


def test_t1_comes_when_the_first_iteration_could_be_done():
    settings = SolverSettings(target_error=0, photons=64_000_000)
    run = SimulatedRun(settings, first_iteration=0.3)
    direct = next(s for s in steps("composite", run) if s.component == "DDL")
    assert direct.photons == pytest.approx(0.3 * PHOTONS_A_SECOND, rel=1e-6)


def test_the_pilot_takes_its_share_whatever_filtering_takes():
    settings = SolverSettings(target_error=0, photons=64_000_000)
    run = SimulatedRun(settings, first_iteration=3.0, finishing={"DEPT": 0.5})
    photons = [step.photons for step in steps("composite", run) if step.component == "DEPT"]
    assert photons[1] == pytest.approx(0.3 * PHOTONS_A_SECOND, rel=1e-6)


def run_whose_photons_are_off_by(error, settings):
    class Run(SimulatedRun):
        indirect_error = error

    return Run(settings)


@pytest.mark.parametrize(("error", "looks"), [(0.1, False), (0.5, True)])
def test_the_fewest_rays_are_shown_first_where_photons_are_far_off(error, looks):
    settings = SolverSettings(target_error=0, photons=64_000_000)
    run = run_whose_photons_are_off_by(error, settings)
    every = made("composite", run)
    first = next(s for s in every if s.component == "gather")
    assert first.shown
    assert (first.rays == LEAST_GATHER_RAYS * run.vertices) == looks
    assert len(shown(every)) <= settings.stages


@pytest.mark.parametrize("photons", [100, 1_000, 50_000])
@pytest.mark.parametrize("error", [0.1, 0.5])
def test_a_run_of_few_photons_spends_as_many_rays_whatever_they_seem_to_tell(photons, error):
    """And sharpens direct light, where it holds back, before the last of them."""
    settings = SolverSettings(target_error=0, photons=photons)
    run = run_whose_photons_are_off_by(error, settings)
    run.direct_wanted = 2
    every = made("composite", run)
    fewest = 2 * LEAST_GATHER_RAYS * run.vertices
    assert run.gathered == pytest.approx(max(fewest, GATHER_RAYS_PER_PHOTON * photons), rel=0.01)
    assert [step.component for step in every][-3:] == ["gather", "DDL", "gather"]
    assert len(shown(every)) <= settings.stages


def test_a_first_look_by_few_rays_leaves_the_budget_as_it_is():
    run = run_whose_photons_are_off_by(0.5, SolverSettings(target_error=0, time_budget=60))
    made("composite", run)
    assert run.elapsed == pytest.approx(60, rel=0.1)


def test_the_one_gather_that_is_left_takes_the_time_that_there_is():
    """A ray takes a quarter of a photon's time, which only a first gather tells."""

    class Run(SimulatedRun):
        @property
        def seconds_per_gather_ray(self):
            return super().seconds_per_gather_ray * (1 if self.gathered else 4)

    run = Run(SolverSettings(target_error=0, time_budget=60, stages=1))
    every = made("composite", run)
    assert shown(every) == ["gather"]
    assert run.elapsed == pytest.approx(60, rel=0.1)


def test_rays_that_become_cheaper_leave_no_time_over():
    """A gather takes half a second beside its rays, as looking up and smoothing do."""

    class Run(SimulatedRun):
        last_gather = 0

        @property
        def seconds_per_gather_ray(self):
            ray = 0.25 / PHOTONS_A_SECOND
            return ray + 0.5 / self.last_gather if self.last_gather else 4 * ray

    run = Run(SolverSettings(target_error=0, time_budget=20))
    for step in steps("composite", run):
        if step.component == "gather":
            run.last_gather = step.rays
        run.elapsed += {"DDL": 2.0, "gather": step.rays * run.seconds_per_gather_ray}.get(
            step.component, 0.0
        )
    assert step.shown
    assert run.elapsed == pytest.approx(20, rel=0.05)


@pytest.mark.parametrize("budget", [{"photons": 64_000_000}, {"time_budget": 64}])
def test_direct_light_becomes_finer_between_gathers_as_long_as_it_holds_them_back(budget):
    run = SimulatedRun(SolverSettings(target_error=0, **budget), direct_wanted=4)
    components = [s.component for s in made("composite", run)]
    after = components[components.index("DDL") :]
    assert after[:7] == ["DDL", "gather", "DDL", "DDL", "gather", "DDL", "gather"]
    assert set(after[7:]) == {"gather"}


def test_the_first_rays_tell_whether_direct_light_holds_back_the_first_gather_shown():
    settings = SolverSettings(target_error=0, time_budget=60)
    run = run_whose_photons_are_off_by(0.1, settings)
    run.direct_wanted, run.first_iteration = 3, 0.2
    every = made("composite", run)
    after = every[[s.component for s in every].index("DDL") :]
    assert [s.component for s in after[:5]] == ["DDL", "gather", "DDL", "DDL", "gather"]
    assert [s.shown for s in after[:5]] == [True, False, False, False, True]
    assert after[1].rays < after[4].rays
    assert run.elapsed == pytest.approx(60, rel=0.1)


def test_finer_direct_light_leaves_time_for_a_gather():
    settings = SolverSettings(target_error=0, time_budget=20)
    run = SimulatedRun(settings, first_iteration=2.5, direct_wanted=9)
    for step in made("composite", run):
        last = step
    assert last.component == "gather"
    assert run.elapsed == pytest.approx(20, rel=0.1)


def test_a_refined_run_shows_each_iteration_of_the_mesh():
    settings = SolverSettings(
        output_mode="refined", subdivision_iterations=2, target_error=0, photons=10**8
    )
    every = made("composite", SimulatedRun(settings))
    assert shown(every) == 3 * ["DEPT"] + ["DDL", "gather", "DDL", "DDL", "gather"]
    assert [step.iteration for step in every if step.component == "DDL"] == [0, 1, 2]


@pytest.mark.parametrize("stages", range(1, 12))
@pytest.mark.parametrize("budget", [{"photons": 10**8}, {"time_budget": 100}])
def test_a_refined_run_gathers_a_few_rays_before_it_refines_where_there_is_room(stages, budget):
    settings = SolverSettings(output_mode="refined", target_error=0, stages=stages, **budget)
    run = run_whose_photons_are_off_by(0.5, settings)
    every = made("composite", run)
    assert len(shown(every)) <= stages
    assert every[-1].component == "gather"
    assert every[-1].shown
    after_t1 = [step for step in every if step.component != "DEPT"]
    assert [step.iteration for step in after_t1 if step.component == "DDL"] == [0, 1, 2, 3]
    if stages >= 6:
        assert [step.component for step in after_t1[:3]] == ["DDL", "gather", "DDL"]
        assert after_t1[1].shown


def test_refining_leaves_half_of_a_time_budget_to_the_gather():
    settings = SolverSettings(output_mode="refined", target_error=0, time_budget=20)
    run = run_whose_photons_are_off_by(0.5, settings)
    every = made("composite", run)
    gathering = sum(step.rays for step in every) * run.seconds_per_gather_ray
    assert 10 <= gathering <= run.elapsed <= 20.5


def test_a_mesh_that_wants_no_split_ends_direct_lighting():
    settings = SolverSettings(output_mode="refined", target_error=0, photons=10**8)
    run = SimulatedRun(settings, mesh_finished=True)
    assert [s.component for s in made("composite", run)].count("DDL") == 1


def test_without_reflection_direct_light_is_all():
    run = SimulatedRun(SolverSettings(), reflects=False)
    assert [step.component for step in made("composite", run)] == ["DDL"]
    assert run.photons == 0


@pytest.mark.parametrize("stages", range(1, 6))
@pytest.mark.parametrize("finished", [False, True])
def test_without_reflection_a_refined_run_shows_a_stage_however_few_there_are(stages, finished):
    settings = SolverSettings(output_mode="refined", subdivision_iterations=3, stages=stages)
    run = SimulatedRun(settings, reflects=False, mesh_finished=finished)
    every = made("ddl+hpr", run)
    assert 1 <= len(shown(every)) <= stages
    assert every[-1].shown


def test_a_budget_too_short_for_direct_lighting_goes_to_photons():
    run = SimulatedRun(SolverSettings(target_error=0, time_budget=2.0), first_iteration=5.0)
    every = made("composite", run)
    assert {step.component for step in every} == {"DEPT"}
    assert run.elapsed == pytest.approx(2.0)


def test_a_time_budget_is_shared_by_photons_and_the_rays_gathered_over_them():
    run = SimulatedRun(SolverSettings(target_error=0, time_budget=60.0))
    every = made("composite", run)
    assert run.elapsed == pytest.approx(60.0, rel=1e-3)
    rays = sum(step.rays for step in every)
    assert rays == pytest.approx(GATHER_RAYS_PER_PHOTON * run.photons, rel=1e-3)


def test_stages_that_could_not_be_finished_in_time_are_left_out():
    run = SimulatedRun(SolverSettings(target_error=0, time_budget=8.0), finishing={"DEPT": 0.9})
    assert [step.photons for step in steps("dept", run)] == [1_100_000, 3_100_000, 7_100_000]


@pytest.mark.parametrize(
    ("filtering", "budget", "photon_seconds"),
    [
        (5.0, 3.0, 0.04),  # the first look alone
        (2.0, 3.0, 0.04),  # a second filtering would not end in time
        (1.0, 20.0, 18.0),  # photons for all but the time that they take to filter
    ],
)
def test_a_mesh_that_takes_long_to_filter_keeps_its_budget(filtering, budget, photon_seconds):
    """Direct lighting would take longer: neither its pilot nor a filtering comes after the end."""
    settings = SolverSettings(target_error=0, time_budget=budget)
    run = SimulatedRun(settings, first_iteration=300.0)
    every = []
    for step in steps("composite", run):
        run.elapsed += filtering
        run.finishing["DEPT"] = filtering
        run.stages_shown += step.shown
        every.append(step)
    assert run.elapsed <= max(budget, 0.04 + filtering) + 1e-9
    assert all(step.component == "DEPT" and step.shown for step in every)
    assert run.photons == pytest.approx(photon_seconds * PHOTONS_A_SECOND, rel=0.2)
    assert len({step.photons for step in every}) == len(every)


def test_one_stage_is_shown_though_its_time_is_up():
    run = SimulatedRun(
        SolverSettings(target_error=0, time_budget=3.0, stages=1),
        first_iteration=300.0,
        finishing={"DEPT": 5.0},
    )
    assert shown(made("composite", run)) == ["DEPT"]


@pytest.mark.parametrize(("photons", "first_look"), [(64_000_000, 500_000), (200_000, 200_000)])
def test_a_large_mesh_is_worth_a_photon_a_vertex_before_it_is_filtered(photons, first_look):
    run = SimulatedRun(SolverSettings(target_error=0, photons=photons), vertices=500_000)
    assert next(steps("composite", run)).photons == first_look


@pytest.mark.parametrize("stages", [1, 3, 4, 8])
@pytest.mark.parametrize("budget", [0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 8.0, 13.0])
def test_what_finer_direct_light_and_the_rays_before_it_found_is_shown(budget, stages):
    """A finer pass takes four times as long as it was expected to: no time is left after it."""
    settings = SolverSettings(target_error=0, time_budget=budget, stages=stages)
    run = run_whose_photons_are_off_by(0.1, settings)
    run.vertices, run.direct_wanted, run.first_iteration = 200_000, 9, 0.1
    for step in steps("composite", run):
        if step.component == "DDL":
            run.elapsed += 0.1 if run.direct_passes == 0 else 0.8
            run.direct_passes += 1
        elif step.component == "gather":
            run.elapsed += step.rays * run.seconds_per_gather_ray
    assert step.shown
