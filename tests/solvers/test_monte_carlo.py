"""First-visit Monte Carlo with exploring starts."""

from __future__ import annotations

from typing import ClassVar

import pytest

from example_count import examples
from situations import make_skill, make_task
from skillplan.pipeline import make_model, make_solver
from skillplan.task import Facts
from skillplan.testing import SolverSuite
from swarm_situations import base_task, minimal_starts


class TestMonteCarloSolver(SolverSuite):
    solver: ClassVar[str] = "monte-carlo"


@pytest.mark.slow(reason="learns a bench; value iteration is step-minimal in every run")
def test_its_ways_are_step_minimal_from_nearly_all_starts_to_all_goals():
    shares = []
    # In every run every sixth goal.
    for goal in range(1, 79, 78 // examples(78, fewest=13)):
        model = make_model(base_task(66 if goal != 66 else 1, goal))
        policy = make_solver("monte-carlo", {}).solve(model, seed=2).policy
        assert policy is not None
        shares.append(minimal_starts(policy, goal))
    assert sum(shares) / len(shares) >= 0.99


def test_a_value_moves_towards_the_return_after_its_first_visit():
    """One place; trying costs 1 with an even chance to end: discounted by hand.

    The task has no reward scheme: its end is worth the largest cost times the step limit.
    """
    facts = Facts(("here", "done"))
    outcomes = [(0.5, ("done",), ("here",)), (0.5, (), ())]
    attempt = make_skill(facts, "try", requires=("here",), outcomes=outcomes)
    task = make_task(facts, [attempt], initial=("here",), goal=("done",), step_limit=8)
    options = {"episodes": 40, "alpha_end": 0.5, "gamma": 0.9, "record": 40, "watch": "here"}
    trace = make_solver("monte-carlo", options).solve(make_model(task), seed=11).trace
    value, values = 0.0, []
    for steps in trace["steps_per_episode"]:
        reward = sum(-(0.9**step) for step in range(int(steps))) + 0.9**steps * 8
        value += 0.5 * (reward - value)
        values.append(value)
    assert trace["q_values"]["here"]["try"] == pytest.approx(values)


def test_a_cut_is_not_an_end():
    """Episodes of one step: the return continues with the value of the place reached."""
    facts = Facts(("a", "b", "done"))
    skills = [
        make_skill(facts, "go", requires=("a",), add=("b",), delete=("a",)),
        make_skill(facts, "end", requires=("b",), add=("done",), delete=("b",)),
    ]
    task = make_task(facts, skills, initial=("a",), goal=("done",), step_limit=8)
    options = {"max_steps": 1, "starts": "exploring", "record": 1, "watch": "a,b", "gamma": 0.5}
    trace = make_solver("monte-carlo", options).solve(make_model(task)).trace
    assert trace["q_values"]["b"]["end"] == [pytest.approx(-1 + 0.5 * 8)]
    assert trace["q_values"]["a"]["go"] == [pytest.approx(-1 + 0.5 * 3)]
    assert trace["cut_off"] > 0
