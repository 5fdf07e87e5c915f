"""When a run has met its target error, and when more photons can't bring it nearer."""

from __future__ import annotations

from collections.abc import Iterator

from .scene_description import Finding
from .schedule import Component, StagePlan
from .settings import SolverSettings
from .solution import ProgressiveStage

# What coarse elements lose, no photon and no ray brings back. Of photons it is what is left where
# noise, before any filter, is below this share of the target; of rays, whose noise falls to 1/√2
# with each doubling, where two took less than so much off.
NOISE_SHARE = 0.5
DOUBLINGS, LEAST_GAIN = 2, 0.15


class TargetError:
    """The reported error of one run, stage by stage, against the one that it was asked for."""

    def __init__(self, settings: SolverSettings, method: str) -> None:
        self._target = settings.target_error
        self._bounded = settings.photons > 0 or settings.time_budget > 0
        self._stages = settings.stages
        self._photons_alone = method == "dept"
        self._component: Component | None = None
        self._errors: list[float] = []  # of the stages that this component made last
        self._out_of_reach = False

    def ends(self, step: StagePlan, stage: ProgressiveStage) -> bool:
        """Whether the run ends with this stage: the target is met, or out of reach."""
        if step.component != self._component:
            self._component, self._errors = step.component, []
        self._errors.append(stage.rms_error)
        if self._target == 0:
            return False
        if stage.rms_error <= self._target:
            return self._is_met(step.component, stage)
        self._out_of_reach = not self._bounded and self._is_floor(step.component, stage)
        return self._out_of_reach

    def findings(self) -> Iterator[Finding]:
        """What to tell of a target that was out of reach."""
        if self._out_of_reach:
            yield Finding(
                "/",
                "target error",
                "noted",
                f"{self._target:g} asked, {self._errors[-1]:.2g} reached, which no photon or ray "
                "lessens much: it is what coarse elements lose; tessellate where light varies",
            )

    def _is_floor(self, component: Component, stage: ProgressiveStage) -> bool:
        if component in ("DEPT", "IDEPT"):
            alone = component == "IDEPT" or self._photons_alone
            return alone and 0 < stage.bucket_rms_error < NOISE_SHARE * self._target
        doubled = component == "gather" and len(self._errors) > DOUBLINGS
        return doubled and self._errors[-1] > (1 - LEAST_GAIN) * self._errors[-1 - DOUBLINGS]

    def _is_met(self, component: Component, stage: ProgressiveStage) -> bool:
        if component != "DEPT":
            return component != "DDL"
        # Photons alone: the early stages cost next to nothing, and their error is uncertain.
        return self._photons_alone and (self._bounded or stage.index >= self._stages)
