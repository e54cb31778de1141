"""Replanning: below its plan, above its bound, and what it does not serve."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from situations import make_skill, make_task, model_of, retry_task
from skillplan.domains.assembly import BoardGenerator
from skillplan.model import compute_least_expected_cost, evaluate_policy
from skillplan.pipeline import load_problem, make_model
from skillplan.solvers import Stop, chance
from skillplan.task import CaseCost, Facts
from skillplan.testing import SolverSuite

CONFIGS = Path(__file__).parents[3] / "configs"
BOARDS = st.builds(
    BoardGenerator,
    parts=st.integers(2, 5),
    density=st.floats(0, 0.5),
    tools=st.integers(1, 2),
    seed=st.integers(0, 10_000),
    failures=st.just((0.05, 0.6)),
    failing_share=st.floats(0.4, 1.0),
)


class TestReplanSolver(SolverSuite):
    solver: ClassVar[str] = "replan"


@pytest.fixture
def board(tmp_path):
    """Return eight parts in almost any order, four of which may be missed."""
    path = tmp_path / "board.yaml"
    text = BoardGenerator(8, 0.1, 2, 3, failures=(0.1, 0.4), failing_share=0.5).text()
    path.write_text(text, "utf-8")
    return load_problem(path).task


@settings(max_examples=examples(8))
@given(board=BOARDS)
def test_any_policy_costs_the_bound_and_replanning_no_more_than_its_plan(board, tmp_path_factory):
    """Bound <= optimum <= replanning with lookahead, and without it <= the first plan."""
    path = tmp_path_factory.mktemp("board") / "board.yaml"
    path.write_text(board.text(), "utf-8")
    model = make_model(load_problem(path).task)
    least_expected_cost = compute_least_expected_cost(model, 20_000)
    assert least_expected_cost is not None
    for lookahead in (True, False):
        options = chance.ReplanSolver.Options(lookahead=lookahead, roll_outs=2)
        solution = chance.ReplanSolver(options).solve(model)
        assert solution.policy is not None
        cost = evaluate_policy(model, solution.policy.get).cost
        assert cost is not None
        assert solution.lower_bound is not None
        assert solution.lower_bound <= least_expected_cost + 1e-9
        assert least_expected_cost <= cost + 1e-9
        assert cost <= solution.trace["planned_cost"] + 1e-9
        assert not solution.proved


def test_after_a_miss_another_part_may_come_first():
    """On the inverter board: 0.2 % above the optimum, where the order of a plan is 2.5 % above."""
    model = make_model(load_problem(CONFIGS / "inverter_grasps.yaml").task)
    solution = chance.ReplanSolver().solve(model)
    assert solution.policy is not None
    assert evaluate_policy(model, solution.policy.get).cost == pytest.approx(2.22821, abs=1e-5)
    assert solution.trace["planned_cost"] == pytest.approx(2.27825, abs=1e-5)
    low, high = solution.trace["expected_cost"]["ci95"]
    assert low < 2.22821 < high
    assert solution.trace["expected_cost"]["roll_outs"] == 2_000


def test_later_searches_live_on_earlier_ones(board):
    """From wherever a grasp may fail: half the states that searches from there alone expand."""
    model = make_model(board)
    search = chance.AdaptiveSearch(model, chance.assume_retries(board), Stop(), 100_000)
    state, missed = model.initial, []
    while not model.is_goal(state):
        skill = search.skill(state)
        assert skill is not None
        missed += [outcome.apply(state) for outcome in skill.outcomes[1:]]
        state = skill.prediction_in(state).apply(state)
    first = search.expanded
    assert missed
    alone = 0
    for miss in missed:
        fresh = chance.AdaptiveSearch(model, chance.assume_retries(board), Stop(), 100_000)
        assert fresh.cost(miss) == pytest.approx(search.cost(miss), abs=1e-12)
        alone += fresh.expanded
    assert search.expanded - first < alone / 2


def test_a_plan_costs_what_following_it_without_replanning_does():
    task = retry_task(0.25, 2.0)
    assert chance.AdaptiveSearch(model_of(task), chance.assume_retries(task), Stop(), 100).cost(
        task.initial
    ) == pytest.approx(8.0)


def test_what_cannot_be_tried_again_is_refused_in_words():
    """Where a failure takes away what the skill needs."""
    facts = Facts(("whole", "done"))
    outcomes = [(0.5, ("done",), ()), (0.5, (), ("whole",))]
    skills = [make_skill(facts, "try", requires=("whole",), outcomes=outcomes)]
    task = make_task(facts, skills, goal=("done",), initial=("whole",))
    why = chance.refuse_retries(task)
    assert why == "a failure changes whole, which try asks for"
    refusal = chance.ReplanSolver().refuses(model_of(task))
    assert refusal is not None
    assert refusal.startswith(why)


def test_where_failing_saves_something_no_bound_is_claimed():
    """A miss that carries the arm for nothing to where the next skill is cheap."""
    facts = Facts(("near", "far", "first", "second"), (("near", "far"),))
    skills = [
        make_skill(
            facts,
            "first",
            forbids=("first",),
            outcomes=[(0.5, ("first", "far"), ("near",)), (0.5, ("near",), ("far",))],
        ),
        make_skill(facts, "second", forbids=("second",), add=("second", "far"), delete=("near",)),
    ]
    by_place = CaseCost({facts.bit("near"): 1.0, facts.bit("far"): 100.0})
    skills[1] = replace(skills[1], cost=by_place)
    task = make_task(facts, skills, goal=("first", "second"), initial=("far",))
    assert chance.refuse_retries(task) is None
    assert chance.relax(task) is None
    model = model_of(task)
    solution = chance.ReplanSolver().solve(model)
    assert solution.lower_bound is None
    assert solution.trace["no_bound"] == "a failure might save something"
    assert solution.policy is not None
    cost = evaluate_policy(model, solution.policy.get).cost
    least_expected_cost = compute_least_expected_cost(model, 100)
    assert least_expected_cost is not None
    assert cost is not None
    assert least_expected_cost - 1e-9 <= cost < math.inf


def test_what_is_given_up_still_bounds_and_what_is_weighted_still_plans(board):
    """A bound by few labels is below that of a whole search; weight 1.2 costs 20 % more at most."""
    model = make_model(board)
    whole = chance.ReplanSolver(chance.ReplanSolver.Options(roll_outs=2)).solve(model)
    few = {"bound_labels": 20, "weight": 1.2, "roll_outs": 2}
    rough = chance.ReplanSolver(chance.ReplanSolver.Options(**few)).solve(model)
    assert whole.lower_bound is not None
    assert rough.lower_bound is not None
    assert 0 < rough.lower_bound < whole.lower_bound
    planned = whole.trace["planned_cost"]
    assert planned <= rough.trace["planned_cost"] <= 1.2 * planned + 1e-9
    assert rough.policy is not None
    assert evaluate_policy(model, rough.policy.get).cost is not None


def test_its_policy_answers_where_nothing_was_worked_out(board):
    """With policy_states=0 a state is planned for where it is met, in the same way."""
    model = make_model(board)
    lazy = chance.ReplanSolver(chance.ReplanSolver.Options(policy_states=0, roll_outs=2)).solve(
        model
    )
    whole = chance.ReplanSolver(chance.ReplanSolver.Options(roll_outs=2)).solve(model)
    assert lazy.policy is not None
    assert whole.policy is not None
    assert not lazy.trace["policy_complete"]
    assert whole.trace["policy_complete"]
    assert len(lazy.policy) < len(whole.policy)
    item, two = (evaluate_policy(model, p.policy.get).cost for p in (lazy, whole) if p.policy)
    assert item == pytest.approx(two)
