"""Tables fit: whatever a command prints for people, no line is wider than the output."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any

import pytest
from rich.cells import cell_len

from run_folders import HOPELESS, OPTIMAL, SWITCHED, write_runs
from same_process import studies_in_this_process
from skillplan.cli import output
from skillplan.views import Table, render
from tabular_learner import learner_installed
from thinned import slow_case

CONFIGS = Path(__file__).parents[2] / "configs"
BOARD = str(CONFIGS / "inverter_board.yaml")
FLEET = str(CONFIGS / "swarmitfix_fleet.yaml")
BENCH = str(CONFIGS / "swarmitfix_polygonal.yaml")
OPEN_CURVE = str(CONFIGS / "swarmitfix_open_curve.yaml")
SOP = str(CONFIGS / "ESC12.sop")
WIDTHS = (60, 80, 120)

# What a command prints, by the exit code it ends with.
COMMANDS: dict[str, tuple[int, tuple[str, ...]]] = {
    "search-optimal": (0, ("search-optimal", BOARD)),
    "search-optimal of nodes": (0, ("search-optimal", SOP, "--solver", "exact")),
    "search-optimal of the bench": (0, ("search-optimal", BENCH)),
    "search-optimal of a fleet": (0, ("search-optimal", FLEET)),
    "evaluate": (0, ("evaluate", BOARD, "--sequence", SWITCHED)),
    "evaluate what fails": (1, ("evaluate", BOARD, "--sequence", "0,1,2,5")),
    "compare solvers": (0, ("compare", BOARD, "--solvers", "exact,csp")),
    "compare solvers of the bench": (0, ("compare", OPEN_CURVE, "--solvers", "exact,csp")),
    "compare detectors": (0, ("compare", BOARD, "--detectors", "aabb,precedence", "--staged", "8")),
    "check": (0, ("check", BOARD)),
    "check of a chain": (0, ("check", BENCH)),
    "explain": (1, ("explain", BOARD, "place(brace)", "--collision", "aabb")),
    "explain by position": (
        1,
        (
            *("explain", BOARD, "place(transformer)", "--after", "0,1,10,11,8"),
            *("--collision", "aabb", "--set", "chart=[]"),
        ),
    ),
    "chart": (0, ("chart", BOARD)),
    "plugins": (0, ("plugins",)),
    "plugins of a kind": (0, ("plugins", "solver")),
    "options of a plugin": (0, ("plugins", "solver", "portfolio")),
    "cache show": (0, ("cache", "show")),
    "cache verify": (0, ("cache", "verify", BOARD)),
    "cache fill": (0, ("cache", "fill", BOARD)),
    "cache clear": (0, ("cache", "clear", "--yes")),
}

LONG = (
    "compare solvers of the bench",
    "search-optimal of the bench",
    "search-optimal of nodes",
    "search-optimal of a fleet",
)


@pytest.fixture
def printed(monkeypatch):
    """All tables that a command prints for people, as they were before they got their width."""
    tables: list[Table] = []

    def recorded(given: Any, style: str, out: Any) -> str:
        tables.extend(given)
        return render(given, style, out)

    monkeypatch.setattr(output, "render", recorded)
    return tables


@pytest.fixture
def runs(tmp_path):
    """Three runs on a copy of the board, of which two complete it."""
    return str(write_runs(tmp_path / "runs", BOARD, [OPTIMAL, SWITCHED, HOPELESS], copy=True))


@pytest.fixture
def learner(tmp_path, monkeypatch):
    """The name of a learner that is quick and exact."""
    with learner_installed(tmp_path / "site", monkeypatch) as name:
        yield name


@pytest.fixture
def result(cli, tmp_path):
    """Solves a task and returns the folder of its result."""

    def solve(task: str) -> str:
        folder = str(tmp_path / "result")
        assert 0 == cli("search-optimal", task, "--format", "json", "--out", folder).code
        return folder

    return solve


def widest(text: str) -> int:
    return max(cell_len(line) for line in text.splitlines())


def fits(tables: list[Table], text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """See that what was printed fits a pipe, and would fit terminals of other widths."""
    assert tables
    assert widest(text) <= 120
    for width in WIDTHS:
        monkeypatch.setenv("COLUMNS", str(width))
        shown = render(tables, "table", io.StringIO())
        assert widest(shown) <= width


@pytest.mark.parametrize(
    "name",
    [
        slow_case(name, reason="a second; other tables in every run") if name in LONG else name
        for name in COMMANDS
    ],
)
def test_no_line_is_wider_than_the_output(cli, printed, monkeypatch, name):
    """Piped, and at 60, 80 and 120 columns."""
    code, words = COMMANDS[name]
    outcome = cli(*words)
    assert code == outcome.code
    fits(printed, outcome.out, monkeypatch)


@pytest.mark.parametrize("width", WIDTHS)
def test_columns_counts_in_a_pipe_too(cli, monkeypatch, width):
    """Of a command as the user calls it."""
    monkeypatch.setenv("COLUMNS", str(width))
    assert widest(cli("chart", BOARD).out) <= width


@pytest.mark.parametrize(
    "task", [BOARD, slow_case(BENCH, reason="a sheet; the board in every run")]
)
@pytest.mark.parametrize("words", [(), ("--verbose",)])
def test_verify_fits(cli, result, printed, monkeypatch, task, words):
    """In short and in full."""
    outcome = cli("verify", result(task), *words)
    fits(printed, outcome.out, monkeypatch)


def test_train_and_evaluate_fit(cli, learner, tmp_path, printed, monkeypatch):
    """With sequences of 15 actions beside seven figures."""
    words = ("--solver", learner, "--runs", "2", "--steps", "400")
    outcome = cli("train", BOARD, *words, "--out", str(tmp_path / "run"))
    fits(printed, outcome.out, monkeypatch)


def test_evaluate_of_runs_fits(cli, runs, printed, monkeypatch):
    """Beside what the paper has."""
    outcome = cli("evaluate", runs, "--episodes", "5")
    fits(printed, outcome.out, monkeypatch)


@pytest.mark.slow(reason="two trainings; one that fits in every run")
def test_several_trainings_side_by_side_fit(cli, runs, tmp_path, printed, monkeypatch):
    """However long the names of their folders are."""
    other = write_runs(tmp_path / ("o" * 90), BOARD, [SWITCHED], copy=True)
    outcome = cli("evaluate", runs, str(other), "--episodes", "5")
    fits(printed, outcome.out, monkeypatch)


class TestVerifyInShort:
    def test_a_valid_result_takes_six_lines(self, cli, result):
        """What was replayed, calculated, proved again and not checked, and the verdict."""
        lines = cli("verify", result(BOARD)).out.splitlines()
        assert ["inverter-board:", "replay", "figures", "proof", "not", "verdict"] == [
            line.split()[0] for line in lines if line
        ]

    def test_what_does_not_hold_is_listed(self, cli, result):
        """And nothing else is."""
        path = Path(result(BOARD)) / "result.json"
        text = re.sub(r'"gap": [^,]*', '"gap": 0.5', path.read_text("utf-8"), count=1)
        path.write_text(text, "utf-8")
        outcome = cli("verify", str(path))
        assert 1 == outcome.code
        rows = [line.split()[:2] for line in outcome.out.splitlines()[3:4]]
        assert [["gap", "fails"]] == rows
        assert "NOT VALID: gap" in outcome.out

    def test_verbose_lists_every_claim(self, cli, result):
        out = cli("verify", result(BOARD), "--verbose").out
        assert 9 == sum(" holds " in line for line in out.splitlines())

    def test_markdown_holds_every_claim(self, cli, result):
        """As it did before there was a short form."""
        out = cli("verify", result(BOARD), "--format", "md").out
        assert 9 == out.count("| holds |")


def test_explain_prints_evidence_as_a_list(cli):
    """One line for each thing measured, under the stage that measured it."""
    words = ("--after", "0,1,10,11,8", "--collision", "aabb", "--set", "chart=[]")
    lines = cli("explain", BOARD, "place(transformer)", *words).out.splitlines()
    begin = lines.index("aabb: infeasible")
    assert [["rests", "on", "placed(brace)"], ["moving", "transformer"], ["bodies", "brace"]] == [
        line.split() for line in lines[begin + 1 : begin + 4]
    ]


def test_sweep_heads_the_column_of_a_start_with_the_word(cli, printed, monkeypatch):
    """Nine facts are no heading; Markdown names the state as before."""
    values = ("-O", "alpha=0.1,0.5", "-O", "episodes=500", "--runs", "2")
    with studies_in_this_process():
        outcome = cli("sweep", BOARD, "--solver", "q-learning", *values)
    heading = next(line for line in outcome.out.splitlines() if line.startswith("alpha"))
    assert "start" in heading.split()
    assert "| at_start(pcb)+at_start(switch_1)+" in render(printed, "md", io.StringIO())
    fits(printed, outcome.out, monkeypatch)
