"""When a progressive stage is due, and what a run did step by step, so that it can be replayed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal

from .settings import SolverSettings

# Photons of the first stage where only a target error is given: some hundredths of a second.
FIRST_STAGE_PHOTONS = 1 << 13

Component = Literal["DEPT", "DDL", "IDEPT", "gather", "HPR"]


@dataclass(frozen=True, slots=True)
class StagePlan:
    """A step of the solver by counts alone: the same steps give the same bits.

    component : what makes it: photon tracing (DEPT), direct lighting (DDL), photons for the
        indirect light alone (IDEPT), a gather over what is known of the light, or radiosity (HPR)
    photons : emitted since the start
    rays : budget of this step's gather or radiosity
    iteration : of the adaptive mesh; 0: direct light at the vertices
    shown : it is a progressive stage; else only a step on the way to one
    """

    component: Component
    photons: int = 0
    rays: int = 0
    iteration: int = 0
    shown: bool = True


@dataclass(frozen=True, slots=True)
class StageGoal:
    """A stage is complete at so many photons or after so much solving, whichever comes first.

    photons : emitted since the start; inf where only time counts
    seconds : of solving since the start; inf where only photons count
    last : no stage follows
    """

    photons: float
    seconds: float
    last: bool


def stage_goals(settings: SolverSettings, stages: int) -> Iterator[StageGoal]:
    """Goals of so many stages, counts or seconds that double from stage to stage.

    Endless where nothing but the target error bounds the run.
    """
    bounded = settings.photons > 0 or settings.time_budget > 0
    photons_before, index = 0.0, 0
    while True:
        index += 1
        fraction = 2.0 ** (index - stages)
        photons = math.inf
        if settings.photons > 0:
            photons = math.ceil(settings.photons * fraction)
        elif not bounded:
            photons = FIRST_STAGE_PHOTONS * 2 ** (index - 1)
        seconds = settings.time_budget * fraction if settings.time_budget > 0 else math.inf
        last = bounded and index == stages
        # Of a handful of photons, the first stages may come out equal.
        if photons > photons_before:
            yield StageGoal(photons, seconds, last)
            if photons != math.inf:
                photons_before = photons
        if last:
            return


def steps_record(steps: Sequence[StagePlan]) -> dict[str, list[Any]]:
    """Steps as a layer's dictionary keeps them: a list a field."""
    return {
        field.name: [getattr(step, field.name) for step in steps] for field in fields(StagePlan)
    }


def recorded_steps(record: Mapping[str, Sequence[Any]]) -> tuple[StagePlan, ...]:
    """The steps that `steps_record` told."""
    columns = [record[field.name] for field in fields(StagePlan)]
    return tuple(
        StagePlan(str(component), int(photons), int(rays), int(iteration), bool(shown))  # type: ignore[arg-type]
        for component, photons, rays, iteration, shown in zip(*columns, strict=True)
    )
