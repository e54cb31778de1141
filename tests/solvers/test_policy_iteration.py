"""Policy iteration, and what it shares with value iteration: both against brute force."""

from __future__ import annotations

import itertools
import random
from typing import ClassVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from situations import cheapest_by_length, make_skill, make_task, model_of, optimum, small_tasks
from skillplan.model import TabularMDP
from skillplan.pipeline import Setup, make_model, solve
from skillplan.records import Status
from skillplan.solvers import Stop
from skillplan.solvers.mdp import BellmanSolver, PolicyIterationSolver, ValueIterationSolver
from skillplan.task import Facts
from skillplan.testing import SolverSuite
from swarm_situations import base_task

PLANNERS = ("policy-iteration", "value-iteration")


class TestPolicyIterationSolver(SolverSuite):
    solver: ClassVar[str] = "policy-iteration"


class TestPolicyIterationOnRewards(SolverSuite):
    solver: ClassVar[str] = "policy-iteration"
    options: ClassVar = {"objective": "reward"}


@st.composite
def chances(draw: st.DrawFn) -> TabularMDP:
    """Draw a model of a few states with chance; some costs are 0, some states are lost."""
    rng = random.Random(draw(st.integers(0, 2**32)))
    n = draw(st.integers(2, 5))
    rows, outcomes, successors, probabilities, costs = [0], [0], [], [], []
    for _ in range(n - 1):
        for _ in range(rng.randint(0, 3)):
            reached = rng.sample(range(n), rng.randint(1, 2))
            share = rng.choice([0.2, 0.5, 0.9])
            successors += reached
            probabilities += [share, 1 - share] if len(reached) == 2 else [1.0]
            outcomes.append(len(successors))
            costs.append(rng.choice([0.0, 0.0, 0.5, 1.0, 3.0]))
        rows.append(len(costs))
    rows.append(len(costs))
    goal = np.zeros(n, dtype=np.bool_)
    goal[-1] = True
    facts = Facts(tuple(f"s{i}" for i in range(n)))
    return TabularMDP(
        states=tuple(facts.of(name) for name in facts.names),
        goal=goal,
        rows=np.array(rows),
        actions=np.arange(len(costs)),
        costs=np.array(costs, dtype=np.float64),
        durations_s=np.array([rng.choice([1.0, 2.0]) for _ in costs]),
        outcomes=np.array(outcomes),
        successors=np.array(successors, dtype=np.int64),
        probabilities=np.array(probabilities, dtype=np.float64),
        rewards=np.zeros(len(successors)),
    )


def policy_value(mdp: TabularMDP, rows: tuple[int, ...]) -> np.ndarray:
    """Return expected cost and time of a policy, infinite where it may miss the goal."""
    n = len(mdp.states)
    chain = np.zeros((n, n))
    gains = np.zeros((n, 2))
    for state, row in enumerate(rows):
        if row >= 0:
            gains[state] = mdp.costs[row], mdp.durations_s[row]
            for k in range(mdp.outcomes[row], mdp.outcomes[row + 1]):
                chain[state, mdp.successors[k]] += mdp.probabilities[k]
    linked = np.linalg.matrix_power(np.eye(n) + chain, n) > 0
    to_goal = linked[:, mdp.goal].any(axis=1)
    proper = np.array([to_goal[linked[state]].all() for state in range(n)])
    value = np.full((n, 2), np.inf)
    inside = np.ix_(proper, proper)
    value[proper] = np.linalg.solve((np.eye(n) - chain)[inside], gains[proper])
    return value


@pytest.mark.parametrize("solver", [PolicyIterationSolver, ValueIterationSolver])
@given(mdp=chances())
@settings(max_examples=examples(120))
def test_expected_costs_are_the_least_of_all_policies(solver, mdp):
    """Then the least time; and what is chosen reaches the goal, whatever costs nothing."""
    least_cost = solver().least_cost(mdp)
    options = [
        tuple(range(begin, end)) or (-1,) for begin, end in itertools.pairwise(mdp.rows.tolist())
    ]
    values = np.array([policy_value(mdp, rows) for rows in itertools.product(*options)])
    assert least_cost.finished
    np.testing.assert_allclose(least_cost.values, values[..., 0].min(axis=0), rtol=1e-9, atol=1e-9)
    own = policy_value(mdp, tuple(least_cost.chosen.tolist()))
    np.testing.assert_allclose(own[:, 0], least_cost.values, rtol=1e-9, atol=1e-9)
    for state in range(len(mdp.states)):
        cheapest = values[:, state, 0] <= least_cost.values[state] + 1e-9
        assert own[state, 1] <= values[cheapest, state, 1].min() + 1e-6


@pytest.mark.parametrize("name", PLANNERS)
class TestClaims:
    @given(task=small_tasks())
    @settings(max_examples=examples(60))
    def test_without_chance_it_proves_what_brute_force_finds(self, name: str, task) -> None:  # type: ignore[no-untyped-def]
        """Also where the cheapest way is longer than the step limit."""
        best = optimum(cheapest_by_length(model_of(task)))
        result = solve(task, name)
        if best is None:
            assert result.status is Status.INFEASIBLE
        else:
            assert result.status is Status.OPTIMAL, result.reason
            assert result.cost == pytest.approx(best[0])
            assert len(result.steps) <= task.step_limit

    def test_an_expected_cost_is_claimed_as_bound(self, name):
        facts = Facts(("done",))
        outcomes = [(0.5, ("done",), ()), (0.5, (), ())]
        skills = [make_skill(facts, "try", forbids=("done",), outcomes=outcomes, cost=2.0)]
        model = model_of(make_task(facts, skills, goal=("done",)))
        solution = _solver(name).solve(model)
        assert solution.proved
        assert solution.lower_bound == pytest.approx(4.0)

    def test_where_no_policy_is_certain_nothing_is_claimed(self, name):
        facts = Facts(("done", "lost"))
        outcomes = [(0.5, ("done",), ()), (0.5, ("lost",), ())]
        skills = [make_skill(facts, "try", forbids=("done", "lost"), outcomes=outcomes)]
        result = solve(make_task(facts, skills, goal=("done",)), name)
        assert result.status is Status.UNSOLVED
        assert "certainty" in result.reason

    def test_two_states_that_need_each_other_are_solved(self, name):
        """Improving one state at a time from any policy would never leave either."""
        facts = Facts(("a", "b", "done"))
        hop = {"delete": ("a",), "outcomes": [(0.5, ("done",), ("a",)), (0.5, ("b",), ("a",))]}
        skills = [
            make_skill(facts, "stay_a", requires=("a",)),
            make_skill(facts, "hop", requires=("a",), outcomes=hop["outcomes"]),
            make_skill(facts, "stay_b", requires=("b",)),
            make_skill(facts, "back", requires=("b",), add=("a",), delete=("b",)),
        ]
        result = solve(make_task(facts, skills, initial=("a",), goal=("done",)), name)
        assert result.status is Status.OPTIMAL
        assert result.cost == pytest.approx(3.0)

    def test_of_equal_costs_the_faster_way_is_taken_then_the_lowest_action(self, name):
        facts = Facts(("done",))
        skills = [
            make_skill(facts, "slow", forbids=("done",), add=("done",), duration_s=3.0),
            make_skill(facts, "fast", forbids=("done",), add=("done",), duration_s=1.0),
            make_skill(facts, "same", forbids=("done",), add=("done",), duration_s=1.0),
        ]
        result = solve(make_task(facts, skills, goal=("done",)), name)
        assert [step.skill for step in result.steps] == ["fast"]

    def test_too_many_cells_leave_an_honest_bound(self, name, monkeypatch):
        from skillplan.solvers.mdp import bellman_solver

        monkeypatch.setattr(bellman_solver, "MOST_CELLS", 1)
        task = base_task(66, 1).replace(step_limit=2)
        result = solve(task, name)
        assert result.status is Status.UNSOLVED
        assert "the limit is 2" in result.reason

    def test_told_to_stop_it_claims_nothing(self, name):
        facts = Facts(("done",))
        outcomes = [(0.01, ("done",), ()), (0.99, (), ())]
        skills = [make_skill(facts, "try", forbids=("done",), outcomes=outcomes)]
        model = model_of(make_task(facts, skills, goal=("done",)))
        solver = _solver(name)
        assert solver.refuses(model) is None
        solver.stop = Stop()
        solver.stop.interrupt()
        solution = solver.solve(model)
        assert solution.proved or solution.lower_bound is None

    def test_rewards_lead_to_the_goal_in_the_fewest_steps(self, name):
        setup = Setup(options={name: {"objective": "reward"}})
        result = solve(base_task(66, 42), name, setup)
        assert result.status is Status.SOLVED
        assert result.cost == 2


def test_its_rounds_are_about_as_many_as_in_the_paper():
    """Table 3: 8 to 10."""
    assert 6 <= solve(base_task(66, 42), "policy-iteration").trace["iterations"] <= 10


def test_both_agree_in_all_values_of_a_reward():
    model = make_model(base_task(66, 42))
    options = PolicyIterationSolver.Options(objective="reward")
    results = [
        dict(solver(options).solve(model).policy or {})
        for solver in (PolicyIterationSolver, ValueIterationSolver)
    ]
    assert results[0] == results[1]


def _solver(name: str) -> BellmanSolver:
    return {"policy-iteration": PolicyIterationSolver, "value-iteration": ValueIterationSolver}[
        name
    ]()
