"""Tables for people: on a terminal as wide as that is, elsewhere as wide as they are."""

from __future__ import annotations

import io
import re
import textwrap
from collections.abc import Sequence
from typing import IO

from rich.box import ASCII, SIMPLE_HEAD, Box
from rich.cells import cell_len
from rich.console import Console
from rich.table import Table as Grid
from rich.text import Text

from skillplan.views.tables.table import Column, Table

# Redirected output must not be cut to the width of a terminal that is not there.
_BOUNDLESS = 10_000
# Columns stand this far apart; where the terminal is narrow, closer.
_WIDE_GAP, _NARROW_GAP = 3, 2
# What a column of prose needs to be readable.
_PROSE_WIDTH = 24


def as_terminal_text(tables: Sequence[Table], out: IO[str]) -> str:
    """Return tables as they are to stand in `out`."""
    encoding = (getattr(out, "encoding", None) or "utf-8").lower()
    box = SIMPLE_HEAD if encoding.startswith("utf") else ASCII
    if out.isatty():
        console = Console(file=out, highlight=False)
        width = console.width
    else:
        width = _BOUNDLESS
        console = Console(file=io.StringIO(), highlight=False, width=width, color_system=None)
    with console.capture() as text:
        for table in tables:
            _print(table, console, width, box)
    return "".join(f"{line.rstrip()}\n" for line in text.get().splitlines())


def _print(table: Table, console: Console, width: int, box: Box) -> None:
    console.print(Text(table.title, style="bold"))
    below: list[str] = []
    if table.rows:
        columns: Sequence[int] = range(len(table.columns))
        fits = _width(table, columns, _WIDE_GAP, headings_wrap=False) <= width
        if not fits:
            columns, below = _moved_below(table)
        console.print(_grid(table, columns, width, box, narrow=not fits))
    for note in [*below, *table.notes]:
        for line in _wrapped(note, width):
            console.print(Text(line), soft_wrap=True)
    console.print()


def _moved_below(table: Table) -> tuple[Sequence[int], list[str]]:
    """Return the columns that stay, and a line for each row that has anything in the others."""
    stay = [index for index, column in enumerate(table.columns) if not column.below]
    moved = [index for index, column in enumerate(table.columns) if column.below]
    lines = []
    for row in table.rows:
        parts = [f"{table.columns[i].heading} {row[i]}" for i in moved if row[i] not in ("-", "")]
        if parts:
            lines.append(f"{row[0]}: {'; '.join(parts)}")
    return stay, lines


def _grid(table: Table, columns: Sequence[int], width: int, box: Box, *, narrow: bool) -> Grid:
    gap = _NARROW_GAP if narrow else _WIDE_GAP
    grid = Grid(box=box, padding=(0, 1, 0, gap - 2), pad_edge=False, show_edge=False)
    # Where figures and names fit uncut, only prose is wrapped.
    uncut = narrow and _width(table, columns, gap, headings_wrap=True) <= width
    for index in columns:
        column = table.columns[index]
        heading = _stacked(column) if narrow else column.heading
        grid.add_column(
            Text(heading),
            justify="right" if column.right else "left",
            overflow="fold",
            no_wrap=uncut and not _is_prose(table, index),
        )
    for row in table.rows:
        grid.add_row(*(Text(row[index]) for index in columns))
    return grid


def _width(table: Table, columns: Sequence[int], gap: int, *, headings_wrap: bool) -> int:
    total = gap * (len(columns) - 1)
    for index in columns:
        column = table.columns[index]
        heading = _stacked(column) if headings_wrap else column.heading
        width = max(cell_len(line) for line in heading.split("\n"))
        cells = max(cell_len(row[index]) for row in table.rows)
        if headings_wrap and _is_prose(table, index):
            cells = min(cells, _PROSE_WIDTH)
        total += max(width, cells)
    return total


def _is_prose(table: Table, index: int) -> bool:
    return not table.columns[index].right and any(" " in row[index] for row in table.rows)


def _stacked(column: Column) -> str:
    """Return a heading with its unit on a line of its own."""
    return column.heading.replace(" [", "\n[")


def _wrapped(note: str, width: int) -> list[str]:
    """Return a note in lines that hang under its text.

    A note with a word that fits no line, such as a long sequence, is left to the terminal, so
    that it can be copied.
    """
    label = re.match(r"\S{1,24}( \S+)?\s{2,}", note)
    hang = label.end() if label else 2
    if len(note) <= width or max(map(len, note.split())) > width - hang:
        return [note]
    return textwrap.wrap(
        note,
        width,
        subsequent_indent=" " * hang,
        break_long_words=False,
        break_on_hyphens=False,
    )
