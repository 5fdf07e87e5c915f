"""How far a run has come, for whoever waits for it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from .settings import SolverSettings


@dataclass(frozen=True, slots=True)
class SolveProgress:
    """How far a run has come.

    stage : index of the stage in progress
    component : that is at work
    photons : emitted so far
    rms_error : of the last complete stage; None before it
    elapsed : s of solving so far
    time_left : s, estimated; None where it can't be told yet
    fraction : of the whole run, in [0, 1], estimated
    """

    stage: int
    component: str
    photons: int
    rms_error: float | None
    elapsed: float
    time_left: float | None
    fraction: float


@dataclass(frozen=True, slots=True)
class Watch:
    """The caller's eye on a run."""

    on_progress: Callable[[SolveProgress], None] | None
    cancelled: Callable[[], bool]


def done_fraction(
    settings: SolverSettings,
    photons: int,
    elapsed: float,
    rms_error: float | None,
    photons_of_stage: float,
) -> float:
    """Share of the whole run that is done, in [0, 1], by whichever stopping criterion is nearest.

    rms_error : of the last complete stage; None before it
    photons_of_stage : at which the stage in progress is complete
    """
    shares = [0.0]
    if settings.photons > 0:
        shares.append(photons / settings.photons)
    if settings.time_budget > 0:
        shares.append(elapsed / settings.time_budget)
    if settings.target_error > 0 and rms_error:
        # The error falls with the root of the photon count at most.
        goal_before = max(1.0, photons_of_stage / 2)
        needed = goal_before * max(1.0, (rms_error / settings.target_error) ** 2)
        shares.append(photons / max(needed, photons, 1))
    return min(1.0, max(shares))
