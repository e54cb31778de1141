"""Solvers of a comparison side by side: the rows are those of solvers in turn."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from skillplan import load_problem
from skillplan.errors import OptionError
from skillplan.pipeline import Setup, Terms, compare_solvers, rows_side_by_side
from skillplan.solvers import Stop
from skillplan.workers import LocalProcesses
from thinned import slow_case

ROOT = Path(__file__).parents[2]
BOARD = ROOT / "configs" / "inverter_board.yaml"
BENCH = ROOT / "configs" / "swarmitfix_polygonal.yaml"
OPEN = ROOT / "tests" / "instances" / "sop" / "kro124p.4.sop"


def timeless(document: Any) -> Any:
    """Return a document without what is measured in seconds of this machine."""
    if isinstance(document, dict):
        measured = {
            "wall_s",
            "learning_s",
            "sampling_s",
            "enumeration_s",
            "compile_s",
            "solve_s",
            "seconds",
        }
        return {key: timeless(item) for key, item in document.items() if key not in measured}
    return [timeless(entry) for entry in document] if isinstance(document, list) else document


@pytest.mark.parametrize(
    ("file", "solvers"),
    [
        (BOARD, ["exact", "value-iteration"]),
        slow_case(
            BENCH,
            ["csp", "monte-carlo", "policy-iteration"],
            reason="learns in processes; one task in every run",
        ),
    ],
)
def test_rows_are_those_of_solvers_in_turn(file, solvers):
    """But for seconds: plans, bounds, counts and figures of the search, in the given order."""
    problem = load_problem(file)
    in_turn = compare_solvers(problem, solvers)
    at_once = compare_solvers(problem, solvers, jobs=2)
    assert [row.solver for row in at_once] == solvers
    assert timeless([item.document() for item in at_once]) == timeless(
        [entry.document() for entry in in_turn]
    )


def started(monkeypatch: pytest.MonkeyPatch, then: Callable[[Any], None]) -> list[Any]:
    """Note every process that is started from now on, and have something done with it."""
    begin, created = LocalProcesses.start, []

    def start(self: LocalProcesses, *args: Any) -> Any:
        worker = begin(self, *args)
        created.append(worker)
        then(worker)
        return worker

    monkeypatch.setattr(LocalProcesses, "start", start)
    return created


def test_a_process_goes_on_with_the_next_solver(monkeypatch):
    """Two processes for four rows; every solver starts with a cold cache of verdicts."""
    created = started(monkeypatch, lambda worker: None)
    rows = compare_solvers(load_problem(BOARD), ["exact", "exact", "exact", "exact"], jobs=2)
    assert len(created) == 2
    assert len({row.checks for row in rows}) == 1  # type: ignore[union-attr]
    assert rows[0].checks > 0  # type: ignore[union-attr]


def test_with_more_processes_than_solvers_each_may_use_all(monkeypatch):
    """Then they run in turn, here."""
    created = started(monkeypatch, lambda worker: None)
    rows = compare_solvers(load_problem(BOARD), ["exact", "value-iteration"], jobs=3)
    assert [row.status for row in rows] == ["optimal", "optimal"]
    assert created == []


def test_a_solver_whose_process_is_killed_has_failed_and_the_others_go_on(monkeypatch):
    """The row says by which signal."""

    def kill(worker: Any) -> None:
        if len(created) == 1:
            os.kill(worker.number, signal.SIGKILL)

    created: list[Any] = []
    created = started(monkeypatch, kill)
    rows = compare_solvers(load_problem(BOARD), ["exact", "value-iteration"], jobs=2)
    assert [row.status for row in rows] == ["failed", "optimal"]  # type: ignore[union-attr]
    assert "its process ended by signal 9" in rows[0].reason  # type: ignore[union-attr]


def test_wrong_input_that_a_process_meets_is_the_user_s_to_repair():
    """As in turn: no row, but an error."""
    setup = Setup(options={"exact": {"no_such_option": 1}})
    terms = Terms(load_problem(BOARD), setup)
    with pytest.raises(OptionError, match="no_such_option"):
        rows_side_by_side(terms, ["exact", "exact"], 2, {}, Stop())


def test_an_interruption_ends_what_runs_with_what_it_has_and_begins_no_other():
    """Rows of those that have not begun are missing."""
    stop = Stop()
    terms = Terms(load_problem(OPEN), Setup())
    begun_s = time.monotonic()
    threading.Timer(2.0, stop.interrupt).start()
    rows = rows_side_by_side(terms, ["exact", "local-search", "exact"], 2, {}, stop)
    assert time.monotonic() - begun_s < 60.0
    assert [row.solver for row in rows] == ["exact", "local-search"]
    assert all(row.interrupted for row in rows)  # type: ignore[union-attr]


def test_limits_hold_for_each():
    """Time counts from the beginning of each search."""
    problem = load_problem(OPEN)
    rows = compare_solvers(problem, ["exact", "exact"], jobs=2, limits={"time_limit_s": 0.5})
    # With or without a plan, depending on the machine.
    assert {row.status for row in rows} <= {"solved", "unsolved"}  # type: ignore[union-attr]
    assert all(row.wall_s < 5.0 for row in rows)
