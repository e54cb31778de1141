"""One table as data, as CSV and as Markdown."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import IO


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
    listed
        Whether the table's lists show its cells on a terminal, so that it is no column there.
    short
        What stands above on a terminal instead, where the heading is long or old; else empty.
    """

    heading: str
    right: bool = False
    below: bool = False
    listed: bool = False
    short: str = ""

    @property
    def on_screen(self) -> str:
        """What stands above on a terminal."""
        return self.short or self.heading


@dataclass(frozen=True)
class ItemList:
    """Names and texts, one a line, under a title.

    Parameters
    ----------
    title
        What they are of.
    items
        Name and text of each.
    """

    title: str
    items: Sequence[tuple[str, str]]


@dataclass(frozen=True)
class Table:
    """Rows under a title, and lines below that say what they amount to.

    Parameters
    ----------
    title
        What it shows.
    columns
        From left to right.
    rows
        One cell for each column.
    notes
        Below; what they are about may stand in front, followed by two blanks.
    lists
        Shown on a terminal only, between rows and notes.

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


def render(tables: Sequence[Table], style: str, out: IO[str]) -> str:
    """Return tables as text.

    Parameters
    ----------
    tables
        At least one; CSV holds the last only, which is the most particular.
    style
        ``table``, ``csv`` or ``md``.
    out
        Where the text will go: a terminal's width and colours count.
    """
    if style == "csv":
        return as_csv(tables[-1])
    if style == "md":
        return "\n".join(as_markdown(table) for table in tables)
    # Here and not above: CSV and Markdown must not wait for rich.
    from skillplan.views.text.terminal import as_terminal_text

    return as_terminal_text(tables, out)
