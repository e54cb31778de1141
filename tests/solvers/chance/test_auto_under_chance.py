"""What `auto` takes where tables do not suffice under chance."""

import pytest

from skillplan.domains.assembly import BoardGenerator
from skillplan.pipeline import load_problem, solve
from skillplan.records import Status
from skillplan.solvers.chance import JobValuesSolver
from skillplan.solvers.mdp import ValueIterationSolver


@pytest.fixture
def board(tmp_path, monkeypatch):
    """Return five parts, which are said to be too many for tables."""
    path = tmp_path / "board.yaml"
    path.write_text(BoardGenerator(5, 0.2, 2, failures=(0.2, 0.2)).text(), "utf-8")
    monkeypatch.setattr(
        ValueIterationSolver, "refuses", lambda self, model: "more than 1 reachable state"
    )
    return load_problem(path).task


def test_beyond_tables_auto_works_out_values_over_sets_of_jobs(board):
    """And proves the optimum."""
    result = solve(board, "auto")
    assert result.status is Status.OPTIMAL
    assert "job-values" in result.trace["choice"]


def test_where_these_are_not_to_be_had_it_plans_anew_after_a_miss(board, monkeypatch):
    """And says so; with a bound, and without the claim of a proof."""
    monkeypatch.setattr(JobValuesSolver, "refuses", lambda self, model: "more than 1 set")
    result = solve(board, "auto")
    assert result.status is Status.SOLVED
    assert "replan" in result.trace["choice"]
    assert result.lower_bound is not None
    assert result.cost is not None
    assert 0 < result.lower_bound <= result.cost
