"""Tables as data, and rendered as text, CSV or Markdown."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import IO


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Parameters
    ----------
    heading
        Heading with its unit, such as ``cost [m]``.
    right
        True if cells are aligned to the right.
    below
        True if cells move below the table, one line per row, if the terminal is too narrow.
    listed
        True if the lists of the table show the cells on a terminal instead of a column.
    short
        Heading on a terminal; empty for `heading`.
    """

    heading: str
    right: bool = False
    below: bool = False
    listed: bool = False
    short: str = ""

    @property
    def on_screen(self) -> str:
        """Heading on a terminal."""
        return self.short or self.heading


@dataclass(frozen=True)
class ItemList:
    """Names with texts under a title, one per line."""

    title: str
    items: Sequence[tuple[str, str]]


@dataclass(frozen=True)
class Table:
    """Rows under a title, with notes below.

    Parameters
    ----------
    rows
        Rows with a cell for each column.
    notes
        Notes, which may begin with a label and two spaces.
    lists
        Lists between rows and notes, on a terminal only.

    Raises
    ------
    ValueError
        If a row has another number of cells than there are columns.
    """

    title: str
    columns: Sequence[Column]
    rows: Sequence[Sequence[str]]
    notes: Sequence[str] = field(default=())
    lists: Sequence[ItemList] = field(default=())

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"Row {row} does not have {len(self.columns)} cells.")


def render_csv(table: Table) -> str:
    """Return the rows as CSV with a heading line."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([column.heading for column in table.columns])
    writer.writerows(table.rows)
    return text.getvalue()


def render_markdown(table: Table) -> str:
    """Return the table as Markdown."""
    lines = [f"**{_escape_markdown(table.title)}**", ""]
    if table.rows:
        lines.append("| " + " | ".join(_escape_cell(c.heading) for c in table.columns) + " |")
        lines.append("|" + "|".join("--:" if c.right else "---" for c in table.columns) + "|")
        lines += [
            "| " + " | ".join(_escape_cell(cell) for cell in row) + " |" for row in table.rows
        ]
        lines.append("")
    lines += [f"- {_escape_markdown(note)}" for note in table.notes]
    return "\n".join(lines) + "\n"


def _escape_cell(text: str) -> str:
    return _escape_markdown(text).replace("|", "\\|")


def _escape_markdown(text: str) -> str:
    """Return a text as one line, with Markdown characters escaped."""
    return re.sub(r"([\\`*<])", r"\\\1", " ".join(text.split()))


def render(tables: Sequence[Table], style: str, out: IO[str]) -> str:
    """Return tables as text.

    Parameters
    ----------
    tables
        At least one table. CSV contains only the last one, which has the details.
    style
        ``table``, ``csv`` or ``md``.
    out
        Output stream, whose width and colours count.
    """
    if style == "csv":
        return render_csv(tables[-1])
    if style == "md":
        return "\n".join(render_markdown(table) for table in tables)
    # CSV and Markdown must not wait for rich.
    from skillplan.views.text.terminal import render_terminal_text

    return render_terminal_text(tables, out)
