"""When a program reaches an error, by its runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

# Their error halves with four times the work; the others' has a floor of its own.
MONTE_CARLO = ("mitsuba", "cycles", "luxcore", "radiance")


@dataclass(frozen=True, slots=True)
class Place:
    """One run: s, and the error as a ratio."""

    seconds: float
    error: float


@dataclass(frozen=True, slots=True)
class Reached:
    """When an error was reached.

    extrapolated : past the last run, by error ∝ seconds^-1/2
    """

    seconds: float
    extrapolated: bool = False

    def __str__(self) -> str:
        digits = max(0, 1 - math.floor(math.log10(self.seconds)))
        return f"{'~' if self.extrapolated else ''}{self.seconds:,.{digits}f}"


def time_to(goal: float, places: Sequence[Place], program: str) -> Reached | None:
    """First time at a goal by log-log interpolation; None where it is not known.

    places : in the order of their seconds
    """
    for before, after in zip([None, *places[:-1]], places, strict=True):
        if after.error > goal:
            continue
        if before is None:
            return Reached(after.seconds)
        share = math.log(before.error / goal) / math.log(before.error / after.error)
        return Reached(before.seconds * (after.seconds / before.seconds) ** share)
    if program not in MONTE_CARLO or not places:
        return None
    last = places[-1]
    return Reached(last.seconds * (last.error / goal) ** 2, extrapolated=True)


def slowest(goal: float, runs: Sequence[Sequence[Place]], program: str) -> Reached | None:
    """When the last of some runs is at a goal; None where one that went on longer never is.

    runs : some may have been stopped before: those tell nothing of what takes longer
    """
    times = [(time_to(goal, places, program), places[-1].seconds) for places in runs]
    known = [reached for reached, _ in times if reached is not None]
    last = max(known, key=lambda reached: reached.seconds, default=None)
    if last is None or any(at is None and ran > last.seconds for at, ran in times):
        return None
    return last
