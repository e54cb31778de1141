"""No line is wider than the output: how columns share a width, whatever stands in them."""

from __future__ import annotations

import io
import os
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len

from skillplan.views import (
    DEFAULT_WIDTH,
    LEAST_WIDTH,
    Column,
    ItemList,
    Table,
    escape,
    get_output_width,
    lay_out_table,
    render,
)


class Screen(io.StringIO):
    """A terminal without a file descriptor."""

    def isatty(self) -> bool:
        return True


class TestOutputWidth:
    @pytest.mark.parametrize("out", [io.StringIO(), Screen()])
    def test_columns_counts_before_all_else(self, monkeypatch, out):
        """On a terminal and in a pipe alike."""
        monkeypatch.setenv("COLUMNS", "77")
        assert 77 == get_output_width(out)

    @pytest.mark.parametrize("columns", ["", "wide", "0", "-5"])
    def test_columns_that_are_no_width_say_nothing(self, monkeypatch, columns):
        monkeypatch.setenv("COLUMNS", columns)
        assert DEFAULT_WIDTH == get_output_width(io.StringIO())

    def test_a_terminal_that_knows_its_width_is_believed(self):
        ours, theirs = os.openpty()
        try:
            with open(theirs, "w", closefd=False) as out:
                os.set_blocking(ours, False)
                import fcntl
                import struct
                import termios

                fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 93, 0, 0))
                assert 93 == get_output_width(out)
        finally:
            os.close(ours)
            os.close(theirs)

    def test_a_terminal_of_no_size_is_as_wide_as_a_pipe(self):
        assert DEFAULT_WIDTH == get_output_width(Screen())

    def test_nothing_is_narrower_than_the_least(self, monkeypatch):
        monkeypatch.setenv("COLUMNS", "3")
        assert LEAST_WIDTH == get_output_width(io.StringIO())


def a_table(rows: list[tuple[str, ...]], *, below: bool = False) -> Table:
    """Return a table of a name, a figure, a sentence and a long list."""
    columns = [
        Column("solver"),
        Column("cost [m]", right=True),
        Column("reason"),
        Column("sequence", below=below),
    ]
    return Table("solvers", columns, rows)


ROW = ("branch-and-cut", "1.86709", "stopped by the limit of time", "0,1,2,3,4,5,6,7,8,9,10,11")


class TestLayout:
    def test_what_fits_is_as_wide_as_its_cells(self):
        """With all columns in their places, even those that might go below."""
        layout = lay_out_table(a_table([ROW], below=True), 120)
        assert ((14, 8, 28, 25),) == tuple(block.widths for block in layout.blocks)
        assert () == layout.below

    def test_what_may_go_below_goes_first(self):
        layout = lay_out_table(a_table([ROW], below=True), 60)
        assert (3,) == layout.below
        assert [(0, 1, 2)] == [block.columns for block in layout.blocks]

    def test_words_wrap_before_figures_are_cut(self):
        """The figure keeps its width, the name too; only its heading wraps."""
        (block,) = lay_out_table(a_table([ROW]), 62).blocks
        assert (len(ROW[0]), len(ROW[1])) == block.widths[:2]
        assert block.width <= 62

    def test_what_does_not_fit_side_by_side_is_cut_into_blocks(self):
        """Each begins with the column that tells rows apart."""
        other = ("exact", *ROW[1:])
        blocks = lay_out_table(a_table([ROW, other]), 40).blocks
        assert len(blocks) > 1
        assert {0} == {block.columns[0] for block in blocks}
        assert [1, 2, 3] == [index for block in blocks for index in block.columns[1:]]

    def test_names_of_two_columns_begin_every_block(self):
        """Where the first alone does not tell rows apart."""
        columns = [Column(heading) for heading in ("kind", "name", "what it does", "why")]
        rows = [("solver", name, "a sentence of words", "x" * 30) for name in ("exact", "auto")]
        blocks = lay_out_table(Table("t", columns, rows), 50).blocks
        assert len(blocks) > 1
        assert {(0, 1)} == {block.columns[:2] for block in blocks}

    def test_a_listed_column_is_none_on_a_terminal(self):
        table = Table("t", [Column("a"), Column("b", listed=True)], [("1", "2" * 500)])
        assert [(0,)] == [block.columns for block in lay_out_table(table, 80).blocks]


CELL = st.one_of(
    st.text(st.characters(codec="utf-8"), max_size=40),
    st.lists(
        st.sampled_from(["0", "12", "place(pcb)", "a-b", "\N{CJK UNIFIED IDEOGRAPH-4E00}"])
    ).map(",".join),
    st.text("ab ,-_/(", max_size=120),
)


@st.composite
def tables(draw: st.DrawFn) -> Table:
    """Any table, with notes and lists."""
    columns = draw(
        st.lists(
            st.builds(Column, CELL, right=st.booleans(), below=st.booleans(), listed=st.booleans()),
            min_size=1,
            max_size=6,
        )
    )
    columns[0] = Column(columns[0].heading, columns[0].right)
    row = st.tuples(*(CELL for _ in columns))
    items = st.lists(st.tuples(CELL, CELL), max_size=3)
    return Table(
        draw(CELL),
        columns,
        draw(st.lists(row, max_size=4)),
        draw(st.lists(CELL, max_size=3)),
        draw(st.lists(st.builds(ItemList, CELL, items), max_size=2)),
    )


@given(tables(), st.integers(LEAST_WIDTH, 130))
def test_no_line_is_wider_than_the_output(table, width):
    """Whatever stands in cells, notes, headings and lists."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", str(width))
        text = render([table], "table", io.StringIO())
    assert all(cell_len(line) <= width for line in text.split("\n"))


@given(tables(), st.integers(LEAST_WIDTH, 130))
def test_nothing_but_blanks_is_lost(table, width):
    """Every visible character of the cells that are shown stands in the output."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", str(width))
        text = render([table], "table", io.StringIO())
    shown = [i for i, column in enumerate(table.columns) if not column.listed]
    for row in table.rows:
        for i in shown:
            if row[i] not in ("-", ""):
                assert not set(re.sub(r"\s", "", escape(row[i]))) - set(text)
