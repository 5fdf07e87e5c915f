"""Tables of long runs: made by hand with tools/, kept beside this file, shown as they are.

A table is a CSV file whose name begins with its section: coverage.csv, coverage_office.csv,
convergence….csv, peers….csv. Lines before the header that begin with # are prose for the report:
what was measured, with which command. A column `commit` is asked for; it, `machine` and `seeds` are
said once where they are the same in all rows. What passes and fails is counted by a column `pass`
or `within` (yes or no) or, of coverage, by `covered` and `nominal`.

Plots are made of the columns case, component, quantity, photons and covered of coverage, and of
scene, method, photons, rms, reported and bias of convergence (ratios: 0.05, not 5 %).
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

COVERAGE = "Coverage of the reported error"
CONVERGENCE = "Convergence"
PEERS = "Independent programs"
SECTIONS = {"coverage": COVERAGE, "convergence": CONVERGENCE, "peers": PEERS}
PROVENANCE = ("commit", "machine", "seeds")
# 93 to 97 % of a nominal 95 %.
COVERED_WITHIN = 0.02

TableRow = dict[str, str]


@dataclass(frozen=True, slots=True)
class Measured:
    """One table.

    prose : Markdown
    rows : every cell as text, by column
    """

    name: str
    section: str
    prose: str
    rows: list[TableRow]

    def has(self, *columns: str) -> bool:
        return set(columns) <= set(self.rows[0])

    def alike(self) -> TableRow:
        """Provenance that is the same in all rows."""
        columns = {name: {row[name] for row in self.rows} for name in PROVENANCE if self.has(name)}
        return {name: values.pop() for name, values in columns.items() if len(values) == 1}

    def passed(self, row: TableRow) -> bool | None:
        """None: the row is no test."""
        for column in ("pass", "within"):
            if column in row:
                return row[column] == "yes"
        if self.section == COVERAGE and self.has("covered", "nominal"):
            return abs(float(row["covered"]) - float(row["nominal"])) <= COVERED_WITHIN + 1e-9
        return None

    def counts(self) -> tuple[int, int]:
        """Rows that pass, and that fail."""
        outcomes = [self.passed(row) for row in self.rows]
        return outcomes.count(True), outcomes.count(False)


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
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    if not rows or any(None in row or None in row.values() for row in rows):
        raise ValueError(f"{path}: no rows, or rows of another length than the header")
    return Measured(path.stem, section, "\n".join(prose), rows)
