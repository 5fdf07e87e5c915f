"""The report of what is validated hides nothing: what fails a test fails there."""

import numpy as np
import pytest

from validation.measured import Measured, measured_tables
from validation.page import report
from validation.recorder import Case
from validation.rows import CIE_171, Validation


@pytest.mark.parametrize(
    ("expected", "got", "tolerance", "passes"),
    [
        (100.0, 100.9, {"relative": 0.01}, True),
        (100.0, 98.9, {"relative": 0.01}, False),
        (0.0, 0.5e-3, {"relative": 0.01, "absolute": 1e-3}, True),
        (0.0, 1.0e-2, {"relative": 0.01, "absolute": 1e-3}, False),
        (100.0, 107.9, {"sigma": 2.0}, True),
        (100.0, 108.1, {"sigma": 2.0}, False),
        (7, 7, {"absolute": 0}, True),
        (7, 8, {"absolute": 0}, False),
        (100.0, np.nan, {"relative": 1.0}, False),
        ([1.0, 2.0, 3.0], [1.0, 2.1, 3.0], {"relative": 0.01}, False),
    ],
)
def test_a_check_asserts_what_it_puts_down(expected, got, tolerance, passes):
    told = Validation()
    if passes:
        told.check("case", expected, got, **tolerance)
    else:
        with pytest.raises(AssertionError, match="case"):
            told.check("case", expected, got, **tolerance)
    assert [row.passed for row in told.rows] == [passes]


def test_of_many_values_the_worst_is_shown_and_along_a_curve_all():
    told = Validation()
    told.check("many", [1.0, 2.0], [1.001, 2.01], relative=0.01)
    (row,) = told.rows
    assert (row.expected, row.got) == (2.0, 2.01)
    told.check("curve", [1.0, 2.0], [1.001, 2.01], relative=0.01, at=[0.5, 1.5], axis="z, m")
    assert [r.at for r in told.rows[1:]] == [0.5, 1.5]


def test_a_bound_asserts_what_it_puts_down():
    told = Validation()
    told.bound("p", 0.5, at_least=1e-3)
    with pytest.raises(AssertionError, match="p"):
        told.bound("p", 1e-4, at_least=1e-3)
    with pytest.raises(AssertionError, match="ratio"):
        told.bound("ratio", np.nan, at_most=1.5)
    assert [row.passed for row in told.rows] == [True, False, False]


def test_what_fails_is_listed_whatever_told_of_it():
    told = Validation()
    told.check("right", 1.0, 1.0, relative=0.01)
    off = Validation()
    with pytest.raises(AssertionError):
        off.check("off", 100.0, 98.0, relative=0.01)
    page = report(
        [
            Case(CIE_171, "All is right", rows=told.rows),
            Case(CIE_171, "One is off", "fail", "known since May", off.rows),
            Case(CIE_171, "Its figures are right", "fail", "but not the rest", told.rows),
            Case(CIE_171, "No figures", "fail", "nothing to see"),
            Case(CIE_171, "Left out", "not run", "no glass"),
        ],
        [],
        {},
        1.0,
    )
    assert "| 6 | 2 | 3 | 1 |" in page
    for said in ("98 lx for 100 lx, off by 2 % (1 %). known since May", "but not the rest",
                 "nothing to see", "Left out (no glass)"):  # fmt: skip
        assert said in page
    assert page.count("**FAILS**") == 3


def test_tables_of_long_runs(tmp_path):
    (tmp_path / "coverage.csv").write_text(
        "# Two seeds.\ncase,covered,nominal,commit,seeds\na,0.96,0.95,f00d,2\nb,0.5,0.95,f00d,2\n"
    )
    (table,) = measured_tables(tmp_path)
    assert isinstance(table, Measured)
    assert table.counts() == (1, 1)
    assert table.alike() == {"commit": "f00d", "seeds": "2"}
    assert "coverage**: 1 of 2 rows" in report([], [table], {}, 1.0)
    (tmp_path / "other.csv").write_text("a\n1\n")
    with pytest.raises(ValueError, match="other"):
        measured_tables(tmp_path)
