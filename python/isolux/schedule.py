"""When a progressive stage is due: photon counts or seconds that double from stage to stage."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from .settings import SolverSettings

# Photons of the first stage where only a target error is given: some hundredths of a second.
FIRST_STAGE_PHOTONS = 1 << 13


@dataclass(frozen=True, slots=True)
class StageGoal:
    """A stage is complete at so many photons or after so much solving, whichever comes first.

    index : 1, 2, ...
    photons : emitted since the start; inf where only time counts
    seconds : of solving since the start; inf where only photons count
    last : no stage follows
    may_stop : a target error that is met at this stage ends the run
    """

    index: int
    photons: float
    seconds: float
    last: bool
    may_stop: bool


def stage_goals(settings: SolverSettings) -> Iterator[StageGoal]:
    """Goals of all stages; endless where nothing but the target error bounds the run.

    A target error alone still gives `settings.stages` stages: the early ones cost next to nothing.
    """
    bounded = settings.photons > 0 or settings.time_budget > 0
    photons_before, index = 0.0, 0
    while True:
        index += 1
        fraction = 2.0 ** (index - settings.stages)
        photons = math.inf
        if settings.photons > 0:
            photons = math.ceil(settings.photons * fraction)
        elif not bounded:
            photons = FIRST_STAGE_PHOTONS * 2 ** (index - 1)
        seconds = settings.time_budget * fraction if settings.time_budget > 0 else math.inf
        last = bounded and index == settings.stages
        # Of a handful of photons, the first stages may come out equal.
        if photons > photons_before:
            yield StageGoal(
                index, photons, seconds, last, may_stop=bounded or index >= settings.stages
            )
            if photons != math.inf:
                photons_before = photons
        if last:
            return
