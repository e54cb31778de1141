"""A loaded file, solved: one task, one task of a chain, or the whole chain."""

from __future__ import annotations

import pytest

from situations import CONFIGS
from skillplan import ChainResult, Result, Setup, Status, load_problem, solve_problem
from skillplan.collision import AabbDetector
from skillplan.errors import OptionError
from skillplan.solvers import Plan


@pytest.fixture
def chain():
    """The four cases of the bench, each a task."""
    return load_problem(CONFIGS / "swarmitfix_cases.yaml")


def test_a_single_task_is_one_result():
    """By the solver that serves the file best, where none is named."""
    result = solve_problem(load_problem(CONFIGS / "inverter_board.yaml"))
    assert isinstance(result, Result)
    assert (Status.OPTIMAL, "auto") == (result.status, result.solver)


def test_a_chain_is_solved_whole(chain):
    """Nobody has to look whether it is one."""
    result = solve_problem(chain)
    assert isinstance(result, ChainResult)
    assert result.complete


def test_one_part_of_a_chain_is_one_result(chain):
    """As it stands before anything is solved."""
    result = solve_problem(chain, chain.tasks[0].name, "exact")
    assert isinstance(result, Result)
    assert chain.tasks[0].name == result.task


def test_a_plan_to_start_from_is_of_one_task(chain):
    """A whole chain has none."""
    with pytest.raises(OptionError, match="for one task of a chain; name its part"):
        solve_problem(chain, start=Plan(()))


def test_back_ends_that_loading_constructed_are_used(monkeypatch):
    """A command constructs each of them once."""
    constructed = []
    begin = AabbDetector.__init__

    def note(self: AabbDetector, *arguments: object) -> None:
        constructed.append(self)
        begin(self, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(AabbDetector, "__init__", note)
    monkeypatch.setattr(AabbDetector, "faults", lambda self: {})
    problem = load_problem(CONFIGS / "inverter_board.yaml", {"collision": ["aabb"]})
    assert 1 == len(constructed)
    result = solve_problem(problem, setup=Setup(collision=("aabb",)))
    assert Status.OPTIMAL == result.status
    assert 1 == len(constructed)
