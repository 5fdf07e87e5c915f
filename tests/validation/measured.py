"""Tables of long runs: made by hand with tools/, kept in measured/, shown as they are.

A table is a CSV file whose name begins with its section: coverage.csv, coverage_office.csv,
convergence….csv, programs….csv. Lines before the header that begin with # are prose for the report:
what was measured, with which command. The columns `commit`, `machine` and `seeds` are asked for;
where they are the same in all rows, the report says them once. A column `pass` (yes or no) enters
the count of what passes and fails.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

COVERAGE = "Coverage of the reported error"
CONVERGENCE = "Convergence"
PROGRAMS = "Independent programs"
SECTIONS = {"coverage": COVERAGE, "convergence": CONVERGENCE, "programs": PROGRAMS}
PROVENANCE = ("commit", "machine", "seeds")


@dataclass(frozen=True, slots=True)
class Measured:
    """One table.

    prose : Markdown
    rows : every cell as text, by column
    """

    name: str
    section: str
    prose: str
    rows: list[dict[str, str]]

    def column(self, name: str) -> list[str]:
        return [row[name] for row in self.rows]

    def alike(self) -> dict[str, str]:
        """Provenance that is the same in all rows."""
        columns = {name: set(self.column(name)) for name in PROVENANCE}
        return {name: values.pop() for name, values in columns.items() if len(values) == 1}

    @property
    def failing(self) -> list[dict[str, str]]:
        return [row for row in self.rows if row.get("pass", "yes") != "yes"]


def measured_tables(folder: Path) -> list[Measured]:
    """All tables of a folder, in the order of the sections. Raises ValueError for what is none."""
    tables = [_read(path) for path in sorted(folder.glob("*.csv"))]
    order = list(SECTIONS.values())
    return sorted(tables, key=lambda table: order.index(table.section))


def _read(path: Path) -> Measured:
    section = SECTIONS.get(path.stem.split("_")[0])
    if section is None:
        raise ValueError(f"{path}: begins with none of {', '.join(SECTIONS)}")
    lines = path.read_text(encoding="utf-8").splitlines()
    prose = [line.removeprefix("#").strip() for line in lines if line.startswith("#")]
    reader = csv.DictReader(line for line in lines if not line.startswith("#"))
    missing = set(PROVENANCE) - set(reader.fieldnames or ())
    if missing:
        raise ValueError(f"{path}: no column {', '.join(sorted(missing))}")
    rows = list(reader)
    if not rows or any(None in row or None in row.values() for row in rows):
        raise ValueError(f"{path}: no rows, or rows of another length than the header")
    return Measured(path.stem, section, "\n".join(prose), rows)
