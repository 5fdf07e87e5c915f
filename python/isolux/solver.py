"""The composite progressive solver: orders the components and yields a solution a stage.

[Volevich 2000, §3.2-3.3]: photons first (DEPT), then at T1 deterministic direct lighting in place
of the photons' (DDL), and from T2 on the indirect light until a stopping criterion is met.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from pxr import Usd

from .adaptation import SceneAdaptation
from .components import (
    DIRECT_ACCURACY,
    FINER_DIRECT,
    FIRST_DIRECT_ACCURACY,
    AdaptiveMesh,
    Array,
    BucketErrors,
    Cancelled,
    DirectLight,
    FilteredLight,
    FinalGather,
    IndirectLight,
    PhotonTracing,
    Radiosity,
    photometric,
)
from .composite import chosen_method, steps
from .core_scene import build_core_scene
from .dark_stages import no_light_arrives, what_is_dark
from .errors import SettingsError
from .illumination import Illumination
from .photon_findings import coarse_meshes, enclosed_luminaires, inside_out_meshes
from .progress import SolveProgress, Watch, done_fraction
from .scene_description import Finding, SceneDescription
from .schedule import Component, StageGoal, StagePlan
from .settings import SolverSettings, settings_from_stage
from .solution import ProgressiveStage, RefinedMesh, Solution
from .solved_mesh import SolvedMesh
from .stage_reader import read_source
from .target_error import TargetError

# Photons are traced in calls of about this long, so that a cancelled run stops soon.
CHUNK_SECONDS = 0.1
FIRST_CHUNK_PHOTONS = 1 << 12
# Radiosity's cost grows with the square of the elements, and a reflection can't be interrupted.
RADIOSITY_ELEMENTS = 4000


class ProgressiveSolver:
    """Solves one scene; the tree is built on construction.

    scene : what was read of a stage
    settings : method, stopping criteria, filter, threads
    clock : s; decides which counts the switchover and a time budget choose, and nothing else
    raises : SettingsError where radiosity is asked for in a scene that is too large for it
    """

    def __init__(
        self,
        scene: SceneDescription,
        settings: SolverSettings,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        started = clock()
        self.scene = scene
        self.settings = settings
        self.method = chosen_method(settings)
        self.reflects = any(bool(np.any(mesh.reflectance > 0)) for mesh in scene.meshes)
        self.elapsed = 0.0
        self.radiosity_finished = False
        self.mesh_finished = False
        self._clock = clock
        self._threads = settings.threads or -1  # all
        # Radiosity divides by itself; where nothing reflects, direct lighting needs no elements.
        divide = self.method != "ddl+hpr" and (self.reflects or self.method == "dept")
        self._core_scene = build_core_scene(scene, settings, self._threads, divide=divide)
        self.vertices = int(self._core_scene.vertex_count)
        elements = self._core_scene.element_count
        self._lit = elements > 0 and self._core_scene.luminous_flux > 0
        if not self._lit:  # by direct lighting, which needs no photons: 0, exactly
            self.method, self.reflects = "ddl+hpr", False
        elif self.method == "ddl+hpr" and elements > RADIOSITY_ELEMENTS:
            raise SettingsError(
                "method",
                f"ddl+hpr for {elements:,} mesh elements",
                f"at most {RADIOSITY_ELEMENTS:,}, beyond which a reflection takes minutes",
            )
        self._solved = SolvedMesh(scene, self._core_scene)
        self._photons = PhotonTracing(self._core_scene, settings, self._threads)
        self._direct = DirectLight(self._core_scene, settings, self._threads)
        if self.method == "composite" and self.reflects and settings.output_mode == "vertex":
            self._direct.aim_at(FIRST_DIRECT_ACCURACY)
        self._light = Illumination(self._solved.areas)
        self._filtered: FilteredLight | None = None
        self._filtered_photons = 0
        self._bucket_errors = BucketErrors()
        self._mesh: AdaptiveMesh | None = None
        self._gather: FinalGather | None = None
        self._radiosity: Radiosity | None = None
        self._refined: tuple[RefinedMesh, Array, Array] | None = None
        self._steps: list[StagePlan] = []
        self._switchover = (0.0, 0, 0.0)  # T1 in s and photons, T2 in s
        self._indirect_rays = 0
        self._tracing_seconds = 0.0
        self._gather_ray_seconds = 0.0
        self._finishing: dict[str, float] = {}  # s, of each component's last step
        self._target = TargetError(settings, self.method)
        self._watch = Watch(None, lambda: False)
        self.stages_shown = 0
        self._error: float | None = None
        self.build_seconds = clock() - started

    @property
    def photons(self) -> int:
        """Emitted so far."""
        return self._photons.emitted

    @property
    def indirect_error(self) -> float:
        """Relative RMS error of the indirect light as it stands; nan: not known."""
        return self._light.rms_error_indirect

    def stages(
        self,
        on_progress: Callable[[SolveProgress], None] | None = None,
        cancelled: Callable[[], bool] = lambda: False,
        replay: Sequence[StagePlan] = (),
    ) -> Iterator[Solution]:
        """Yield one solution a progressive stage until a stopping criterion is met.

        on_progress : called several times a second
        cancelled : once true, what was computed so far makes the last stage
        replay : the steps of an earlier run (`Solution.steps`), to be made again by its counts
        """
        self._watch = Watch(on_progress, cancelled)
        photons_shown: int | None = 0  # None: the last step waits to be shown
        for step in replay or steps(self.method, self):
            self.trace_until(StageGoal(step.photons, math.inf, False), step.component)
            if cancelled() and self.photons == photons_shown:
                return  # before there was anything new to show
            try:
                self._carry_out(step)
            except Cancelled:
                if self._steps and not self._steps[-1].shown:
                    yield self._solution(self._steps[-1].component)
                return
            self._steps.append(step)
            photons_shown = self.photons if step.shown else None
            if step.shown or cancelled():
                solution = self._solution(step.component)
                yield solution
                if cancelled() or (not replay and self._target.ends(step, solution.stage)):
                    return

    def refine(self, threshold: float, iterations: int) -> Solution:
        """The light as it stands on an adaptive mesh of another threshold, as one more stage.

        Nothing is computed again: samples that are known are tested by the new threshold, so that
        vertices come where it is stricter and go where it is looser.

        threshold : difference of displayed brightness that may be lost; 1: black to white
        raises : SettingsError for a value out of its range, or before there is direct light
        """
        replace(self.settings, subdivision_threshold=threshold, subdivision_iterations=iterations)
        if self._switchover[2] == 0:
            raise SettingsError("refine", "no direct light yet", "a stage after T2")
        started = self._clock()
        mesh = self._begin_refinement(threshold)
        for _ in range(iterations):
            if not mesh.iterate(self._direct, lambda share: None):
                break
        self._refined = mesh.mesh()
        self.elapsed += self._clock() - started
        return self._solution("DDL")

    def findings(self) -> tuple[Finding, ...]:
        """What solving finds out about the stage, beside `scene.findings`."""
        if not self._lit:
            return (what_is_dark(self.scene) or no_light_arrives(),)
        if self.photons == 0:  # a method without them
            self._photons.trace(FIRST_CHUNK_PHOTONS)
        hits = self._photons.buckets.hit_counts
        meshes = self.scene.meshes
        found = [
            *inside_out_meshes(
                meshes, self._solved.layouts, hits, self._photons.buckets.ends["back_hits"]
            ),
            *enclosed_luminaires(self.scene, self._core_scene),
            *self._target.findings(),
        ]
        if self._switchover[2] == 0:  # no direct light but the photons'
            return tuple(found)
        direct_flux = photometric(self._light.direct) * self._solved.areas
        coarse = coarse_meshes(
            meshes, self._solved.layouts, hits[:, 0], self._photons.photon_flux, direct_flux
        )
        return (*found, *coarse)

    # What the order of steps depends on: composite.Run.

    @property
    def seconds_per_photon(self) -> float:
        """Of tracing, as measured."""
        return self._tracing_seconds / max(1, self.photons)

    @property
    def seconds_per_gather_ray(self) -> float:
        """As measured last; before, as long as a photon takes."""
        return self._gather_ray_seconds or max(self.seconds_per_photon, 1e-9)

    @property
    def direct_share(self) -> float:
        """Error of direct light at the vertices, where it can be finer, over the indirect's."""
        return self._light.direct_share if self.settings.output_mode == "vertex" else 0.0

    def trace_until(self, goal: StageGoal, component: Component) -> None:
        """Emit photons until the goal, with time left for the component to use them."""
        chunk = FIRST_CHUNK_PHOTONS
        if self.photons > 0 and goal.seconds <= self.finishing_seconds(component) + self.elapsed:
            return
        while self.photons < goal.photons and not self._watch.cancelled():
            started = self._clock()
            count = int(min(chunk, goal.photons - self.photons))
            self._photons.trace(count)
            seconds = max(self._clock() - started, 1e-6)
            self.elapsed += seconds
            self._tracing_seconds += seconds
            self._show_progress(component, goal.photons)
            time_left = goal.seconds - self.finishing_seconds(component) - self.elapsed
            if time_left <= 0:
                return
            chunk = max(1, int(count * min(4.0, min(CHUNK_SECONDS, time_left) / seconds)))

    def finishing_seconds(self, component: Component) -> float:
        """How long the component will take to turn photons into illuminance, s."""
        return self._finishing.get(component, 0.0)

    def first_iteration_seconds(self) -> float:
        """T_i0, s, of direct lighting, estimated beside the indirect light that is known."""
        started = self._clock()
        self._finishing["DDL"] = self._direct.estimated_seconds(
            photometric(self._light.indirect), self._clock
        )
        self.elapsed += self._clock() - started
        return self._finishing["DDL"]

    def _carry_out(self, step: StagePlan) -> None:
        """Make one step of the photons there are."""
        started = self._clock()
        before = self.elapsed
        carry_out = {
            "DEPT": self._filter_all,
            "DDL": self._light_directly,
            "IDEPT": self._filter_indirect,
            "gather": self._gather_indirect,
            "HPR": self._shoot,
        }[step.component]
        carry_out(step)
        self.elapsed = before + self._clock() - started
        self._finishing[step.component] = self._clock() - started
        if step.component == "gather":
            self._gather_ray_seconds = self._finishing.pop("gather") / max(1, step.rays)
        if step.component == "DDL" and (self._gather is None or step.iteration > 0):
            t1, photons, _ = self._switchover
            self._switchover = (t1 or before, photons or step.photons, self.elapsed)

    def _filter_all(self, step: StagePlan) -> None:
        """DEPT: direct and indirect light of the photons."""
        if self._filtered is None or self._filtered_photons < self.photons:
            self._filtered, self._bucket_errors = self._photons.filtered()
            self._filtered_photons = self.photons
        self._light.take_photons(self._filtered)

    def _light_directly(self, step: StagePlan) -> None:
        """DDL: direct light that replaces the photons'."""
        if step.iteration == 0:
            if self._gather is not None:
                self._sharpen_direct(self._direct.accuracy / FINER_DIRECT)
                return
            found = self._direct.at_vertices(
                photometric(self._light.indirect), lambda share: self._working("DDL")
            )
            self._light.take_direct(*found)
            if not self.reflects:
                self._light.leave_indirect_dark()
            return
        if step.iteration == 1:
            self._begin_refinement(self.settings.subdivision_threshold)
        assert self._mesh is not None
        went_on = self._mesh.iterate(self._direct, lambda share: self._working("DDL"))
        self.mesh_finished = not went_on
        self._refined = self._mesh.mesh()

    def _sharpen_direct(self, accuracy: float) -> None:
        light = self._light
        self._direct.aim_at(accuracy)
        found = self._direct.sharpened(
            light.direct,
            light.direct_error,
            photometric(light.indirect),
            self._solved.areas,
            lambda share: self._working("DDL"),
        )
        light.take_direct(*found)

    def _begin_refinement(self, threshold: float) -> AdaptiveMesh:
        light = self._light
        if self._direct.accuracy > DIRECT_ACCURACY:
            self._sharpen_direct(DIRECT_ACCURACY)
        if self._mesh is None:
            self._mesh = AdaptiveMesh(self._core_scene)
        solved = self._solved
        adaptation = SceneAdaptation(self.scene.meshes, solved.scene_layouts)
        self._mesh.begin(
            light.direct,
            light.direct_error,
            light.indirect,
            adaptation.luminance(solved.at_scene(light.total), solved.scene_areas),
            threshold,
            self._filtered,
        )
        return self._mesh

    def _filter_indirect(self, step: StagePlan) -> None:
        """IDEPT: the photons' indirect light beside deterministic direct light."""
        filtered, self._bucket_errors = self._photons.filtered()
        self._light.take_indirect_photons(filtered)

    def _gather_indirect(self, step: StagePlan) -> None:
        """Indirect light gathered from what the photons left."""
        if self._gather is None:
            self._photons.end_filtering()
            self._gather = FinalGather(self._core_scene, self.settings, self._threads)
        self._take_indirect(self._gather.gather(self._photons, self._light.direct, step.rays))

    def _shoot(self, step: StagePlan) -> None:
        """HPR: indirect light by radiosity."""
        if self._radiosity is None:
            self._radiosity = Radiosity(
                self._core_scene, self.settings, self._threads, self._direct,
                lambda share: self._working("HPR"),
            )  # fmt: skip
        self._take_indirect(self._radiosity.shoot(step.rays))
        self.radiosity_finished = self._radiosity.finished

    def _take_indirect(self, found: IndirectLight) -> None:
        self._light.take_indirect(found)
        self._indirect_rays += found.rays

    def _working(self, component: Component) -> None:
        """In the midst of a step. Raises Cancelled where the caller asked to stop."""
        if self._watch.cancelled():
            raise Cancelled
        self._show_progress(component, self.photons)

    def _show_progress(self, component: Component, photons_of_stage: float) -> None:
        if self._watch.on_progress is not None:
            fraction = done_fraction(
                self.settings, self.photons, self.elapsed, self._error, photons_of_stage
            )
            time_left = self.elapsed * (1 / fraction - 1) if fraction > 0 else None
            self._watch.on_progress(
                SolveProgress(
                    stage=self.stages_shown + 1,
                    component=component,
                    photons=self.photons,
                    rms_error=self._error,
                    elapsed=self.elapsed,
                    time_left=time_left,
                    fraction=fraction,
                )
            )

    def _solution(self, component: Component) -> Solution:
        """The light as it stands, as the next progressive stage."""
        self.stages_shown += 1
        light = self._light
        error = light.rms_error
        self._error = None if math.isnan(error) else error
        ends = self._photons.buckets.ends
        t1, t1_photons, t2 = self._switchover
        stage = ProgressiveStage(
            index=self.stages_shown,
            component=component,
            photons=ends["emitted"],
            rays=ends["rays"],
            shadow_rays=self._direct.shadow_rays,
            indirect_rays=self._indirect_rays,
            elements=len(self._refined[0].elements)
            if self._refined
            else self._core_scene.element_count,
            elapsed=self.elapsed,
            rms_error=error,
            rms_error_indirect=self.indirect_error,
            bucket_rms_error=self._bucket_errors.total,
            bucket_rms_error_indirect=self._bucket_errors.indirect,
            batch_rms_error=self._bucket_errors.batch,
            switchover_time=t1,
            switchover_photons=t1_photons,
            second_switchover_time=t2,
            absorbed=ends["absorbed"],
            back_absorbed=ends["back_absorbed"],
            escaped=ends["escaped"],
            split_by_links=ends["split"],
            absorbed_by_links=ends["unlit"],
        )
        return self._solved.solution(
            stage, self._steps, light, self._refined, self.settings.output_mode == "refined"
        )


def solve(
    stage: Usd.Stage | str | Path,
    settings: SolverSettings | None = None,
    time_code: float | None = None,
) -> Iterator[Solution]:
    """Solve a stage progressively: take as many solutions as wanted, then stop.

    stage : an open stage, or the file of one; it is not changed
    settings : None: those on the stage's RenderSettings prim, else the defaults
    time_code : at which the stage is read; None: its startTimeCode where it has one
    yields : one Solution a progressive stage
    raises : SceneError, SettingsError, PhotometryError, each naming prim or file
    """
    _, scene, chosen = read_source(
        stage, time_code, lambda opened: settings or settings_from_stage(opened)
    )
    yield from ProgressiveSolver(scene, chosen).stages()
