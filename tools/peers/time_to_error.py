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


def median_time(times: Sequence[Reached | None]) -> Reached | None:
    """Of several seeds; None where half of them don't get there."""
    known = sorted((t for t in times if t is not None), key=lambda reached: reached.seconds)
    middle = len(times) // 2
    return known[middle] if middle < len(known) else None
