"""Every command in every format: csv and Markdown are parseable, tables are readable."""

from __future__ import annotations

import csv
import io

import pytest

from skillplan.pipeline import registry
from thinned import slow_case

OPTIMUM = "0,1,2,3,4,5,8,9,10,11,6,7,13,14,15"
# Command to its words and the number of rows of its table.
COMMANDS: dict[str, tuple[tuple[str, ...], int]] = {
    "search-optimal": (("search-optimal", "BOARD"), 15),
    "evaluate": (("evaluate", "BOARD", "--sequence", OPTIMUM), 15),
    "evaluate-infeasible": (("evaluate", "BOARD", "--sequence", "3"), 0),
    "compare": (("compare", "BOARD", "--solvers", "exact,exhaustive", "--set", "step_limit=15"), 2),
    "check": (("check", "BOARD"), 1),
    "explain": (("explain", "BOARD", "pick(pcb)"), 3),
    "chart": (("chart", "BOARD"), 8),
    "plugins": (("plugins", "collision"), len(registry.names("collision"))),
    "plugin-options": (("plugins", "collision", "aabb"), 2),
    "no-options": (("plugins", "solver", "exhaustive"), 0),
    "unsolved": (("search-optimal", "MANY", "--solver", "exact", "--time-limit", "1e-6"), 0),
}
every_command = pytest.mark.parametrize("command", COMMANDS)


@pytest.fixture
def words(command, board, seven):
    places = {"BOARD": board, "MANY": seven}
    return [places.get(word, word) for word in COMMANDS[command][0]]


@every_command
def test_csv_is_a_heading_and_rows_of_one_width(cli, words, command):
    """A CSV reader gets headings, and as many cells in each row; a failure is told on stderr."""
    outcome = cli(*words, "--format", "csv")
    heading, *rows = list(csv.reader(io.StringIO(outcome.out), strict=True))
    assert len(heading) >= 5
    assert len(set(heading)) == len(heading)
    assert COMMANDS[command][1] == len(rows)
    assert {len(heading)} >= {len(row) for row in rows}
    assert bool(outcome.err) == (outcome.code != 0)


@every_command
def test_markdown_is_a_table_and_a_list(cli, words, command):
    """Title, table with as many cells in each row, notes as a list."""
    outcome = cli(*words, "--format", "md")
    lines = outcome.out.splitlines()
    assert lines[0].startswith("**")
    assert lines[0].endswith("**")
    blocks = outcome.out.rstrip("\n").split("\n**")
    table = [line for line in blocks[-1].splitlines() if line.startswith("|")]
    count = COMMANDS[command][1]
    assert (count + 2 if count else 0) == len(table)
    assert len({line.count("|") for line in table}) <= 1
    assert all(line == "" or line[0] in "|-*" for line in lines)
    assert "" == outcome.err


@every_command
def test_a_table_begins_with_its_title(cli, words, command):
    """For people: title, rows, notes; no escape codes, no blanks at the ends of lines."""
    outcome = cli(*words)
    lines = outcome.out.splitlines()
    assert lines[0]
    assert "\x1b" not in outcome.out
    assert all(line == line.rstrip() for line in lines)
    assert ("─" * 20 in outcome.out) == bool(COMMANDS[command][1] or "plugins" in words)
    assert "" == outcome.err


@pytest.mark.parametrize(
    "command",
    [
        slow_case(command, reason="four searches; others in every run")
        if command in ("compare", "evaluate", "search-optimal")
        else command
        for command in COMMANDS
    ],
)
def test_the_format_does_not_change_the_exit_code(cli, words):
    """All four formats end alike."""
    codes = {cli(*words, "--format", style).code for style in ("table", "json", "csv", "md")}
    assert 1 == len(codes)


@pytest.mark.slow(reason="searches twelve parts twice; long lines of the board in every run")
def test_redirected_tables_are_not_cut_to_80_columns(cli, motor):
    """A sequence of 41 actions stands on one line."""
    out = cli("compare", motor, "--solvers", "exact").out
    sequence = ",".join(
        str(action)
        for action in cli("search-optimal", motor, "--format", "json").document["actions"]
    )
    assert any(line.endswith(sequence) for line in out.splitlines())


def test_the_figures_of_a_search_are_all_in_its_table(cli, board):
    """Status, cost, bound, gap, sequence, makespan and effort."""
    out = cli("search-optimal", board).out
    assert "status     optimal, proved\n" in out
    assert "cost       1.86709 m  (lower bound 1.86709 m, gap 0.00 %)\n" in out
    assert f"sequence   {OPTIMUM}\n" in out
    assert "plan       15 skills, 74.5 s\n" in out
    assert "effort     " in out


def test_a_comparison_shows_checks_beside_seconds(cli, board):
    """Every figure of the design has its column."""
    out = cli("compare", board, "--solvers", "exact", "--format", "csv").out
    assert [
        "solver",
        "status",
        "cost [m]",
        "gap",
        "skills",
        "makespan [s]",
        "checks",
        "iterations",
        "seconds",
        "sequence",
    ] == next(csv.reader(io.StringIO(out)))


@pytest.mark.slow(reason="walks all sequences; brute force itself is in every run")
def test_brute_force_tells_what_it_counted(cli, board):
    """The sequences by length and the worst of the shortest."""
    out = cli("compare", board, "--solvers", "exhaustive").out
    counts = "120 of 15, 120 of 16, 1,080 of 17, 1,020 of 18, 5,280 of 19, 4,800 of 20 skills"
    # The line is wider than the output: it wraps.
    assert f"exhaustive: sequences 12,420 complete ones: {counts}" in " ".join(out.split())
    assert "exhaustive: worst      2.05858 m among those of 15 skills\n" in out


def test_a_search_cut_short_says_so(cli, motor):
    """Unsolved, because of the time limit, with what is proved and what was counted."""
    outcome = cli("search-optimal", motor, "--solver", "exhaustive", "--time-limit", "0.05")
    assert 1 == outcome.code
    assert "status     unsolved (time limit: no plan was found)\n" in outcome.out
    assert "sequences  no complete one so far\n" in outcome.out
    assert "bound      no plan costs less than " in outcome.out
    assert "step" not in outcome.out


def test_counts_of_a_search_cut_short_are_so_far(cli, board):
    """What brute force counted until its gap was reached is not said to be all."""
    words = ("--solver", "exhaustive", "--gap", "1")
    outcome = cli("search-optimal", board, *words)
    assert 0 == outcome.code
    assert "solved, not proved to be the best (gap reached)" in outcome.out
    assert " complete ones so far: " in outcome.out


def test_a_task_without_a_plan_says_that_this_is_proved(cli, no_way):
    """Infeasible is more than unsolved; both solvers agree."""
    outcome = cli("compare", no_way, "--solvers", "exact,exhaustive")
    assert 1 == outcome.code
    assert 2 == outcome.out.count("infeasible")
    assert "exhaustive: sequences  no complete one\n" in outcome.out
    assert "proved that there is no plan" in cli("search-optimal", no_way).out
