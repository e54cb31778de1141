"""One table, shown as a terminal table, CSV or Markdown."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import IO

FORMATS = ("table", "json", "csv", "md")


@dataclass(frozen=True)
class Column:
    """A heading, and whether its figures are set flush right."""

    heading: str
    right: bool = False


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


def show(tables: Sequence[Table], style: str, out: IO[str]) -> None:
    """Write tables to a stream.

    Parameters
    ----------
    tables
        At least one; CSV holds the first only.
    style
        ``table``, ``csv`` or ``md``.
    """
    if style == "csv":
        out.write(as_csv(tables[0]))
    elif style == "md":
        out.write("\n".join(as_markdown(table) for table in tables))
    else:
        _show_rich(tables, out)


def as_csv(table: Table) -> str:
    """Return the rows as CSV with a heading line."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([column.heading for column in table.columns])
    writer.writerows(table.rows)
    return text.getvalue()


def as_markdown(table: Table) -> str:
    """Return the table as Markdown."""
    lines = [f"**{table.title}**", ""]
    if table.columns:
        lines.append("| " + " | ".join(_cell(c.heading) for c in table.columns) + " |")
        lines.append("|" + "|".join("--:" if c.right else "---" for c in table.columns) + "|")
        lines += ["| " + " | ".join(_cell(cell) for cell in row) + " |" for row in table.rows]
        lines.append("")
    lines += [f"- {note}" for note in table.notes]
    return "\n".join(lines) + "\n"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


def _show_rich(tables: Sequence[Table], out: IO[str]) -> None:
    # Here and not above: --help and JSON output must not pay for importing rich.
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table as RichTable
    from rich.text import Text

    console = Console(file=out, highlight=False)
    if not console.is_terminal:
        # Redirected output must not be cut to the width of a terminal that is not there.
        console = Console(file=out, highlight=False, width=10_000)
    for table in tables:
        console.print(Text(table.title, style="bold"))
        if table.columns:
            grid = RichTable(box=SIMPLE_HEAD, pad_edge=False, show_edge=False)
            for column in table.columns:
                heading = Text(column.heading)
                if column.right:
                    grid.add_column(heading, justify="right", overflow="fold")
                else:
                    grid.add_column(heading, overflow="fold")
            for row in table.rows:
                grid.add_row(*(Text(cell) for cell in row))
            console.print(grid)
        for note in table.notes:
            console.print(Text(note))
        console.print()
