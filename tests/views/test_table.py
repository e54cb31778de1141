"""Tables: what they refuse, and how they become CSV, Markdown and lines on a terminal."""

from __future__ import annotations

import csv
import io
import re
import sys
import unicodedata
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure
from rich.cells import cell_len

from skillplan.physics import Arrival, Performance, PerformedSkill
from skillplan.records import PlannedTimes, Simulation
from skillplan.task import Pose, Verdict
from skillplan.views import (
    Column,
    Table,
    escape,
    format_evidence,
    make_printable,
    render,
    render_csv,
    render_markdown,
    wrap,
    wrap_note,
)
from skillplan.views.figures import render_figure
from skillplan.views.tables import tabulate_simulation

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


# Lines end between words, else in lists, else in names, else anywhere.


@pytest.mark.parametrize(
    ("text", "width", "lines"),
    [
        ("all fits", 8, ["all fits"]),
        ("words go over", 9, ["words go", "over"]),
        ("0,1,2,3,4,5", 6, ["0,1,2,", "3,4,5"]),
        ("at(home)+hand_free", 10, ["at(home)+", "hand_free"]),
        ("policy-iteration", 10, ["policy-", "iteration"]),
        ("see /a/folder/somewhere", 12, ["see /a/", "folder/", "somewhere"]),
        ("abcdefghij", 4, ["abcd", "efgh", "ij"]),
        ("two\nlines", 20, ["two", "lines"]),
    ],
)
def test_a_text_is_broken_where_it_reads_best(text, width, lines):
    """Words whole as long as they fit a line."""
    assert lines == wrap(text, width)


def test_further_lines_hang():
    assert ["one two", "  three", "  four"] == wrap("one two three four", 7, 2)


def test_a_note_hangs_under_its_text():
    """Behind the label and the blanks that follow it."""
    assert ["cost   one two", "       three"] == wrap_note("cost   one two three", 15)


def test_wide_characters_take_two_columns():
    assert ["\N{CJK UNIFIED IDEOGRAPH-4E00}" * 2] * 2 == wrap(
        "\N{CJK UNIFIED IDEOGRAPH-4E00}" * 4, 4
    )


def test_nothing_moves_the_cursor():
    """A name in a task file cannot colour or overwrite what is printed."""
    assert r"\x1b[31mred bell\x07\x0d" == make_printable("\x1b[31mred\tbell\x07\r")


# Evidence in one line.


@pytest.mark.parametrize(
    ("evidence", "text"),
    [
        ({}, ""),
        (
            {"force_n": 12.3456, "bodies": ["left finger", "pcb"]},
            "force_n 12.35, bodies left finger pcb",
        ),
        ({"sensed": {"held": True, "jaw_width_m": 0.0}}, "sensed (held yes, jaw_width_m 0)"),
        ({"moved_mm": {}, "bodies": []}, "moved_mm none, bodies none"),
        ({"offset_m": [-0.0, 0.25]}, "offset_m 0 0.25"),
        ({"tool": None, "steps": 1042}, "tool unknown, steps 1042"),
    ],
)
def test_it_reads_well(evidence, text):
    """Figures of four digits, lists with blanks, what belongs to one thing in brackets."""
    assert text == format_evidence(evidence)


# A simulated plan as tables: where bodies ended, how skills went, and that it all fits.


FIGURES = {
    "sensed": {"held": "transformer", "jaw_width_m": 0.0441},
    "moved_mm": {"switch_1": 1.25, "switch_2": 0.5},
    "pose_m": [0.476, -0.05599, 0.0061],
}


@pytest.fixture
def simulation(board_task):
    """Three skills of the board, of which the last fails."""
    skills = board_task.parse_sequence("0,1,2")
    none = board_task.facts.none
    done = [
        PerformedSkill(skill.name, Verdict.feasible(none, none, FIGURES), 2.0 * i, 2.0 * i + 2)
        for i, skill in enumerate(skills[:2])
    ]
    reason = "the jaws closed on nothing, at the place where switch_1 was to be"
    jammed = Verdict.infeasible(reason, none, none, FIGURES)
    done.append(PerformedSkill(skills[2].name, jammed, 4.0, 6.0))
    pose = Pose.upright((0.489, 0.0, 0.0), 0.0)
    arrivals = (Arrival("pcb", pose, pose, 0.00012, 0.001),)
    measured = {"largest_n": 1.5}
    performance = Performance(tuple(done), arrivals, 6.0, 1440, measured, taken_away=("brace",))
    return Simulation(
        board_task, skills, "pybullet", performance, 1.2, files={"video": "/tmp/plan.mp4"}
    )


@pytest.mark.parametrize("width", [60, 80, 120])
def test_no_line_is_wider_than_the_output(simulation, monkeypatch, width):
    """Though every skill comes with all that was measured."""
    monkeypatch.setenv("COLUMNS", str(width))
    text = render(tabulate_simulation(simulation), "table", io.StringIO())
    assert max(map(cell_len, text.splitlines())) <= width


def test_the_failure_is_told_with_its_step(simulation):
    notes = tabulate_simulation(simulation)[-1].notes
    assert [
        "failure    at step 3 (pick(switch_1)): the jaws closed on nothing, at the place where "
        "switch_1 was to be"
    ] == [note for note in notes if note.startswith("failure")]
    assert "taken away brace" in notes


def test_arrivals_have_a_table_of_their_own(simulation):
    """Before that of the skills, which CSV holds."""
    first, last = tabulate_simulation(simulation)
    assert [("pcb", "0.120", "0.057", "0.4890 0.0000 0.0000")] == list(first.rows)
    assert 3 == len(last.rows)


def timed(simulation: Simulation, timed_by: str, *acting_s: float | None) -> Simulation:
    """Return the simulation with planned times, and times that the hand acts."""
    done = [
        replace(skill, acting_s=taken_s)
        for skill, taken_s in zip(simulation.performance.skills, acting_s, strict=False)
    ]
    done += simulation.performance.skills[len(done) :]
    created = replace(simulation.performance, skills=tuple(done), pace="strokes at 0.25 m/s")
    return replace(simulation, performance=created, planned=PlannedTimes([1.5, 1.0, 9.0], timed_by))


def times_note(simulation: Simulation) -> str:
    (note,) = (n for n in tabulate_simulation(simulation)[-1].notes if n.startswith("times"))
    return note


def test_the_difference_from_the_planned_time_is_told_with_its_reasons(simulation):
    """Over the skills that succeeded, whose dwells are 3 s each; shares add up."""
    created = timed(simulation, "swept", 3.0, 3.5)
    assert times_note(created) == (
        "times      4.0 s simulated, 2.5 s planned by swept: +1.5 s; +0.5 s acting beyond the "
        "dwells; +1.0 s travels and strokes (strokes at 0.25 m/s)"
    )
    times = created.document()["times"]
    shares = (times["settling_s"], times["acting_s"], times["moving_s"])
    assert sum(shares) == pytest.approx(times["difference_s"])
    planned = [column.heading for column in tabulate_simulation(created)[-1].columns]
    assert "planned [s]" in planned


def test_without_trajectories_the_note_says_that_strokes_are_left_out(simulation):
    """Travel is by the task's speed then."""
    note = times_note(timed(simulation, "", 3.0, 3.0))
    assert "planned by the task's travel speed" in note
    assert "planned without strokes" in note


def test_an_engine_that_measures_no_acting_is_said_to(simulation):
    """The sum is told all the same."""
    note = times_note(timed(simulation, "swept", None, None))
    assert note.endswith("2.5 s planned by swept: +1.5 s; the engine measures no more")


# What a terminal would obey, or nobody sees, is written out.


HOSTILE = "\x1b[2J\x9b31m\x7f\r\N{RIGHT-TO-LEFT OVERRIDE}\N{ZERO WIDTH SPACE}\N{LINE SEPARATOR}"
WRITTEN_OUT = r"\x1b[2J\x9b31m\x7f\x0d\u202e\u200b\u2028"


def test_every_control_and_format_character_is_written_out():
    """All that Unicode has of them, but for line breaks and tabs."""
    hidden = [
        chr(code)
        for code in range(sys.maxunicode + 1)
        if unicodedata.category(chr(code)) in ("Cc", "Cf", "Cs", "Zl", "Zp")
    ]
    raw = [char for char in hidden if escape(char) == char]
    assert ["\t", "\n"] == raw
    assert "".join(map(escape, hidden)).isascii()


def test_what_is_read_stays():
    """Letters of all scripts, wide characters, accents, and a symbol with its selector."""
    text = "p\u00f6\u4e00 e\u0301 \u05e9\u05dc\u05d5\u05dd \N{PILE OF POO} \u2764\ufe0f \u2500"
    assert text == escape(text)


@given(st.text())
def test_a_text_that_was_escaped_stays(text):
    """Nothing is written out twice."""
    assert escape(text) == escape(escape(text))


class EscapingScreen(io.StringIO):
    """A terminal."""

    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("where", ["title", "cell", "note"])
def test_a_terminal_gets_our_marks_and_nobody_elses(where, monkeypatch):
    """A heading is bold; what a document holds neither colours nor moves nor is markup."""
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setenv("TERM", "xterm")
    texts = {"title": "t", "cell": "c", "note": "n", where: f"[red]{HOSTILE}[/]"}
    table = Table(texts["title"], [Column("a")], [(texts["cell"],)], [texts["note"]])
    text = render([table], "table", EscapingScreen())
    assert f"[red]{WRITTEN_OUT}[/]" in text
    assert {"\x1b[1m", "\x1b[0m"} == set(re.findall(r"\x1b[^a-z]*.", text))
    assert r"[2J" not in re.sub(r"\\x1b\[2J", "", text)


def test_a_figure_names_them():
    """In an SVG as text, where it would be taken up by whoever copies it."""
    figure = Figure()
    figure.suptitle("a\N{RIGHT-TO-LEFT OVERRIDE}b\x1b")
    assert rb"a\u202eb\x1b" in render_figure(figure, ".svg")
