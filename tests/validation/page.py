"""Write the validation report: README.md and its plots, of what tests told and what is measured."""

from __future__ import annotations

import platform
import subprocess
from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

from validation.measured import SECTIONS, Measured, measured_tables
from validation.rows import GROUPS, HARD_CASES, Row, number

if TYPE_CHECKING:
    from validation.recorder import Case

HERE = Path(__file__).parent
FOLDED_FROM = 40  # rows of a table
SOURCES = {
    "CIE 171:2006": "The test cases of the International Commission on Illumination for lighting "
    "programs, values recomputed from the exact solutions (the published tables of 5.3 and 5.7 "
    "are partly wrong). Asked for: direct light within 1 %, indirect within 2 %, at every point.",
    "Closed forms, direct light": "Configuration factors of surfaces that shine: illuminance is "
    "exitance times factor.",
    "Closed forms, global light": "Closed rooms, spheres and plates whose interreflection can be "
    "written down.",
    "Conservation and invariance": "No flux is lost or made; and what must not change the light.",
    "Goniometric diagrams": "Light of measured luminaires, from the candela table to the receiver.",
    "Stochastic, within 4 σ": "Estimates from random samples, against a truth, in standard "
    "deviations or by χ².",
    "Hard cases": "Degenerate stages; [their page](../hard_cases/README.md) says what each is "
    "compared with, and why it fails where it does.",
}


def write_report(folder: Path, cases: Sequence[Case], seconds: float) -> None:
    """README.md and *.png in `folder`. seconds : of processor time that the tests took"""
    from validation.plots import draw_plots  # with matplotlib, which the tests do without

    folder.mkdir(parents=True, exist_ok=True)
    tables = measured_tables(HERE)
    figures = draw_plots(folder, cases, tables)
    (folder / "README.md").write_text(report(cases, tables, figures, seconds), encoding="utf-8")


def report(
    cases: Sequence[Case],
    tables: Sequence[Measured],
    figures: dict[str, list[tuple[str, str]]],
    seconds: float,
) -> str:
    """The page. figures : of each section, file names and captions"""
    sections = [heading(name, figures) + tests_of(name, cases) for name in GROUPS]
    for name in SECTIONS.values():
        of_section = [measured_table(table) for table in tables if table.section == name]
        missing = "Not measured yet.\n" if not of_section else ""
        sections.append(heading(name, figures) + missing + "\n".join(of_section))
    return f"""# Validation

Made by `make validate` from the tests themselves: each row is what a test asserts. Figures of long
runs come from the tables (CSV) beside this page, which say of which commit they are.

{provenance(seconds)}

{summary(cases, tables)}
{"".join(sections)}"""


def provenance(seconds: float) -> str:
    found = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], cwd=HERE, capture_output=True, text=True
    )
    written = [":!*.png", ":!README.md"]  # beside this file, by this run
    changed = subprocess.run(
        ["git", "diff", "--quiet", "HEAD", "--", ":/", *written], cwd=HERE, capture_output=True
    )
    commit = found.stdout.strip() or "unknown"
    return (
        f"Commit {commit}{' and changes' if changed.returncode == 1 else ''}; {processor()}, "
        f"{platform.system()}; "
        f"{seconds:.0f} s of processor time."
    )


def processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.machine()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def summary(cases: Sequence[Case], tables: Sequence[Measured]) -> str:
    """Counts of each section, and all that fails."""
    lines = ["| | rows | pass | fail | not run |", "|---|---|---|---|---|"]
    for name in GROUPS:
        outcomes = [
            outcome for case in cases if case.group == name for _, outcome in lines_of(case)
        ]
        counts = [outcomes.count(x) for x in ("pass", "fail", "not run")]
        lines.append(f"| [{name}](#{anchor(name)}) | {len(outcomes)} | " + cells(counts) + " |")
    for name in SECTIONS.values():
        of_section = [table for table in tables if table.section == name]
        rows = sum(len(table.rows) for table in of_section)
        counts = [sum(table.counts()[i] for table in of_section) for i in (0, 1)]
        lines.append(f"| [{name}](#{anchor(name)}) | {rows} | " + cells([*counts, 0]) + " |")
    failing_rows = [
        f"- **{case.group}: {row.case if row else case.title}**"
        + (f" at {place(row)}" if row and row.at is not None else "")
        + (f": {row_figures(row)}" if row and row.got != "" else "")
        + (f". {case.reason}" if case.reason else "")
        for group in GROUPS
        for case in cases
        if case.group == group
        for row, outcome in lines_of(case)
        if outcome == "fail"
    ]
    failing_rows += [
        f"- **{table.section}: {table.name}**: {fail} of {passing + fail} rows, marked in the table"
        for table in tables
        for passing, fail in [table.counts()]
        if fail
    ]
    out = "\n".join(lines) + "\n"
    if failing_rows:
        out += "\n## What fails\n\n" + "\n".join(failing_rows) + "\n"
    return out


def lines_of(case: Case) -> list[tuple[Row | None, str]]:
    """The rows of a test with their outcomes; a test that failed has a row that fails."""
    if case.outcome == "not run" or not case.rows:
        return [(None, case.outcome)]
    told = [
        (row, case.outcome if row.passed is None else "pass" if row.passed else "fail")
        for row in case.rows
    ]
    if case.outcome == "fail" and all(outcome == "pass" for _, outcome in told):
        told.append((None, "fail"))
    return told


def tests_of(group: str, cases: Iterable[Case]) -> str:
    """A table of the rows, and one of the tests that tell no figures."""
    told = [(case, row, outcome) for case in cases if case.group == group
            for row, outcome in lines_of(case)]  # fmt: skip
    with_figures = [(row, outcome) for _, row, outcome in told if row is not None]
    others = [(case, outcome) for case, row, outcome in told if row is None]
    out = ""
    if group == HARD_CASES:
        out += "| case | right behaviour | |\n|---|---|---|\n"
        for row, outcome in with_figures:
            out += "| " + cells([row.case, row.expected, shown(outcome)]) + " |\n"
    elif with_figures:
        out += (
            "| case | at | expected | got | error | tolerance | |\n|---|---|---|---|---|---|---|\n"
        )
        for case_name, of_case in groupby(with_figures, lambda told: told[0].case):
            for i, (row, outcome) in enumerate(of_case):
                at = "" if row.at is None else place(row)
                name = "" if i and row.at is not None else case_name
                out += "| " + cells([name, at, *figures_of(row), shown(outcome)]) + " |\n"
    if others:
        out += "\nTests without figures of their own:\n\n| test | |\n|---|---|\n"
        alike = Counter((case.title, case.reason, outcome) for case, outcome in others)
        for (title, reason, outcome), count in alike.items():
            name = title + (f", {count} times" if count > 1 else "")
            name += f" ({reason})" if reason else ""
            out += "| " + cells([name, shown(outcome)]) + " |\n"
    return out


def figures_of(row: Row) -> list[str]:
    """Expected, got, error, tolerance."""
    unit = f" {row.unit}" if row.unit else ""
    expected = row.expected if isinstance(row.expected, str) else number(row.expected) + unit
    got = row.got if isinstance(row.got, str) else number(row.got) + unit
    return [expected, got, row.error, row.tolerance]


def place(row: Row) -> str:
    """ "z = 2.75 m" """
    name, _, unit = row.axis.partition(", ")
    return f"{name} = {row.at:.4g} {unit}".strip()


def row_figures(row: Row) -> str:
    expected, got, error, tolerance = figures_of(row)
    return f"{got} for {expected}" + (f", off by {error} ({tolerance})" if error else "")


def shown(outcome: str) -> str:
    return "**FAILS**" if outcome == "fail" else outcome


def measured_table(table: Measured) -> str:
    alike = table.alike()
    columns = [name for name in table.rows[0] if name not in (*alike, "pass", "within")]
    out = table.prose + "\n\n" if table.prose else ""
    said = [f"{name} {value}" for name, value in alike.items()]
    if not table.has("commit"):
        said.append("**commit not told**")
    elif "commit" not in alike:
        said.append("commits differ, see the rows")
    out += f"`{table.name}.csv`: {', '.join(said)}.\n\n"
    lines = [f"| {' | '.join(columns)} | |", "|---" * (len(columns) + 1) + "|"]
    for row in table.rows:
        passed = table.passed(row)
        outcome = "" if passed is None else shown("pass" if passed else "fail")
        lines.append("| " + cells([*(row[name] for name in columns), outcome]) + " |")
    body = "\n".join(lines) + "\n"
    if len(table.rows) > FOLDED_FROM:
        body = f"<details><summary>{len(table.rows)} rows</summary>\n\n{body}\n</details>\n"
    return out + body


def heading(name: str, figures: dict[str, list[tuple[str, str]]]) -> str:
    out = f"\n## {name}\n\n"
    if name in SOURCES:
        out += SOURCES[name] + "\n\n"
    for file, caption in figures.get(name, []):
        out += f"![{caption}]({file})\n\n"
    return out


def cells(values: Iterable[object]) -> str:
    return " | ".join(str(value).replace("|", "\\|").replace("\n", " ") for value in values)


def anchor(name: str) -> str:
    """As GitHub makes them of headings."""
    kept = "".join(c for c in name.lower() if c.isalnum() or c in " -")
    return kept.strip().replace(" ", "-")
