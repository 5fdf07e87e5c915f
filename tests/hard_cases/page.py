"""Write README.md beside this file from the table of hard cases.

PYTHONPATH=.:tests python -m hard_cases.page            write it
PYTHONPATH=.:tests python -m hard_cases.page --check    exit 1 where it differs from the table
"""

from __future__ import annotations

import sys
from pathlib import Path

from hard_cases.hard_case import FIRST_OWN, HardCase
from hard_cases.table import TABLE

PAGE = Path(__file__).with_name("README.md")
HEADER = "| # | case | right behaviour | compared with | |\n|---|---|---|---|---|\n"


def page() -> str:
    """The page as it should be."""
    of_reference = [case for case in TABLE if case.number < FIRST_OWN]
    own = [case for case in TABLE if case.number >= FIRST_OWN]
    failing = [case for case in TABLE if case.fails]
    rows = "\n".join(f"- **{label(case)}, {case.name}:** {case.fails}." for case in failing)
    why = f"## What fails, and why\n\n{rows}\n\n" if failing else ""
    return f"""# Hard cases

Made from the table in this folder by `PYTHONPATH=.:tests python -m hard_cases.page`; a test
compares the two. Each row is a small stage, solved, and compared with something that is known
without the solver. `pytest tests/hard_cases` runs them all: what fails here has to fail there, so
that a row changes once the solver does.

{len(TABLE)} checks, {len(TABLE) - len(failing)} pass, {len(failing)} fail.

{why}## The engineering reference's cases

{HEADER}{"".join(map(row, of_reference))}
## Those that we met

{HEADER}{"".join(map(row, own))}"""


def label(case: HardCase) -> str:
    return f"{case.number}{case.part}"


def row(case: HardCase) -> str:
    cells = (label(case), case.name, case.behaviour, case.truth, "fails" if case.fails else "pass")
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |\n"


def main() -> int:
    if "--check" in sys.argv[1:]:
        return int(PAGE.read_text(encoding="utf-8") != page())
    PAGE.write_text(page(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
