"""Tables: what they refuse, and how they become CSV, Markdown and lines on a terminal."""

from __future__ import annotations

import csv
import io
import re

import pytest

from skillplan.views import Column, Table, render, render_csv, render_markdown

AWKWARD = ["a,b", 'say "so"', "two\nlines", "a | b", "[bold]x[/bold]", "`code`", "back\\slash"]


@pytest.fixture
def awkward_table():
    """Cells that mean something to CSV, Markdown or rich."""
    columns = [Column("cell"), Column("length [-]", right=True)]
    rows = [(cell, str(len(cell))) for cell in AWKWARD]
    return Table("of | odd *cells*", columns, rows, ["a note with [brackets]"])


class Screen(io.StringIO):
    """A terminal of no known width: rich then asks COLUMNS."""

    def isatty(self) -> bool:
        return True


@pytest.fixture
def columns(request, monkeypatch):
    """The width of the terminal."""
    monkeypatch.setenv("COLUMNS", str(request.param))
    monkeypatch.setenv("TERM", "xterm")
    return int(request.param)


def on_screen(table: Table) -> list[str]:
    text = render([table], "table", Screen())
    return re.sub(r"\x1b\[[0-9;]*m", "", text).splitlines()


def test_a_row_has_a_cell_for_each_column():
    """A row too short is refused when the table is made."""
    with pytest.raises(ValueError, match="does not have 2 cells"):
        Table("t", [Column("a"), Column("b")], [("1",)])


def test_csv_gives_back_what_was_put_in(awkward_table):
    """Commas, quotes and line breaks survive a CSV reader."""
    rows = list(csv.reader(io.StringIO(render_csv(awkward_table)), strict=True))
    assert ["cell", "length [-]"] == rows[0]
    assert AWKWARD == [row[0] for row in rows[1:]]


def test_csv_of_several_tables_holds_the_last():
    """The most particular one; two would be no CSV."""
    tables = [Table("a", [Column("x")], [("1",)]), Table("b", [Column("y")], [("2",)])]
    assert "y\n2\n" == render(tables, "csv", io.StringIO())


def test_markdown_has_one_line_a_row(awkward_table):
    """Line breaks go, bars and code marks are escaped, brackets stay."""
    lines = render_markdown(awkward_table).splitlines()
    assert r"**of | odd \*cells\***" == lines[0]
    assert "|---|--:|" == lines[3]
    cells = [line[2 : line.rindex(" | ")] for line in lines[4 : 4 + len(AWKWARD)]]
    assert [
        "a,b",
        'say "so"',
        "two lines",
        r"a \| b",
        "[bold]x[/bold]",
        r"\`code\`",
        r"back\\slash",
    ] == cells
    assert "- a note with [brackets]" == lines[-1]


@pytest.mark.parametrize("style", ["table", "md"])
def test_a_table_without_rows_is_its_title_and_notes(style):
    """No heading stands over nothing."""
    text = render([Table("empty", [Column("a heading")], [], ["note"])], style, io.StringIO())
    assert "heading" not in text
    assert "empty" in text
    assert "note" in text


def test_a_redirected_table_is_plain_text(awkward_table):
    """No markup is read, nothing is lost, no blanks at the ends of lines."""
    wide = Table("wide", [Column("x")], [("y" * 500,)], ["z " * 200])
    text = render([awkward_table, wide], "table", io.StringIO())
    assert "[bold]x[/bold]" in text
    assert "y" * 500 + "z" * 200 == "".join(c for c in text.partition("wide")[2] if c in "yz")
    assert all(line == line.rstrip() for line in text.splitlines())


@pytest.fixture
def long_table():
    """Two solvers whose sequences fit no narrow terminal."""
    headings = [Column("solver"), Column("cost [m]", right=True), Column("sequence", below=True)]
    rows = [("exact", "1.5", ",".join("0123456789" * 5)), ("none", "-", "-")]
    return Table("long", headings, rows, ["label      words " + "and more words " * 8])


@pytest.mark.parametrize("columns", [60], indirect=True)
def test_what_is_long_stands_below_in_a_narrow_terminal(columns, long_table):
    """Broken after commas, under the name of its row; a row that has none has no line."""
    lines = on_screen(long_table)
    begin = next(i for i, line in enumerate(lines) if line.startswith("exact: sequence 0,1,2"))
    assert lines[begin].endswith(",")
    assert long_table.rows[0][2] == "".join(
        line.removeprefix("exact: sequence").strip() for line in lines[begin : begin + 2]
    )
    assert not any(line.startswith("none:") for line in lines)
    assert ["solver", "cost", "[m]"] == lines[1].split()


@pytest.mark.parametrize("columns", [200], indirect=True)
def test_nothing_stands_below_in_a_wide_terminal(columns, long_table):
    """One table, one line a heading."""
    lines = on_screen(long_table)
    assert ["solver", "cost", "[m]", "sequence"] == lines[1].split()
    assert lines[3].endswith(long_table.rows[0][2])


@pytest.mark.parametrize("columns", [60], indirect=True)
def test_notes_hang_under_their_text(columns, long_table):
    """Wrapped at words, below the column where the text began."""
    first, second = [line for line in on_screen(long_table) if "more words" in line][:2]
    assert first.startswith("label      words and")
    assert re.match(" {11}(and|more|words) ", second)
    assert max(len(first), len(second)) <= 60


@pytest.mark.parametrize("columns", [52], indirect=True)
def test_figures_are_whole_while_prose_wraps(columns):
    """The column of words gives way."""
    headings = [Column("name"), Column("length [m]", right=True), Column("reason")]
    table = Table("t", headings, [("a_rather_long_name", "1.23456", "because it is so, I say")])
    text = "\n".join(on_screen(table))
    assert "a_rather_long_name" in text
    assert "1.23456" in text
    assert "because it" in text
