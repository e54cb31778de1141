"""How wide output may be, and how the columns of a table share that.

This is the one place that decides widths. Of these forms of a table the first that fits counts:

1. every column as wide as its widest cell;
2. columns that may stand below the table do, and headings wrap;
3. cells of words and lists wrap, figures stay whole; names wrap last;
4. the table is cut into blocks of columns, each begun by the columns that distinguish rows.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import IO

from skillplan.views.text.table import Table
from skillplan.views.text.text_wrapping import longest_piece, text_width

DEFAULT_WIDTH = 120
"""Columns of a line where neither COLUMNS nor a terminal says otherwise."""
LEAST_WIDTH = 20
"""A terminal that claims to be narrower is taken to be this wide."""

# Columns stand this far apart; where the terminal is narrow, closer.
_WIDE_GAP, _NARROW_GAP = 3, 2
# What a column of prose has at least: to be read well, and at worst.
_PROSE_WIDTHS = (16, 12)


@dataclass(frozen=True)
class Block:
    """Columns that stand side by side.

    Parameters
    ----------
    columns
        Their indices, from left to right.
    widths
        How wide each of them is.
    gap
        How far apart they stand.
    """

    columns: tuple[int, ...]
    widths: tuple[int, ...]
    gap: int

    @property
    def width(self) -> int:
        """How wide the block is."""
        return sum(self.widths) + self.gap * (len(self.widths) - 1)


@dataclass(frozen=True)
class Layout:
    """How a table is shown.

    Parameters
    ----------
    blocks
        One, or several below one another.
    below
        Indices of columns whose cells stand below the table, row by row.
    """

    blocks: tuple[Block, ...]
    below: tuple[int, ...] = ()


def output_width(out: IO[str]) -> int:
    """Return how wide lines in `out` may be: by COLUMNS, else by the terminal, else 120."""
    try:
        width = int(os.environ.get("COLUMNS", ""))
    except ValueError:
        width = 0
    if width <= 0 and out.isatty():
        try:
            width = os.get_terminal_size(out.fileno()).columns
        except (OSError, ValueError):
            width = 0
    return max(LEAST_WIDTH, width) if width > 0 else DEFAULT_WIDTH


def table_layout(table: Table, width: int) -> Layout:
    """Return how a table is shown in a width.

    Parameters
    ----------
    table
        With at least one row.
    width
        The most columns of a line, >= `LEAST_WIDTH`.
    """
    shown = [i for i, column in enumerate(table.columns) if not column.listed]
    whole = _Fit(table, shown, _WIDE_GAP, [_natural(table, i, heading_wraps=False) for i in shown])
    if whole.fits(width):
        return Layout((whole.block(),))
    stay = [i for i in shown if not table.columns[i].below] or shown[:1]
    below = tuple(i for i in shown if i not in stay)
    most = [_natural(table, i, heading_wraps=False) for i in stay]
    uncut = [_natural(table, i, heading_wraps=True) for i in stay]
    for gap in (_WIDE_GAP, _NARROW_GAP):
        fit = _Fit(table, stay, gap, uncut)
        if fit.fits(width):
            return Layout((fit.widened(most, width),), below)
    for prose_width in _PROSE_WIDTHS:
        last = prose_width == _PROSE_WIDTHS[-1]
        least = [_least(table, i, prose_width, break_names=last) for i in stay]
        fit = _Fit(table, stay, _NARROW_GAP, least)
        if fit.fits(width):
            return Layout((fit.widened(most, width),), below)
    least = [_least(table, i, _PROSE_WIDTHS[0], break_names=False) for i in stay]
    return Layout(_blocks(table, stay, least, most, width), below)


@dataclass(frozen=True)
class _Fit:
    """Columns with widths that may or may not fit."""

    table: Table
    columns: Sequence[int]
    gap: int
    widths: Sequence[int]

    def fits(self, width: int) -> bool:
        return self.block().width <= width

    def block(self) -> Block:
        return Block(tuple(self.columns), tuple(self.widths), self.gap)

    def widened(self, most: Sequence[int], width: int) -> Block:
        """Return the columns with what is left of a width given to those that wrap most."""
        widths = list(self.widths)
        for _ in range(width - self.block().width):
            wanting = [i for i, now in enumerate(widths) if now < most[i]]
            if not wanting:
                break
            widths[max(wanting, key=lambda i: most[i] / widths[i])] += 1
        return Block(tuple(self.columns), tuple(widths), self.gap)


def key_columns(table: Table) -> tuple[int, ...]:
    """Return the leading columns that distinguish the rows of a table; else the first alone."""
    whole = [i for i, one in enumerate(table.columns) if not (one.below or one.listed)]
    for count in range(1, len(whole)):
        if len({tuple(row[i] for i in whole[:count]) for row in table.rows}) == len(table.rows):
            return tuple(whole[:count])
    return tuple(whole[:1]) or (0,)


def _blocks(
    table: Table, columns: Sequence[int], least: Sequence[int], most: Sequence[int], width: int
) -> tuple[Block, ...]:
    """Return blocks begun by the columns that distinguish rows, or by the first if they are wide.

    Figures are cut only where a column of them is too wide for a block of its own.
    """
    keys = [at for at, index in enumerate(columns) if index in key_columns(table)]
    if sum(least[at] + _NARROW_GAP for at in keys) > width // 2:
        keys = keys[:1]
    narrow = dict(enumerate(least))
    if len(keys) == 1:
        narrow[keys[0]] = min(least[keys[0]], width // 2 - _NARROW_GAP)
    room = width - sum(narrow[at] + _NARROW_GAP for at in keys)
    groups: list[list[int]] = [[]]
    free = room
    for at in (at for at in range(len(columns)) if at not in keys):
        narrow[at] = min(least[at], room)
        if groups[-1] and narrow[at] > free:
            groups.append([])
            free = room
        groups[-1].append(at)
        free -= narrow[at] + _NARROW_GAP
    blocks = []
    for group in groups:
        members = [*keys, *group]
        widths = [narrow[at] for at in members]
        fit = _Fit(table, [columns[at] for at in members], _NARROW_GAP, widths)
        blocks.append(fit.widened([most[at] for at in members], width))
    return tuple(blocks)


def _natural(table: Table, index: int, *, heading_wraps: bool) -> int:
    """Return the width in which no cell wraps."""
    heading = table.columns[index].on_screen
    least = _widest_word(heading) if heading_wraps else text_width(heading)
    return max(least, _widest_cell(table, index))


def _least(table: Table, index: int, prose_width: int, *, break_names: bool) -> int:
    """Return the width in which cells wrap only where that reads well."""
    column = table.columns[index]
    heading = longest_piece(column.on_screen, break_names=break_names)
    if column.right:
        return max(heading, _widest_cell(table, index))
    cells = max(longest_piece(row[index], break_names=break_names) for row in table.rows)
    return max(heading, cells, min(prose_width, _widest_cell(table, index)))


def _widest_cell(table: Table, index: int) -> int:
    return max(text_width(row[index]) for row in table.rows)


def _widest_word(heading: str) -> int:
    return max((text_width(word) for word in heading.split()), default=0)
