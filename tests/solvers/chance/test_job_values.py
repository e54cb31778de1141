"""The least expected cost over sets of jobs: that of tables, and what it does not serve."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from situations import make_skill, make_task, model_of
from skillplan.domains.assembly import BoardGenerator
from skillplan.errors import NotASequencing
from skillplan.model import ComponentJobs, SkillModel, compute_least_expected_cost, evaluate_policy
from skillplan.pipeline import load_problem, make_model, solve
from skillplan.records import Status
from skillplan.solvers import Stop, chance
from skillplan.solvers.mdp import ValueIterationSolver
from skillplan.task import Facts
from skillplan.testing import SolverSuite

CONFIGS = Path(__file__).parents[3] / "configs"
BOARDS = st.builds(
    BoardGenerator,
    parts=st.integers(2, 5),
    density=st.floats(0, 0.5),
    tools=st.integers(1, 3),
    seed=st.integers(0, 10_000),
    failures=st.just((0.05, 0.9)),
    failing_share=st.floats(0.4, 1.0),
)


class TestJobValuesSolver(SolverSuite):
    solver: ClassVar[str] = "job-values"


def model_on(board: BoardGenerator, folder: Path) -> SkillModel:
    path = folder / "board.yaml"
    path.write_text(board.text(), "utf-8")
    return make_model(load_problem(path).task)


@settings(max_examples=examples(12))
@given(board=BOARDS)
def test_it_costs_what_the_best_policy_of_all_states_does(board, tmp_path_factory):
    """And following it costs what it claims; also where most grasps fail."""
    model = model_on(board, tmp_path_factory.mktemp("board"))
    values = chance.JobValues(model, 1_000, Stop())
    least_expected_cost = compute_least_expected_cost(model, 20_000)
    assert values.cost == pytest.approx(least_expected_cost, abs=1e-9)
    assert values.cost <= evaluate_policy(model, values.get).cost + 1e-12
    assert evaluate_policy(model, values.get).cost == pytest.approx(values.cost, abs=1e-9)


def test_the_board_with_failing_grasps_is_proved():
    """Where replanning is 0.2 % above."""
    task = load_problem(CONFIGS / "inverter_grasps.yaml").task
    result = solve(task, "job-values")
    assert result.status is Status.OPTIMAL
    assert result.cost == pytest.approx(2.22354, abs=1e-5)
    assert result.trace["sets"] == 49


def test_a_board_of_762_750_states_is_proved_in_a_moment(tmp_path):
    """At 18.16390 m, as value iteration did in two minutes."""
    board = BoardGenerator(20, 0.1, 3, 1, failures=(0.1, 0.4), failing_share=1 / 3)
    model = model_on(board, tmp_path)
    solution = chance.JobValuesSolver().solve(model)
    assert solution.proved
    assert solution.policy is not None
    assert solution.lower_bound == pytest.approx(18.16390, abs=1e-5)
    assert evaluate_policy(model, solution.policy.get).cost == pytest.approx(solution.lower_bound)
    assert solution.trace["sets"] == 33_920


def test_without_failures_values_are_least_costs():
    """Two jobs in any order: the cheaper way round."""
    costs = np.array([[np.inf, 5.0], [2.0, np.inf], [1.0, 3.0]])
    ways = chance.Ways(costs, np.zeros(2), np.ones(2), ((), ()))
    layers = chance.list_feasible_sets((0, 0), 10, Stop())
    after = chance.compute_set_values(layers, (0, 0), ways, Stop())
    assert after[1][0, 0] == 5.0
    assert after[1][1, 1] == 2.0


def test_a_job_that_often_fails_is_tried_again_or_put_off():
    """Half of the tries fail: with nothing else to do two on average, at 1 each, then 4."""
    # Job 1 is done; job 0 is left, begun from there or from where it was missed.
    costs = np.array([[np.inf, np.inf], [1.0, np.inf], [1.0, 9.0], [np.inf, 1.0]])
    ways = chance.Ways(costs, np.array([4.0, 0.0]), np.array([0.5, 1.0]), (((0.5, 2),), ()))
    layers = chance.list_feasible_sets((0, 0), 10, Stop())
    after = chance.compute_set_values(layers, (0, 0), ways, Stop())
    assert after[1][list(layers[1]).index(2), 1] == pytest.approx(6.0)


def test_what_it_does_not_serve_is_refused_in_words(tmp_path):
    model = model_on(BoardGenerator(4, 0.0, 1, 1, failures=(0.1, 0.4), failing_share=0.5), tmp_path)
    few = chance.JobValuesSolver(chance.JobValuesSolver.Options(sets=15))
    assert "more than 15 sets of jobs may be done; take replan" in str(few.refuses(model))
    assert chance.JobValuesSolver().refuses(model) is None
    facts = Facts(("whole", "done"))
    outcomes = [(0.5, ("done",), ()), (0.5, (), ("whole",))]
    skills = [make_skill(facts, "try", requires=("whole",), outcomes=outcomes)]
    lost = model_of(make_task(facts, skills, goal=("done",), initial=("whole",)))
    assert "it cannot be tried again; take value-iteration" in str(
        chance.JobValuesSolver().refuses(lost)
    )


def test_what_is_done_between_jobs_may_not_fail(tmp_path):
    """A tool change that fails leaves open what to do instead."""
    model = model_on(BoardGenerator(3, 0.0, 2, 1, failures=(0.3, 0.3), failing_share=1.0), tmp_path)
    task = model.task
    picks = next(skill for skill in task.skills if not skill.deterministic)
    between = {skill.name for skill in ComponentJobs(chance.assume_retries(task)).connectors}
    assert between
    skills = tuple(
        replace(skill, outcomes=_failing(skill.outcomes[0], picks.outcomes[1]))
        if skill.name in between
        else skill
        for skill in task.skills
    )
    with pytest.raises(NotASequencing, match="which is part of no job, may fail"):
        chance.relax_to_one_try(replace(task, skills=skills))


def _failing(success: Any, failure: Any) -> tuple[Any, ...]:
    return (replace(success, probability=0.5), replace(failure, probability=0.5))


# What `auto` takes where tables do not suffice under chance.


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
    monkeypatch.setattr(chance.JobValuesSolver, "refuses", lambda self, model: "more than 1 set")
    result = solve(board, "auto")
    assert result.status is Status.SOLVED
    assert "replan" in result.trace["choice"]
    assert result.lower_bound is not None
    assert result.cost is not None
    assert 0 < result.lower_bound <= result.cost
