"""search-optimal and compare: limits, gap, folders, options of plugins."""

from __future__ import annotations

import csv
import io
import json
import os
from pathlib import Path

import pytest

from skillplan.cli import write_folder, writing
from skillplan.errors import OptionError
from sop_instances import FOLDER, instance_text
from thinned import slow_case

EXACT = ("--solver", "exact")


def test_a_time_limit_gives_plan_bound_and_gap(cli, board, tmp_path):
    """The best so far, and how far it may be from the optimum; brute force would take for ever."""
    path = tmp_path / "patient_board.yaml"
    text = Path(board).read_text("utf-8").replace("step_limit: 20", "step_limit: 60")
    path.write_text(text, "utf-8")
    words = ("--solver", "exhaustive", "--time-limit", "0.2", "--format", "json")
    outcome = cli("search-optimal", str(path), *words)
    document = outcome.document
    assert (0, "solved", "time limit") == (outcome.code, document["status"], document["reason"])
    assert 0 < document["lower_bound"] < 1.86708 < document["cost"]
    gap = 1 - document["lower_bound"] / document["cost"]
    assert gap == pytest.approx(document["gap"])
    assert 0.1 < document["stats"]["wall_s"] < 5


def test_a_time_limit_too_short_for_a_plan_leaves_a_bound(cli, motor):
    """`exact` then has proved something all the same."""
    words = ("--time-limit", "0.000001", "--format", "json")
    document = cli("search-optimal", motor, *words).document
    assert ("unsolved", None) == (document["status"], document["cost"])
    assert 0 < document["lower_bound"] <= 11.58291 + 5e-6


@pytest.mark.parametrize(
    ("solver", "gap"),
    [
        ("exact", "0.3"),
        slow_case("exhaustive", "0.9", reason="walks the whole board; exact search in every run"),
    ],
)
def test_a_gap_is_good_enough(cli, board, seven, solver, gap):
    """The search ends early, with a gap no larger than asked for."""
    task = seven if solver == "exact" else board
    words = ("search-optimal", task, "--solver", solver, "--format", "json")
    document = cli(*words, "--gap", gap).document
    full = cli(*words).document
    assert ("solved", "gap reached") == (document["status"], document["reason"])
    assert 0 < document["gap"] <= float(gap)
    assert document["stats"]["expanded"] < full["stats"]["expanded"]


@pytest.mark.slow(reason="searches twelve parts; another gap in every run")
def test_a_small_gap_is_met_on_the_larger_board(cli, motor):
    """Within 10 % of the optimum, and proved to be."""
    document = cli("search-optimal", motor, "--gap", "0.1", "--format", "json").document
    assert document["gap"] <= 0.1
    assert document["cost"] <= 11.58291 / 0.9


def test_the_same_seed_gives_the_same_result(cli, board):
    """All but the seconds."""
    documents = []
    for _ in range(2):
        document = cli("search-optimal", board, "--seed", "3", "--format", "json").document
        document["stats"].pop("wall_s")
        documents.append(document)
    assert documents[0] == documents[1]


@pytest.mark.parametrize("words", [(), ("--no-cache",)])
def test_the_cache_does_not_change_the_answer(cli, board, words):
    """With and without verdicts on disk, first and second time."""
    actions = [
        cli("search-optimal", board, *words, "--format", "json").document["actions"]
        for _ in range(2)
    ]
    assert [[0, 1, 2, 3, 4, 5, 8, 9, 10, 11, 6, 7, 13, 14, 15]] * 2 == actions


class TestOut:
    def test_the_folder_holds_what_was_printed(self, cli, board, tmp_path):
        """result.json is the document, plan.csv its steps; nothing else is left there."""
        folder = tmp_path / "deep" / "run"
        outcome = cli("search-optimal", board, "--out", str(folder), "--format", "json")
        assert ["plan.csv", "result.json"] == sorted(path.name for path in folder.iterdir())
        assert outcome.document == json.loads((folder / "result.json").read_text("utf-8"))
        plan = (folder / "plan.csv").read_text("utf-8")
        rows = list(csv.DictReader(io.StringIO(plan)))
        assert outcome.document["skills"] == [row["skill"] for row in rows]
        assert outcome.document["actions"] == [int(row["action"]) for row in rows]

    def test_an_unsolved_run_has_its_folder_too(self, cli, no_way, tmp_path):
        """plan.csv then has a heading and no rows."""
        folder = tmp_path / "run"
        assert 1 == cli("search-optimal", no_way, "--out", str(folder)).code
        assert 1 == len((folder / "plan.csv").read_text("utf-8").splitlines())
        assert "infeasible" == json.loads((folder / "result.json").read_text("utf-8"))["status"]

    def test_an_earlier_result_is_never_overwritten(self, cli, board, tmp_path):
        """A folder that holds anything is refused before the search begins."""
        (tmp_path / "mine.txt").write_text("keep me")
        assert (
            "is not empty. Name a new folder."
            in cli("search-optimal", board, "--out", str(tmp_path)).refusal
        )
        assert ["mine.txt"] == [path.name for path in tmp_path.iterdir()]

    def test_a_file_is_no_folder(self, cli, board, tmp_path):
        """A file in the way is a fault in words."""
        path = tmp_path / "file"
        path.write_text("")
        assert (
            f"--out {path}: cannot be used: "
            in cli("search-optimal", board, "--out", str(path)).refusal
        )

    def test_a_wrong_task_leaves_no_folder(self, cli, tmp_path):
        """The folder is made only once the task is known to be right."""
        assert 2 == cli("search-optimal", "nowhere.yaml", "--out", str(tmp_path / "run")).code
        assert not (tmp_path / "run").exists()

    def test_a_file_is_there_whole_or_not_at_all(self, tmp_path, monkeypatch):
        """Where writing fails midway, neither the file nor its beginning is left."""

        def fail(handle: int) -> None:
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(os, "fsync", fail)
        with pytest.raises(OptionError, match=r"result\.json cannot be written: No space left"):
            write_folder(tmp_path, {"result.json": "{}"})
        assert [] == list(tmp_path.iterdir())


class TestOptions:
    def test_an_option_reaches_the_solver(self, cli, board):
        """With one label the search ends at once, unproved."""
        words = (*EXACT, "-O", "max_labels=1", "--format", "json")
        document = cli("search-optimal", board, *words).document
        assert ("solved", 1) == (document["status"], document["stats"]["expanded"])

    def test_several_options_reach_their_plugins(self, cli, board):
        """By name: solver, detector of the file and detector of the command line."""
        words = (*EXACT, "-O", "exact.max_labels=1", "-O", "exact.dives=false")
        words += ("-O", "precedence.hold_back_picks=true", "--format", "json")
        document = cli("search-optimal", board, *words).document
        assert "unsolved" == document["status"]

    def test_a_detector_s_option_changes_its_verdicts(self, cli, board):
        """Held back, the second pick is infeasible before the board is placed."""
        words = ("explain", board, "pick(brace)", "--format", "json")
        assert 0 == cli(*words).code
        held = cli(*words, "-O", "precedence.hold_back_picks=true")
        assert (1, "precedence") == (held.code, held.document["stage"])

    def test_the_last_of_two_values_holds(self, cli, board):
        """As on any command line."""
        words = (*EXACT, "-O", "max_labels=1", "-O", "max_labels=100000", "--format", "json")
        assert "optimal" == cli("search-optimal", board, *words).document["status"]


class TestDetectors:
    def test_two_detectors_are_both_asked(self, cli, board):
        """`--collision a,b`: the same optimum, and verdicts of both stages."""
        words = ("--collision", "aabb,precedence", "--format", "json")
        document = cli("search-optimal", board, *words).document
        assert "1.86709" == f"{document['cost']:.5f}"
        explained = cli("explain", board, "pick(pcb)", *words).document
        stages = [stage["stage"] for stage in explained["stages"]]
        assert ["kinematic", "precedence", "precondition"] == sorted(set(stages) - {"aabb"})
        assert "aabb" in stages

    def test_the_chart_can_be_left_out(self, cli, board):
        """With `aabb` alone geometry finds the paper's optimum without the hand-made chart."""
        words = ("--collision", "aabb", "--set", "chart=[]")
        document = cli("search-optimal", board, *words, "--format", "json").document
        assert ("optimal", "aabb") == (document["status"], document["collision"])
        assert "1.86709" == f"{document['cost']:.5f}"


class TestCompare:
    @pytest.mark.slow(reason="walks all sequences; brute force itself is in every run")
    def test_both_solvers_prove_the_same_optimum(self, cli, board):
        """Rows in the order asked for; each with a cold cache."""
        outcome = cli("compare", board, "--solvers", "exhaustive,exact", "--format", "json")
        rows = outcome.document["rows"]
        assert ["exhaustive", "exact"] == [row["solver"] for row in rows]
        assert ["optimal", "optimal"] == [row["status"] for row in rows]
        assert rows[0]["cost"] == pytest.approx(rows[1]["cost"], abs=1e-12)
        assert not outcome.document["warm"]
        assert rows[1]["stats"]["expanded"] * 50 <= rows[0]["stats"]["expanded"]

    def test_a_name_given_twice_runs_once(self, cli, board):
        """Blanks about names do not matter either."""
        words = ("--solvers", "exact, exact,,exact", "--format", "json")
        assert ["exact"] == [r["solver"] for r in cli("compare", board, *words).document["rows"]]

    def test_warmth_shows_in_the_title(self, cli, board):
        """No comparison with a warm cache goes unmarked."""
        assert ", cold cache\n" in cli("compare", board, "--solvers", "exact").out
        assert ", warm cache\n" in cli("compare", board, "--solvers", "exact", "--warm").out

    @pytest.mark.slow(
        reason="a solver that uses up three seconds; one search that time ends in every run"
    )
    def test_each_solver_has_its_own_time_limit(self, cli, motor):
        """One that uses its time up takes none from the next."""
        words = ("--solvers", "exhaustive,exact", "--time-limit", "3")
        rows = cli("compare", motor, *words, "--format", "json").document["rows"]
        assert ["unsolved", "optimal"] == [row["status"] for row in rows]

    def test_options_go_to_the_named_solver(self, cli, board):
        """`-O exact.max_labels` leaves the other solver alone."""
        words = ("--solvers", "exact,exhaustive", "-O", "exact.max_labels=1", "--format", "json")
        rows = cli("compare", board, *words, "--set", "step_limit=15").document["rows"]
        assert ["solved", "optimal"] == [row["status"] for row in rows]


def test_what_stdout_cannot_encode_is_written_in_escapes(monkeypatch, tmp_path):
    """A part named in Greek does not end the program on an old terminal."""
    import sys

    path = tmp_path / "out.txt"
    with path.open("w", encoding="ascii") as out:
        monkeypatch.setattr(sys, "stdout", out)
        writing.write_out("pick(\N{GREEK SMALL LETTER PI})\n")
    assert "pick(\\u03c0)\n" == path.read_text("ascii")


# Every command on a TSPLIB file: what it prints has no units, no places and no times.


ESC07 = str(FOLDER / "ESC07.sop")
OPTIMUM = "0,3,1,6,5,4,2,7"


def test_a_plan_is_shown_in_plain_numbers(cli):
    """Without columns that no step has anything in."""
    done = cli("search-optimal", ESC07, "--solver", "exact")
    lines = [line.rstrip() for line in done.out.splitlines()]
    assert 0 == done.code
    assert "step   action   skill      weight" == lines[1]
    assert "   2        3   visit(4)       75" == lines[4]
    assert "cost       2125  (lower bound 2125, gap 0.00 %)" in lines
    assert f"sequence   {OPTIMUM}" in lines
    assert "plan       8 skills" in lines


def test_the_document_has_the_same_keys_as_ever(cli):
    """Its unit is an empty text."""
    document = cli("search-optimal", ESC07, "--solver", "exact", "--format", "json").document
    assert (2125.0, 2125.0, "") == tuple(
        document[key] for key in ("cost", "lower_bound", "cost_unit")
    )
    assert {"name": "ESC07", "kind": "sop"} == {
        key: document["task"][key] for key in ("name", "kind")
    }
    assert ["visit(1)", "visit(4)"] == document["skills"][:2]


def test_solvers_are_compared_in_plain_numbers(cli):
    """Brute force counts the orders, and q-learning finds one."""
    done = cli("compare", ESC07, "--solvers", "exact,exhaustive,q-learning")
    assert 0 == done.code
    assert ["solver", "status", "cost", "gap"] == done.out.splitlines()[1].split()[:4]
    assert "exhaustive: sequences  252 complete ones: 252 of 8 skills" in done.out
    assert "exhaustive: worst      3400 among those of 8 skills" in done.out


def test_a_sequence_is_replayed(cli):
    """Against the proved optimum; one that breaks the order is told what comes before."""
    done = cli("evaluate", ESC07, "--sequence", OPTIMUM)
    assert 0 == done.code
    assert "cost       2125\n" in done.out
    assert "0.00 % of the proved optimum 2125\n" in done.out
    wrong = cli("evaluate", ESC07, "--sequence", "0,4")
    assert 1 == wrong.code
    assert "at step 2 (visit(5)): precondition: needs visited(4), visited(6), " in wrong.out


def test_the_chart_is_the_order_of_the_file(cli):
    """Reduced in the table."""
    rows = cli("chart", ESC07, "--format", "csv").out.splitlines()
    assert "4,5,-,visit(5),visit(5) needs visited(4)" in rows
    assert 1 + 9 == len(rows)


def test_a_skill_is_explained_by_what_it_needs(cli):
    """Nothing but its precondition stands against it."""
    done = cli("explain", ESC07, "visit(5)")
    assert 1 == done.code
    assert "needs visited(4), visited(6), visited(7)" in done.out


@pytest.mark.parametrize("name", ["ESC07", "rbg253a"])
def test_a_file_is_checked(cli, name):
    """Small or large."""
    done = cli("check", str(FOLDER / f"{name}.sop"))
    assert (0, f"{name}: valid") == (done.code, done.out.splitlines()[0])


def test_a_malformed_file_is_one_line_and_code_2(cli, tmp_path):
    """With file, line and column."""
    path = tmp_path / "bad.sop"
    path.write_text(instance_text("ESC07").replace("TYPE: SOP", "TYPE: TSP", 1))
    refusal = cli("check", str(path)).refusal
    assert refusal.startswith(f"skillplan: error: {path}:2:1: TYPE must be SOP, not 'TSP'.")
    assert 1 == len(refusal.splitlines())


def test_what_simulates_arms_refuses_it_in_one_line(cli):
    """There is no arm."""
    refusal = cli("simulate", ESC07, "--sequence", OPTIMUM).refusal
    assert 1 == len(refusal.splitlines())


def test_a_misspelt_file_is_answered_with_the_nearest(cli):
    """Files of costs are among those that are named."""
    assert "Did you mean 'ESC07.sop'?" in cli("check", str(FOLDER / "ESC0.sop")).refusal
