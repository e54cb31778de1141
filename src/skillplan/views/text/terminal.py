"""Tables as lines of text that fit the width of the output."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import IO

from rich.cells import cell_len, chop_cells

from skillplan.views.text.table import Column, ItemList, Table
from skillplan.views.text.wording import escape

# Lines may end after these: sequences of actions, paths and sums of facts contain no spaces.
_AFTER_LIST = re.compile(r"(?<=[,;/+|])")
_AFTER_NAME = re.compile(r"(?<=[,;/+|_.:=-])|(?=[(\[])")
_NOTE_LABEL = re.compile(r"\S{1,24}( \S+)?\s{2,}")


def make_printable(text: str) -> str:
    """Return an escaped text with spaces instead of tabs."""
    return escape(text.replace("\t", " "))


def measure_width(text: str) -> int:
    """Return the width of the widest line of a text in terminal columns."""
    return max(cell_len(line) for line in text.split("\n"))


def measure_longest_piece(text: str, *, break_names: bool) -> int:
    """Return the smallest column width for a text whose lines end only at good places.

    Parameters
    ----------
    break_names
        True if lines may also end within names, as after the hyphen of ``monte-carlo``.
    """
    return max((cell_len(p) for p in _split_pieces(text, break_names=break_names)), default=0)


def wrap(text: str, width: int, hang: int = 0) -> list[str]:
    """Return a text in lines; its own line breaks are kept.

    Parameters
    ----------
    width
        Largest width of a line, >= 1.
    hang
        Indentation of all lines but the first, reduced to half the width if it is larger.
    """
    hang = min(hang, width // 2)
    lines: list[str] = []
    for line in text.split("\n"):
        if cell_len(line) <= (width if not lines else width - hang):
            lines.append(line if not lines else " " * hang + line)
        else:
            lines += _break_line(line, width, hang, first=not lines)
    return lines


def wrap_note(note: str, width: int) -> list[str]:
    """Return a note in lines, indented to the text after its label."""
    label = _NOTE_LABEL.match(note)
    margin = len(note) - len(note.lstrip(" "))
    return wrap(note, width, label.end() if label else margin or 2)


def _break_line(line: str, width: int, hang: int, *, first: bool) -> list[str]:
    """Return a line that is too wide as several lines."""
    body = line.lstrip(" ")
    start = line[: len(line) - len(body)][: width // 2] if first else " " * hang
    lines, current, has_words = [], start, False
    for word in _split_words(body, width - max(hang, len(start))):
        room = width - cell_len(current)
        space = " " if has_words and not word.glued else ""
        if cell_len(word.text) + len(space) <= room:
            current += space + word.text
        else:
            lines.append(current.rstrip(" "))
            current = " " * hang + word.text
        has_words = True
    return [*lines, current.rstrip(" ")]


class _Word:
    """A piece of a line; a glued piece follows the previous one without a space."""

    __slots__ = ("glued", "text")

    def __init__(self, text: str, *, glued: bool) -> None:
        self.text, self.glued = text, glued


def _split_words(body: str, room: int) -> list[_Word]:
    """Return the pieces of a line, each no wider than the room. Extra spaces are kept."""
    words: list[_Word] = []
    for gap, word in re.findall(r"( *)([^ ]+)", body):
        pieces = _split_word(word, room)
        if words and len(gap) > 1 and len(gap) + cell_len(pieces[0]) <= room:
            pieces[0] = gap[1:] + pieces[0]
        words.append(_Word(pieces[0], glued=not gap))
        words += [_Word(piece, glued=True) for piece in pieces[1:]]
    return words


def _split_word(word: str, room: int) -> list[str]:
    """Return a word in pieces that fit: whole, or broken in lists, in names, or anywhere."""
    if cell_len(word) <= room:
        return [word]
    for breaks in (_AFTER_LIST, _AFTER_NAME):
        pieces = [piece for piece in breaks.split(word) if piece]
        if all(cell_len(piece) <= room for piece in pieces):
            return pieces
    return [cut for piece in pieces for cut in chop_cells(piece, max(1, room))]


def _split_pieces(text: str, *, break_names: bool) -> Sequence[str]:
    breaks = _AFTER_NAME if break_names else _AFTER_LIST
    return [piece for word in text.split() for piece in breaks.split(word)]


DEFAULT_WIDTH = 120
"""Width of lines without COLUMNS and without a terminal."""
LEAST_WIDTH = 20
"""Smallest width; narrower terminals are treated as this wide."""

# Gaps between columns, the narrow one on narrow terminals.
_WIDE_GAP, _NARROW_GAP = 3, 2
# Smallest widths of a column of prose, preferred one first.
_PROSE_WIDTHS = (16, 12)


@dataclass(frozen=True)
class Block:
    """Columns side by side."""

    columns: tuple[int, ...]
    widths: tuple[int, ...]
    gap: int

    @property
    def width(self) -> int:
        """Width of the block."""
        return sum(self.widths) + self.gap * (len(self.widths) - 1)


@dataclass(frozen=True)
class Layout:
    """The layout of a table.

    Parameters
    ----------
    below
        Indices of columns whose cells are listed below the table, row by row.
    """

    blocks: tuple[Block, ...]
    below: tuple[int, ...] = ()


def get_output_width(out: IO[str]) -> int:
    """Return the width for lines in `out`: from COLUMNS, or the terminal, or 120."""
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


def lay_out_table(table: Table, width: int) -> Layout:
    """Return the layout of a table with at least one row for a width >= `LEAST_WIDTH`."""
    shown = [i for i, column in enumerate(table.columns) if not column.listed]
    whole = _Fit(
        table, shown, _WIDE_GAP, [_measure_natural(table, i, heading_wraps=False) for i in shown]
    )
    if whole.fits(width):
        return Layout((whole.block(),))
    stay = [i for i in shown if not table.columns[i].below] or shown[:1]
    below = tuple(i for i in shown if i not in stay)
    most = [_measure_natural(table, i, heading_wraps=False) for i in stay]
    uncut = [_measure_natural(table, i, heading_wraps=True) for i in stay]
    for gap in (_WIDE_GAP, _NARROW_GAP):
        fit = _Fit(table, stay, gap, uncut)
        if fit.fits(width):
            return Layout((fit.widened(most, width),), below)
    for prose_width in _PROSE_WIDTHS:
        last = prose_width == _PROSE_WIDTHS[-1]
        narrow = [_measure_narrowest(table, i, prose_width, break_names=last) for i in stay]
        fit = _Fit(table, stay, _NARROW_GAP, narrow)
        if fit.fits(width):
            return Layout((fit.widened(most, width),), below)
    narrow = [_measure_narrowest(table, i, _PROSE_WIDTHS[0], break_names=False) for i in stay]
    return Layout(_split_blocks(table, stay, narrow, most, width), below)


@dataclass(frozen=True)
class _Fit:
    """Columns with tentative widths."""

    table: Table
    columns: Sequence[int]
    gap: int
    widths: Sequence[int]

    def fits(self, width: int) -> bool:
        return self.block().width <= width

    def block(self) -> Block:
        return Block(tuple(self.columns), tuple(self.widths), self.gap)

    def widened(self, most: Sequence[int], width: int) -> Block:
        """Return the columns after the spare width went to the columns that wrap most."""
        widths = list(self.widths)
        for _ in range(width - self.block().width):
            wrapping = [i for i, now in enumerate(widths) if now < most[i]]
            if not wrapping:
                break
            widths[max(wrapping, key=lambda i: most[i] / widths[i])] += 1
        return Block(tuple(self.columns), tuple(widths), self.gap)


def find_key_columns(table: Table) -> tuple[int, ...]:
    """Return the leading columns that distinguish the rows of a table, or else the first."""
    whole = [i for i, column in enumerate(table.columns) if not (column.below or column.listed)]
    for count in range(1, len(whole)):
        if len({tuple(row[i] for i in whole[:count]) for row in table.rows}) == len(table.rows):
            return tuple(whole[:count])
    return tuple(whole[:1]) or (0,)


def _split_blocks(
    table: Table, columns: Sequence[int], widths: Sequence[int], most: Sequence[int], width: int
) -> tuple[Block, ...]:
    """Return blocks that repeat the key columns, or only the first if the keys are wide.

    Numbers are cut only if their column is too wide for a block of its own.
    """
    keys = [at for at, index in enumerate(columns) if index in find_key_columns(table)]
    if sum(widths[at] + _NARROW_GAP for at in keys) > width // 2:
        keys = keys[:1]
    narrow = dict(enumerate(widths))
    if len(keys) == 1:
        narrow[keys[0]] = min(widths[keys[0]], width // 2 - _NARROW_GAP)
    room = width - sum(narrow[at] + _NARROW_GAP for at in keys)
    groups: list[list[int]] = [[]]
    free = room
    for at in (at for at in range(len(columns)) if at not in keys):
        narrow[at] = min(widths[at], room)
        if groups[-1] and narrow[at] > free:
            groups.append([])
            free = room
        groups[-1].append(at)
        free -= narrow[at] + _NARROW_GAP
    blocks = []
    for group in groups:
        members = [*keys, *group]
        chosen = [narrow[at] for at in members]
        fit = _Fit(table, [columns[at] for at in members], _NARROW_GAP, chosen)
        blocks.append(fit.widened([most[at] for at in members], width))
    return tuple(blocks)


def _measure_natural(table: Table, index: int, *, heading_wraps: bool) -> int:
    """Return the width of a column in which no cell wraps."""
    heading = table.columns[index].on_screen
    head = _measure_words(heading) if heading_wraps else measure_width(heading)
    return max(head, _measure_cells(table, index))


def _measure_narrowest(table: Table, index: int, prose_width: int, *, break_names: bool) -> int:
    """Return the smallest width of a column in which cells wrap only at good places."""
    column = table.columns[index]
    heading = measure_longest_piece(column.on_screen, break_names=break_names)
    if column.right:
        return max(heading, _measure_cells(table, index))
    cells = max(measure_longest_piece(row[index], break_names=break_names) for row in table.rows)
    return max(heading, cells, min(prose_width, _measure_cells(table, index)))


def _measure_cells(table: Table, index: int) -> int:
    return max(measure_width(row[index]) for row in table.rows)


def _measure_words(heading: str) -> int:
    return max((measure_width(word) for word in heading.split()), default=0)


# A line, and whether it is printed bold.
_Line = tuple[str, bool]
# Largest width of names in a list; longer names get a line of their own.
_NAMES_WIDTH = 24


def render_terminal_text(tables: Sequence[Table], out: IO[str]) -> str:
    """Return tables as text for `out`."""
    encoding = (getattr(out, "encoding", None) or "utf-8").lower()
    rule = "\N{BOX DRAWINGS LIGHT HORIZONTAL}" if encoding.startswith("utf") else "-"
    width = get_output_width(out)
    lines = [line for table in tables for line in _list_lines(_clean(table), width, rule)]
    plain = [(text.rstrip(), bold) for text, bold in lines]
    if not out.isatty():
        return "".join(f"{text}\n" for text, _ in plain)
    return _add_bold(plain, out)


def _add_bold(lines: Sequence[_Line], out: IO[str]) -> str:
    """Return lines with escape codes for bold if the terminal supports them."""
    from rich.console import Console
    from rich.text import Text

    console = Console(file=out, highlight=False)
    texts = []
    for line, bold in lines:
        if bold and line:
            with console.capture() as marked:
                console.print(Text(line, style="bold"), soft_wrap=True, end="")
            line = marked.get()
        texts.append(f"{line}\n")
    return "".join(texts)


def _clean(table: Table) -> Table:
    """Return a table without control characters."""
    return Table(
        make_printable(table.title),
        table.columns,
        [[make_printable(cell) for cell in row] for row in table.rows],
        [make_printable(note) for note in table.notes],
        [
            ItemList(
                make_printable(items.title),
                [(make_printable(a), make_printable(b)) for a, b in items.items],
            )
            for items in table.lists
        ],
    )


def _list_lines(table: Table, width: int, rule: str) -> Iterator[_Line]:
    """Yield the lines of a table, and an empty line."""
    yield from ((line, True) for line in wrap(table.title, width, 2))
    if table.rows:
        layout = lay_out_table(table, width)
        for number, block in enumerate(layout.blocks):
            if number:
                yield "", False
            yield from _list_block_lines(table, block, rule)
        for line in _list_below(table, layout.below):
            yield from ((text, False) for text in wrap(line, width, 2))
    for items in table.lists:
        yield from ((text, False) for text in _list_item_lines(items, width))
    for note in table.notes:
        yield from ((text, False) for text in wrap_note(note, width))
    yield "", False


def _list_block_lines(table: Table, block: Block, rule: str) -> Iterator[_Line]:
    columns = [table.columns[index] for index in block.columns]
    headings = [
        wrap(column.on_screen, width) for column, width in zip(columns, block.widths, strict=True)
    ]
    # Short headings stand at the bottom, next to the numbers.
    tall = max(map(len, headings))
    headings = [[""] * (tall - len(lines)) + lines for lines in headings]
    yield from ((line, True) for line in _list_row_lines(headings, columns, block))
    yield rule * block.width, False
    for row in table.rows:
        cells = [
            wrap(row[index], width)
            for index, width in zip(block.columns, block.widths, strict=True)
        ]
        yield from ((line, False) for line in _list_row_lines(cells, columns, block))


def _list_row_lines(
    cells: Sequence[Sequence[str]], columns: Sequence[Column], block: Block
) -> Iterator[str]:
    """Yield the lines of a row."""
    for number in range(max(map(len, cells))):
        line = [
            _align(cell[number] if number < len(cell) else "", width, right=column.right)
            for cell, width, column in zip(cells, block.widths, columns, strict=True)
        ]
        yield (" " * block.gap).join(line)


def _align(text: str, width: int, *, right: bool) -> str:
    blanks = " " * (width - cell_len(text))
    return blanks + text if right else text + blanks


def _list_below(table: Table, moved: Sequence[int]) -> list[str]:
    """Return a line for each row with values in the columns below the table."""
    keys = find_key_columns(table)
    lines = []
    for row in table.rows:
        parts = [f"{table.columns[i].on_screen} {row[i]}" for i in moved if row[i] not in ("-", "")]
        if parts:
            name = " ".join(row[i] for i in keys)
            lines.append(f"{name}: {'; '.join(parts)}")
    return lines


def _list_item_lines(items: ItemList, width: int) -> Iterator[str]:
    """Yield a list under its title, with the texts aligned after the widest name."""
    yield from wrap(items.title, width, 2)
    names = [measure_width(name) for name, _ in items.items if measure_width(name) <= _NAMES_WIDTH]
    hang = 4 + max(names, default=0)
    for name, text in items.items:
        if measure_width(name) > _NAMES_WIDTH:
            yield from wrap(f"  {name}", width, 4)
            yield from wrap(" " * hang + text, width, hang)
        else:
            yield from wrap(f"  {name}".ljust(hang) + text, width, hang)
