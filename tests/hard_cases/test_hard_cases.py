"""Every hard case behaves as its row of the table says."""

from __future__ import annotations

import pytest

from hard_cases.hard_case import FIRST_OWN, HardCase
from hard_cases.page import PAGE, label, page
from hard_cases.table import TABLE
from isolux.errors import SceneError
from validation.rows import HARD_CASES, Validation


def parameter(case: HardCase):
    known = pytest.mark.xfail(strict=True, reason=case.fails, raises=(AssertionError, SceneError))
    marks = known if case.fails else ()
    return pytest.param(case, marks=marks, id=f"{label(case)}: {case.name}")


@pytest.mark.validation(HARD_CASES)
@pytest.mark.parametrize("case", [parameter(case) for case in TABLE])
def test_hard_case(case: HardCase, validation: Validation) -> None:
    validation.behaviour(f"{label(case)}: {case.name}", case.behaviour)
    case.check()


def test_none_is_missing_and_none_has_two_rows() -> None:
    assert {case.number for case in TABLE if case.number < FIRST_OWN} == set(range(1, 29))
    assert len({label(case) for case in TABLE}) == len(TABLE)


def test_the_page_is_the_table() -> None:
    """If not: PYTHONPATH=.:tests python -m hard_cases.page"""
    assert PAGE.read_text(encoding="utf-8") == page()
