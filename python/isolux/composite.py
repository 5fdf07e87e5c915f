"""The order of the components for each method, and when one gives way to the next.

composite [Volevich 2000, §3.2-3.3]: photons until T1, direct lighting until T2, then the indirect
light until a stopping criterion is met.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator
from typing import Protocol

from .schedule import Component, StageGoal, StagePlan, stage_goals
from .settings import Method, SolverSettings
from .switchover import LEAST_PILOT_SECONDS, pilot_seconds, switchover_photons

# Gathered rays for each photon. Office, 3 million rays: over 0.3 and over 4.3 million photons the
# error of indirect light is 9.7 and 9.6 %.
GATHER_RAYS_PER_PHOTON = 30
# The fewest that a gather takes, a vertex.
LEAST_GATHER_RAYS = 4
# Error of the photons' indirect light from which on the fewest rays are worth a stage of their own:
# in office, hall and box they leave 22, 9 and 13 % of 51, 23 and 11.
LOOK_ERROR = 0.25
# Of a time budget, for photons and direct light on an adaptive mesh; the rest is the gather's.
REFINEMENT_SHARE = 0.5
# Of the time planned for a gather, from which on the time of a ray counts as known.
AS_PLANNED = 0.8
# How much longer each finer pass over direct light takes: 1.5 to 2 times on the benchmarks.
FINER_DIRECT_SECONDS = 2
# Such passes before a gather, at most.
FINER_PASSES = 2
# Where no clock runs: error of direct light beside that of the indirect light when the gather ends,
# above which a finer pass comes first.
DIRECT_SHARE = 0.5
# Of the time until the first gather is shown, for the rays that tell what holds it back.
FIRST_GATHER_SHARE = 0.25
# Rays of the first step of radiosity; they double from step to step.
FIRST_RADIOSITY_RAYS = 1 << 14


class Run(Protocol):
    """What the order depends on of the run in progress."""

    settings: SolverSettings
    vertices: int  # of the illumination mesh
    reflects: bool  # some surface does
    elapsed: float  # s
    stages_shown: int
    radiosity_finished: bool
    mesh_finished: bool  # no element wants to be split further

    @property
    def photons(self) -> int:
        """Emitted so far."""

    @property
    def indirect_error(self) -> float:
        """Relative RMS error of the indirect light as it stands; nan: not known."""

    @property
    def seconds_per_photon(self) -> float:
        """Of tracing, as measured."""

    @property
    def seconds_per_gather_ray(self) -> float:
        """As measured last, or a guess."""

    def trace_until(self, goal: StageGoal, component: Component) -> None:
        """Emit photons until the goal, with time left for the component to use them."""

    def finishing_seconds(self, component: Component) -> float:
        """How long the component will take to turn photons into illuminance, s."""

    @property
    def direct_share(self) -> float:
        """Error of direct light at the vertices, where it can be finer, over the indirect's."""

    def first_iteration_seconds(self) -> float:
        """T_i0, s, of direct lighting, estimated."""


def chosen_method(settings: SolverSettings) -> Method:
    """What `auto` means.

    Departure: below 500 polygons the paper takes radiosity for the faster way to the indirect light
    [Volevich 2000, §3.2]. Here large faces are divided and rays gather: rooms of 6, 30 and 143
    polygons are within 2 % after half a second of one core, where radiosity ends at 3.6, 3.0 and,
    after 3 s, 1.7 % (tools/method_curves.py).
    """
    return "composite" if settings.method == "auto" else settings.method


def steps(method: Method, run: Run) -> Iterator[StagePlan]:
    """The steps of a method; each is carried out before the next is asked for."""
    if method == "dept":
        yield from _photon_steps(run, "DEPT", run.settings.stages)
        return
    direct_stages = _direct_stages(run.settings)
    late_stages = run.settings.stages - direct_stages
    if method == "composite" and run.reflects:
        # Gathers are left a stage, and one before the mesh is refined.
        yield from _start(run, late_stages - min(2, direct_stages))
        if not _time_for_direct(run):
            # Where the first look alone took all the time, no photon is left to add.
            if run.stages_shown == 0 or not _time_is_up(run):
                yield from _photon_steps(run, "DEPT", max(1, min(3, late_stages - 1)))
            return
    gathered = yield from _direct_steps(run, looks=method == "composite" and run.reflects)
    if not run.reflects:
        return
    if method == "ddl+hpr":
        yield from _radiosity_steps(run)
    else:
        late_stages = max(1, run.settings.stages - run.stages_shown)
        if method == "composite":
            yield from _gather_steps(run, late_stages, gathered)
        else:
            yield from _photon_steps(run, "IDEPT", late_stages)


def _start(run: Run, room: int) -> Iterator[StagePlan]:
    """Photons until T1, or a first look alone where the budget leaves no time for direct lighting.

    room : how many stages there may be
    """
    bound = run.settings.photons or math.inf
    # A first look, at once; beside its indirect light direct lighting is timed.
    budget = run.settings.time_budget or math.inf
    run.trace_until(StageGoal(bound, run.elapsed + LEAST_PILOT_SECONDS, False), "DEPT")
    # A large mesh takes so long to filter that more photons come at next to no cost.
    if run.photons < run.vertices:
        run.trace_until(StageGoal(min(bound, run.vertices), budget, False), "DEPT")
    yield StagePlan("DEPT", run.photons, shown=room >= 2)
    if run.elapsed > budget:
        return
    first_iteration = run.first_iteration_seconds()
    if not _time_for_direct(run):
        return
    looked = run.photons * run.seconds_per_photon
    missing = pilot_seconds(first_iteration) - looked
    # Filtering costs more than a pilot that isn't much longer than the first look would tell.
    if missing > 3 * looked and run.photons < bound:
        until_told = run.elapsed + missing + run.finishing_seconds("DEPT")
        run.trace_until(StageGoal(bound, until_told, False), "DEPT")
        yield StagePlan("DEPT", run.photons, shown=room >= 3)
    pilot = run.photons * run.seconds_per_photon
    until = switchover_photons(run.photons, pilot, run.indirect_error, first_iteration)
    if min(until, bound) > run.photons:
        run.trace_until(StageGoal(min(until, bound), budget, False), "DEPT")
        yield StagePlan("DEPT", run.photons, shown=room >= 1)


def _time_for_direct(run: Run) -> bool:
    budget = run.settings.time_budget
    return budget == 0 or run.elapsed + run.finishing_seconds("DDL") <= budget


def _time_is_up(run: Run) -> bool:
    return 0 < run.settings.time_budget <= run.elapsed + run.finishing_seconds("DEPT")


def _direct_stages(settings: SolverSettings) -> int:
    return 1 + (settings.subdivision_iterations if settings.output_mode == "refined" else 0)


def _direct_steps(run: Run, looks: bool) -> Generator[StagePlan, None, int]:
    """Direct lighting at the vertices, then iterations of the adaptive mesh.

    looks : a first gather may come after the first
    returns : rays gathered
    """
    count = _direct_stages(run.settings)
    budget = run.settings.time_budget or math.inf
    until = REFINEMENT_SHARE * budget if run.reflects else budget
    gathered = 0
    shown = False
    for iteration in range(count):
        # Each iteration takes longer than the one before.
        too_late = run.elapsed + 2 * run.finishing_seconds("DDL") > until
        ended = iteration > 0 and (too_late or run.mesh_finished)
        if ended and (shown or run.reflects):
            break
        last = ended or iteration == count - 1
        # One stage has to be left for the indirect light.
        shown = run.settings.stages > count - iteration or (last and not run.reflects)
        yield StagePlan("DDL", run.photons, iteration=iteration, shown=shown)
        if ended:  # so that a run without indirect light has shown something
            break
        # Departure: where photons are far off, the fewest rays show more than they or a finer mesh.
        room = run.settings.stages - run.stages_shown >= max(3, count + 1)
        if looks and iteration == 0 and room and run.indirect_error > LOOK_ERROR:
            gathered = LEAST_GATHER_RAYS * run.vertices
            yield StagePlan("gather", run.photons, gathered)
    return gathered


def _photon_steps(run: Run, component: Component, stages: int) -> Iterator[StagePlan]:
    """Photons, filtered stage by stage, until a stopping criterion."""
    for goal in stage_goals(run.settings, stages):
        # A stage that would take longer to filter than to trace is left out.
        if not goal.last and goal.seconds - run.elapsed < 1.5 * run.finishing_seconds(component):
            continue
        run.trace_until(goal, component)
        yield StagePlan(component, run.photons)


def _gather_steps(run: Run, stages: int, gathered: int) -> Iterator[StagePlan]:
    """Photons, and a gather over their light, until a stopping criterion.

    gathered : rays so far
    """
    for goal in stage_goals(run.settings, stages):
        all_but_reached = goal.photons < 1.25 * run.photons or goal.seconds < 1.25 * run.elapsed
        if all_but_reached and not goal.last:
            continue
        all_shown = True
        # The first rays tell where the others help and whether direct light holds them back.
        if gathered == 0 and (first := _first_rays(run, goal)) > 0:
            gathered = first
            all_shown = False
            yield StagePlan("gather", run.photons, gathered, shown=False)
        for _ in range(FINER_PASSES):
            if not _finer_direct_pays(run, goal, gathered):
                break
            all_shown = False
            yield StagePlan("DDL", run.photons, shown=False)
        rays = yield from _gather_stage(run, goal, gathered, all_shown)
        if rays == gathered:
            return
        gathered = rays


def _first_rays(run: Run, goal: StageGoal) -> int:
    """Of a stage that no rays came before: half of them, or a part of its time; 0: too few."""
    least = LEAST_GATHER_RAYS * run.vertices
    if goal.seconds == math.inf:
        if not goal.last:
            return 0
        run.trace_until(goal, "gather")
        return max(least, GATHER_RAYS_PER_PHOTON * run.photons // 2)
    rays = FIRST_GATHER_SHARE * (goal.seconds - run.elapsed) / run.seconds_per_gather_ray
    rays = min(rays, GATHER_RAYS_PER_PHOTON * run.photons)
    return math.ceil(rays) if rays >= least else 0


def _finer_direct_pays(run: Run, goal: StageGoal, gathered: int) -> bool:
    """Whether a finer pass over direct light gains more than as much time for rays would.

    The square error of rays falls as they grow in number; a pass leaves little of direct light's.
    """
    if gathered == 0:
        return False
    if goal.seconds == math.inf:
        known = min(1.0, gathered / (GATHER_RAYS_PER_PHOTON * goal.photons))
        return run.direct_share > DIRECT_SHARE * math.sqrt(known)
    left = goal.seconds - run.elapsed
    finer = FINER_DIRECT_SECONDS * run.finishing_seconds("DDL")
    if finer >= left:
        return False
    spent = gathered * run.seconds_per_gather_ray
    without, beside = spent / (spent + left), spent / (spent + left - finer)
    return run.direct_share**2 > beside - without


def _gather_stage(
    run: Run, goal: StageGoal, gathered: int, all_shown: bool
) -> Generator[StagePlan, None, int]:
    """Photons and rays in proportion, as far as the time goes.

    A ray is the cheaper the more there are, and before the first it counts as a photon. Halves of
    what is left to the last stage, not shown, tell how many there is time for.

    gathered : rays so far
    all_shown : what is known is; else a stage comes, however little time is left
    returns : the same after it
    """
    least = LEAST_GATHER_RAYS * run.vertices
    by_time = goal.seconds < math.inf
    halve = goal.last and by_time
    before = gathered
    while True:
        began, photons, rays = run.elapsed, goal.photons, math.inf
        planned = max(0.0, goal.seconds - began)
        if by_time:
            planned *= 1.0 if not halve else 0.5 if gathered > 0 else 0.25
            photon, ray = run.seconds_per_photon, run.seconds_per_gather_ray
            both = planned + run.photons * photon + gathered * ray
            photons = min(photons, both // (photon + GATHER_RAYS_PER_PHOTON * ray))
            rays = planned / ray
            if halve and rays < least:
                halve = False
                continue
            if all_shown and goal.last and rays < least and 0 < gathered == before:
                return gathered
        run.trace_until(StageGoal(photons, goal.seconds, goal.last), "gather")
        rays = min(rays, GATHER_RAYS_PER_PHOTON * run.photons - gathered)
        step = StagePlan("gather", run.photons, max(least, math.ceil(rays)), shown=not halve)
        gathered += step.rays
        yield step
        if step.shown:
            return gathered
        halve = run.elapsed - began < AS_PLANNED * planned


def _radiosity_steps(run: Run) -> Iterator[StagePlan]:
    rays = FIRST_RADIOSITY_RAYS
    budget = run.settings.time_budget or math.inf
    while not run.radiosity_finished and run.elapsed < budget:
        yield StagePlan("HPR", rays=rays)
        rays *= 2
