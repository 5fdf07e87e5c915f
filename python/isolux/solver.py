"""The progressive solver: orders the compiled components and yields a solution a stage.

So far DEPT alone [Volevich 2000, §3.1.3]: photon tracing, filtered for each stage.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Usd

from . import _core
from .errors import SceneError
from .scene_description import Finding, GoniometricDiagram, SceneDescription
from .schedule import StageGoal, stage_goals
from .settings import SolverSettings, settings_from_stage
from .solution import MeshLayout, ProgressiveStage, Solution
from .stage_reader import read_stage

# Photons are traced in calls of about this long, so that a cancelled run stops soon.
CHUNK_SECONDS = 0.1
FIRST_CHUNK_PHOTONS = 1 << 12
# A one-sided mesh is taken to be turned inside out where so many photons met it, mostly its back.
INSIDE_OUT_PHOTONS = 100


@dataclass(frozen=True, slots=True)
class SolveProgress:
    """How far a run has come.

    stage : index of the stage in progress
    photons : emitted so far
    rms_error : of the last complete stage; None before it
    elapsed : s of solving so far
    time_left : s, estimated; None where it can't be told yet
    fraction : of the whole run, in [0, 1], estimated
    """

    stage: int
    photons: int
    rms_error: float | None
    elapsed: float
    time_left: float | None
    fraction: float


class ProgressiveSolver:
    """Solves one scene; the tree is built on construction.

    scene : what was read of a stage
    settings : stopping criteria, filter, threads
    clock : s; decides which photon counts a time budget allows, and nothing else
    raises : SceneError where the scene has no mesh or no luminaire
    """

    def __init__(
        self,
        scene: SceneDescription,
        settings: SolverSettings,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        started = clock()
        require_light_and_surface(scene)
        self.scene = scene
        self.settings = settings
        self._clock = clock
        self._threads = settings.threads or -1  # all
        self._core_scene = build_core_scene(scene, settings, self._threads)
        self._layouts = _mesh_layouts(scene, self._core_scene)
        self._areas: NDArray[np.float64] = self._core_scene.vertex_areas
        self._buckets = _core.PhotonBuckets(self._core_scene)
        self._filter = _core.IlluminationFilter(self._core_scene)
        self._photons = 0
        self._elapsed = 0.0
        self._filter_seconds = 0.0
        self.build_seconds = clock() - started

    def stages(
        self,
        on_progress: Callable[[SolveProgress], None] | None = None,
        cancelled: Callable[[], bool] = lambda: False,
    ) -> Iterator[Solution]:
        """Yield one solution a progressive stage until a stopping criterion is met.

        on_progress : called several times a second
        cancelled : once true, the photons traced so far make the last stage
        """
        error: float | None = None
        index = 0
        for goal in stage_goals(self.settings):
            # A stage that filtering would take most of the time to is left out.
            time_to_goal = goal.seconds - self._elapsed
            if self._photons > 0 and not goal.last and time_to_goal < 1.5 * self._filter_seconds:
                continue
            self._trace_until(goal, error, on_progress, cancelled)
            index += 1
            solution = self._solution(index)
            error = solution.stage.rms_error
            yield solution
            # An inactive target of 0 is not met by an error of 0, such as that of a dark stage.
            target = self.settings.target_error
            target_met = goal.may_stop and target > 0 and error <= target
            if target_met or cancelled():
                return

    def findings(self) -> tuple[Finding, ...]:
        """What the photons found out about the stage, beside `scene.findings`."""
        hits = self._buckets.hit_counts
        fronts = np.array([hits[self._layouts[m.path].front].sum() for m in self.scene.meshes])
        backs = np.array(self._buckets.ends["back_hits"])
        inside_out = (backs > fronts) & (backs + fronts >= INSIDE_OUT_PHOTONS)
        return tuple(
            Finding(
                self.scene.meshes[i].path,
                "orientation",
                "noted",
                f"{backs[i] / (backs[i] + fronts[i]):.0%} of the photons that met the mesh met its "
                "back, which absorbs them: check orientation, or set doubleSided",
            )
            for i in np.flatnonzero(inside_out)
        )

    def _trace_until(
        self,
        goal: StageGoal,
        error: float | None,
        on_progress: Callable[[SolveProgress], None] | None,
        cancelled: Callable[[], bool],
    ) -> None:
        """Trace photons until the goal, leaving time for the filter."""
        chunk = FIRST_CHUNK_PHOTONS
        deadline = goal.seconds - self._filter_seconds
        while self._photons < goal.photons and not cancelled():
            started = self._clock()
            count = int(min(chunk, goal.photons - self._photons))
            _core.trace_photons(
                self._core_scene,
                self._buckets,
                self.settings.seed,
                self._photons,
                count,
                self._threads,
            )
            seconds = max(self._clock() - started, 1e-6)
            self._photons += count
            self._elapsed += seconds
            if on_progress is not None:
                on_progress(self._progress(goal, error))
            if self._elapsed >= deadline:
                return
            chunk_seconds = min(CHUNK_SECONDS, deadline - self._elapsed)
            chunk = max(1, int(count * min(4.0, chunk_seconds / seconds)))

    def _progress(self, goal: StageGoal, error: float | None) -> SolveProgress:
        settings = self.settings
        shares = [0.0]
        if settings.photons > 0:
            shares.append(self._photons / settings.photons)
        if settings.time_budget > 0:
            shares.append(self._elapsed / settings.time_budget)
        if settings.target_error > 0 and error:
            # The error falls with the root of the photon count at most.
            goal_before = max(1.0, goal.photons / 2)
            needed = goal_before * max(1.0, (error / settings.target_error) ** 2)
            shares.append(self._photons / max(needed, self._photons))
        fraction = min(1.0, max(shares))
        time_left = self._elapsed * (1 / fraction - 1) if fraction > 0 else None
        return SolveProgress(goal.index, self._photons, error, self._elapsed, time_left, fraction)

    def _solution(self, index: int) -> Solution:
        """Filter what was traced so far into the solution of one stage."""
        started = self._clock()
        settings = self.settings
        filtered = self._filter.filter(
            self._core_scene,
            self._buckets,
            settings.filter_accuracy,
            settings.filter_sharing,
            settings.filter_interval == "paper",
            self._threads,
        )
        self._filter_seconds = self._clock() - started
        self._elapsed += self._filter_seconds
        ends = self._buckets.ends
        stage = ProgressiveStage(
            index=index,
            component="DEPT",
            photons=ends["emitted"],
            rays=ends["rays"],
            elements=self._core_scene.element_count,
            elapsed=self._elapsed,
            rms_error=filtered["rms_error"],
            rms_error_indirect=filtered["rms_error_indirect"],
            bucket_rms_error=filtered["bucket_rms_error"],
            bucket_rms_error_indirect=filtered["bucket_rms_error_indirect"],
            batch_rms_error=filtered["batch_rms_error"],
            absorbed=ends["absorbed"],
            back_absorbed=ends["back_absorbed"],
            escaped=ends["escaped"],
        )
        return Solution(
            stage=stage,
            scene=self.scene,
            layouts=self._layouts,
            direct=filtered["direct"],
            indirect=filtered["indirect"],
            relative_deviation=filtered["relative_deviation"],
            support_radius=filtered["support_radius"],
            vertex_areas=self._areas,
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
    with Usd.StageCacheContext(Usd.StageCache()):
        scene = read_stage(stage, time_code)
        if settings is None:
            # The stage just read, out of the cache.
            opened = stage if isinstance(stage, Usd.Stage) else Usd.Stage.Open(str(stage))
            settings = settings_from_stage(opened)
    yield from ProgressiveSolver(scene, settings).stages()


def require_light_and_surface(scene: SceneDescription, subject: str = "stage") -> None:
    """Raise SceneError where there is nothing to light, or nothing that gives light.

    subject : the stage's name for the message
    """
    skipped = ", ".join(
        sorted({finding.kind for finding in scene.findings if finding.action == "skipped"})
    )
    but = f" (skipped: {skipped})" if skipped else ""
    if not scene.meshes:
        raise SceneError(subject, f"no mesh to light{but}", "at least one visible polygon mesh")
    if not scene.luminaires:
        raise SceneError(
            subject,
            f"no luminaire{but}",
            "at least one visible SphereLight, DiskLight, RectLight or CylinderLight",
        )


def build_core_scene(
    scene: SceneDescription, settings: SolverSettings, threads: int
) -> _core.Scene:
    """The compiled scene: meshes tessellated, the ray tracing tree built by so many threads."""
    builder = _core.SceneBuilder(math.radians(settings.crease_angle))
    for mesh in scene.meshes:
        builder.add_mesh(
            mesh.points,
            mesh.face_vertex_counts,
            mesh.face_vertex_indices,
            mesh.corner_normals,
            mesh.hole_faces,
            mesh.reflectance,
            mesh.double_sided,
            mesh.flip_winding,
        )
    for luminaire in scene.luminaires:
        builder.add_luminaire(
            luminaire.shape,
            luminaire.origin,
            luminaire.axes,
            luminaire.size,
            luminaire.colour,
            luminaire.luminous_flux,
            _candela_distribution(luminaire.diagram),
        )
    return builder.build(threads)


def _candela_distribution(
    diagram: GoniometricDiagram | None,
) -> _core.CandelaDistribution | None:
    if diagram is None:
        return None
    return _core.CandelaDistribution(diagram.gamma, diagram.c_angles, diagram.candela)


def _mesh_layouts(scene: SceneDescription, core_scene: _core.Scene) -> dict[str, MeshLayout]:
    return {
        mesh.path: MeshLayout(slice(begin, middle), slice(middle, end), corner_vertices)
        for mesh, (begin, middle, end, corner_vertices) in zip(
            scene.meshes, core_scene.mesh_ranges, strict=True
        )
    }
