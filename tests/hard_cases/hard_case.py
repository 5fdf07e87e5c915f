"""What a hard case is: a small stage, the right behaviour, and a check of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

# Cases from here on are this project's own; those before are of the engineering reference.
FIRST_OWN = 29


@dataclass(frozen=True, slots=True)
class HardCase:
    """One row of the table.

    number : unique; own cases count from FIRST_OWN
    part : a letter, where a case has parts of which some fail
    name : of the case, in a few words
    behaviour : the right one
    truth : what the check compares with
    check : raises AssertionError where the behaviour is another
    fails : why the product does not do so yet; empty: it does
    """

    number: int
    part: str
    name: str
    behaviour: str
    truth: str
    check: Callable[[], None]
    fails: str = ""


CASES: list[HardCase] = []


def hard_case(
    number: int, name: str, behaviour: str, truth: str, *, part: str = "", fails: str = ""
) -> Callable[[Callable[[], None]], Callable[[], None]]:
    """Enter a check into the table; see HardCase."""

    def enter(check: Callable[[], None]) -> Callable[[], None]:
        CASES.append(HardCase(number, part, name, behaviour, truth, check, fails))
        return check

    return enter
