"""Collects what tests marked `validation` tell, while pytest runs, and has the report written."""

from __future__ import annotations

import time
from collections.abc import Generator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from validation.page import write_report
from validation.rows import GROUPS, Row


@dataclass(slots=True)
class Case:
    """One run of a test.

    group : section of the report
    title : what it tests, in words
    outcome : "pass", "fail" or "not run"
    reason : of what fails or isn't run
    """

    group: str
    title: str
    outcome: str = "pass"
    reason: str = ""
    rows: list[Row] = field(default_factory=list)


class Recorder:
    """The pytest plugin; the report goes to `folder`."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.cases: dict[str, Case] = {}
        self.started = time.process_time()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(
        self, item: pytest.Item, call: pytest.CallInfo[None]
    ) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        report = yield
        marker = item.get_closest_marker("validation")
        if marker is None:
            return report
        case = self.cases.setdefault(item.nodeid, Case(section_of(marker), title_of(item)))
        known = getattr(report, "wasxfail", None)  # an expected failure fails all the same
        if report.skipped and known is None:
            case.outcome = "not run"
            case.reason = str(call.excinfo.value) if call.excinfo else ""
        elif report.failed or known is not None:
            case.outcome = "fail"
            callspec = getattr(item, "callspec", None)
            of = f"[{callspec.id}] " if callspec and known is None else ""
            case.reason = known or of + first_line(call)
        if report.when == "call":
            case.rows = getattr(item, "validation_rows", [])
            if known is None and any(row.passed is False for row in case.rows):
                case.reason = ""  # the row says it
        return report

    def pytest_sessionfinish(self) -> None:
        write_report(self.folder, list(self.cases.values()), time.process_time() - self.started)


def section_of(marker: pytest.Mark) -> str:
    (group,) = marker.args
    assert group in GROUPS, f"no section {group!r} in the report"
    return group


def title_of(item: pytest.Item) -> str:
    """The test's name in words, and the first line of its docstring."""
    function = getattr(item, "function", None)
    words = (getattr(function, "__doc__", None) or "").strip().split("\n")[0].rstrip(".")
    name = getattr(item, "originalname", item.name).removeprefix("test_").replace("_", " ")
    return f"{name[0].upper()}{name[1:]}" + (f": {words}" if words else "")


def first_line(call: pytest.CallInfo[None]) -> str:
    return str(call.excinfo.value).strip().split("\n")[0] if call.excinfo else ""
