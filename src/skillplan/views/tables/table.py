"""One table as data, as CSV and as Markdown."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Column:
    """A heading and how its cells are set.

    Parameters
    ----------
    heading
        What stands above, in ``Column("cost [m]")`` with the unit.
    right
        Whether its figures are set flush right.
    below
        Whether its cells go below the table, a line for each row, where the terminal is too
        narrow for all columns.
    """

    heading: str
    right: bool = False
    below: bool = False


@dataclass(frozen=True)
class Table:
    """Rows under a title, and lines below that say what they amount to.

    Raises
    ------
    ValueError
        If a row has another number of cells than there are columns.
    """

    title: str
    columns: Sequence[Column]
    rows: Sequence[Sequence[str]]
    notes: Sequence[str] = field(default=())

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"Row {row} does not have {len(self.columns)} cells.")


def as_csv(table: Table) -> str:
    """Return the rows as CSV with a heading line."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([column.heading for column in table.columns])
    writer.writerows(table.rows)
    return text.getvalue()


def as_markdown(table: Table) -> str:
    """Return the table as Markdown."""
    lines = [f"**{_plain(table.title)}**", ""]
    if table.rows:
        lines.append("| " + " | ".join(_cell(c.heading) for c in table.columns) + " |")
        lines.append("|" + "|".join("--:" if c.right else "---" for c in table.columns) + "|")
        lines += ["| " + " | ".join(_cell(cell) for cell in row) + " |" for row in table.rows]
        lines.append("")
    lines += [f"- {_plain(note)}" for note in table.notes]
    return "\n".join(lines) + "\n"


def _cell(text: str) -> str:
    return _plain(text).replace("|", "\\|")


def _plain(text: str) -> str:
    """Return one line in which nothing is taken for markup."""
    return re.sub(r"([\\`*<])", r"\\\1", " ".join(text.split()))
