"""What a test tells of a validated case: expected, got, error, tolerance, pass.

The `validation` fixture (tests/conftest.py) hands a test a `Validation`. Its checks fail the test
as an assert does, and put down the same figures as rows of the report.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

# Sections of the report whose rows come from tests, in its order.
CIE_171 = "CIE 171:2006"
DIRECT = "Closed forms, direct light"
GLOBAL = "Closed forms, global light"
INVARIANCE = "Conservation and invariance"
DIAGRAMS = "Goniometric diagrams"
STOCHASTIC = "Stochastic, within 4 σ"
HARD_CASES = "Hard cases"
GROUPS = (CIE_171, DIRECT, GLOBAL, INVARIANCE, DIAGRAMS, STOCHASTIC, HARD_CASES)

SIGMAS = 4.0  # a check against a standard deviation allows so many


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the report.

    case : in words
    expected, got : numbers in `unit`, or text; got is "" where the outcome of the test tells it
    error, tolerance : text, in % of expected, in σ or in the unit
    passed : None: as the test
    at, axis : place of the value along a curve, and what it counts (name and unit); or None
    relative_error : for plots; nan: none
    """

    case: str
    expected: float | str
    got: float | str
    unit: str
    error: str
    tolerance: str
    passed: bool | None
    at: float | None = None
    axis: str = ""
    relative_error: float = math.nan


class Validation:
    """Checks that assert, and are put down."""

    def __init__(self) -> None:
        self.rows: list[Row] = []

    def check(
        self,
        case: str,
        expected: ArrayLike,
        got: ArrayLike,
        *,
        relative: float | None = None,
        absolute: float | None = None,
        sigma: ArrayLike | None = None,
        unit: str = "lx",
        at: Sequence[float] | None = None,
        axis: str = "",
    ) -> None:
        """One value, or an array of them: all where `at` places them on a curve, else the worst.

        relative : tolerance, 0.01, not 1 %; of each expected value
        absolute : tolerance in the unit; the wider holds where both are given
        sigma : standard deviation of got - expected, in the unit: the tolerance is SIGMAS of it
        """
        __tracebackhide__ = True
        wanted, found, deviation = np.broadcast_arrays(
            *(np.asarray(x, float) for x in (expected, got, 0.0 if sigma is None else sigma))
        )
        wanted, found, deviation = wanted.ravel(), found.ravel(), deviation.ravel()
        allowed = np.full(wanted.shape, -1.0)
        if relative is not None:
            allowed = np.maximum(allowed, relative * np.abs(wanted))
        if absolute is not None:
            allowed = np.maximum(allowed, absolute)
        if sigma is not None:
            allowed = np.maximum(allowed, SIGMAS * deviation)
        assert len(wanted) > 0 and np.all(allowed >= 0), "a check needs values and a tolerance"
        off = np.abs(found - wanted)
        passed = off <= allowed  # false for nan
        with np.errstate(divide="ignore", invalid="ignore"):
            excess = np.where(passed, off / np.where(allowed > 0, allowed, 1.0), 1e9 + off)
            in_sigmas, of_expected = off / deviation, off / np.abs(wanted)
        excess[np.isnan(excess)] = np.inf
        shown = range(len(wanted)) if at is not None else [int(excess.argmax())]
        for i in shown:
            if sigma is not None and allowed[i] == SIGMAS * deviation[i] > 0:
                error, tolerance = f"{in_sigmas[i]:.2f} σ", f"{SIGMAS:g} σ"
            elif wanted[i] != 0 and relative is not None:
                error, tolerance = percent(of_expected[i]), percent(allowed[i] / abs(wanted[i]))
            else:
                error, tolerance = f"{off[i]:.3g} {unit}", f"{allowed[i]:.3g} {unit}"
            self.rows.append(
                Row(
                    case if len(wanted) == 1 or at is not None else worst_of(case, len(wanted)),
                    float(wanted[i]),
                    float(found[i]),
                    unit,
                    error.strip(),
                    tolerance.strip(),
                    bool(passed[i]),
                    None if at is None else float(at[i]),
                    axis,
                    float((found[i] - wanted[i]) / wanted[i]) if wanted[i] != 0 else math.nan,
                )
            )
        if not passed.all():
            i = int(excess.argmax())
            place = "" if at is None else f" at {axis} {at[i]:g}"
            raise AssertionError(
                f"{case}{place}: {found[i]:.7g} {unit} for {wanted[i]:.7g}, off by {off[i]:.3g} "
                f"where {allowed[i]:.3g} is allowed; {np.count_nonzero(~passed)} of {len(passed)} "
                "values are off"
            )

    def bound(
        self,
        case: str,
        got: float,
        *,
        at_most: float | None = None,
        at_least: float | None = None,
        unit: str = "",
    ) -> None:
        """A figure that has to lie on one side of another, as the p of a χ² test above 10⁻³."""
        __tracebackhide__ = True
        sides = []
        if at_most is not None:
            sides.append((f"≤ {number(at_most)}", got <= at_most))
        if at_least is not None:
            sides.append((f"≥ {number(at_least)}", got >= at_least))
        assert sides, "a bound needs a side"
        expected = " and ".join(side for side, _ in sides)
        passed = all(holds for _, holds in sides)
        self.rows.append(Row(case, expected, float(got), unit, "", "", bool(passed)))
        assert passed, f"{case}: {got:.7g} {unit}, wanted {expected}"

    def behaviour(self, case: str, expected: str) -> None:
        """What the rest of the test asserts, in words."""
        self.rows.append(Row(case, expected, "", "", "", "", None))


def worst_of(case: str, count: int) -> str:
    return f"{case} (the worst of {count:,})"


def percent(ratio: float) -> str:
    return f"{100 * ratio:.2g} %" if abs(ratio) < 0.1 else f"{100 * ratio:.3g} %"


def number(value: float) -> str:
    """Five digits or, of whole numbers, all."""
    if abs(value - round(value)) <= 1e-9 * abs(value) and abs(value) < 1e12:
        return f"{value:,.0f}"
    return f"{value:,.0f}" if abs(value) >= 1e4 else f"{value:.5g}"
