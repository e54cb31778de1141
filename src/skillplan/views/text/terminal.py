"""Tables for people, in lines that are no wider than the output."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import IO

from rich.cells import cell_len

from skillplan.views.text.column_widths import (
    Block,
    key_columns,
    output_width,
    table_layout,
)
from skillplan.views.text.table import Column, ItemList, Table
from skillplan.views.text.text_wrapping import printable, text_width, wrapped, wrapped_note

# A line, and whether it is printed bold.
_Line = tuple[str, bool]
# The most columns that the names of a list's items take; longer ones have a line of their own.
_NAMES_WIDTH = 24


def as_terminal_text(tables: Sequence[Table], out: IO[str]) -> str:
    """Return tables as they are to stand in `out`."""
    encoding = (getattr(out, "encoding", None) or "utf-8").lower()
    rule = "\N{BOX DRAWINGS LIGHT HORIZONTAL}" if encoding.startswith("utf") else "-"
    width = output_width(out)
    lines = [line for table in tables for line in _lines(_cleaned(table), width, rule)]
    plain = [(text.rstrip(), bold) for text, bold in lines]
    if not out.isatty():
        return "".join(f"{text}\n" for text, _ in plain)
    return _in_bold(plain, out)


def _in_bold(lines: Sequence[_Line], out: IO[str]) -> str:
    """Return lines with the marks that make some of them bold, where the terminal knows any."""
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


def _cleaned(table: Table) -> Table:
    """Return a table of which no text moves the cursor."""
    return Table(
        printable(table.title),
        table.columns,
        [[printable(cell) for cell in row] for row in table.rows],
        [printable(note) for note in table.notes],
        [
            ItemList(printable(one.title), [(printable(a), printable(b)) for a, b in one.items])
            for one in table.lists
        ],
    )


def _lines(table: Table, width: int, rule: str) -> Iterator[_Line]:
    """Return the lines of a table, an empty one last."""
    yield from ((line, True) for line in wrapped(table.title, width, 2))
    if table.rows:
        layout = table_layout(table, width)
        for number, block in enumerate(layout.blocks):
            if number:
                yield "", False
            yield from _block_lines(table, block, rule)
        for line in _below(table, layout.below):
            yield from ((text, False) for text in wrapped(line, width, 2))
    for one in table.lists:
        yield from ((text, False) for text in _item_lines(one, width))
    for note in table.notes:
        yield from ((text, False) for text in wrapped_note(note, width))
    yield "", False


def _block_lines(table: Table, block: Block, rule: str) -> Iterator[_Line]:
    columns = [table.columns[index] for index in block.columns]
    headings = [
        wrapped(column.on_screen, width)
        for column, width in zip(columns, block.widths, strict=True)
    ]
    # What is one line high stands next to the figures.
    tall = max(map(len, headings))
    headings = [[""] * (tall - len(lines)) + lines for lines in headings]
    yield from ((line, True) for line in _row_lines(headings, columns, block))
    yield rule * block.width, False
    for row in table.rows:
        cells = [
            wrapped(row[index], width)
            for index, width in zip(block.columns, block.widths, strict=True)
        ]
        yield from ((line, False) for line in _row_lines(cells, columns, block))


def _row_lines(
    cells: Sequence[Sequence[str]], columns: Sequence[Column], block: Block
) -> Iterator[str]:
    """Return the lines of one row, as many as its highest cell has."""
    for number in range(max(map(len, cells))):
        line = [
            _aligned(cell[number] if number < len(cell) else "", width, right=column.right)
            for cell, width, column in zip(cells, block.widths, columns, strict=True)
        ]
        yield (" " * block.gap).join(line)


def _aligned(text: str, width: int, *, right: bool) -> str:
    blanks = " " * (width - cell_len(text))
    return blanks + text if right else text + blanks


def _below(table: Table, moved: Sequence[int]) -> list[str]:
    """Return a line for each row that has anything in the columns that stand below."""
    keys = key_columns(table)
    lines = []
    for row in table.rows:
        parts = [f"{table.columns[i].on_screen} {row[i]}" for i in moved if row[i] not in ("-", "")]
        if parts:
            name = " ".join(row[i] for i in keys)
            lines.append(f"{name}: {'; '.join(parts)}")
    return lines


def _item_lines(one: ItemList, width: int) -> Iterator[str]:
    """Return a list under its title, the texts flush behind the widest name."""
    yield from wrapped(one.title, width, 2)
    names = [text_width(name) for name, _ in one.items if text_width(name) <= _NAMES_WIDTH]
    hang = 4 + max(names, default=0)
    for name, text in one.items:
        if text_width(name) > _NAMES_WIDTH:
            yield from wrapped(f"  {name}", width, 4)
            yield from wrapped(" " * hang + text, width, hang)
        else:
            yield from wrapped(f"  {name}".ljust(hang) + text, width, hang)
