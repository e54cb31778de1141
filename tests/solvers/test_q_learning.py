"""Q-learning."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pytest

from situations import CONFIGS
from skillplan import load_problem
from skillplan.model import TabularMDP
from skillplan.pipeline import Setup, make_model, make_solver, solve
from skillplan.solvers import greedy_rows
from skillplan.testing import SolverSuite, lid_task
from swarm_situations import base_task, minimal_starts


class TestQLearningSolver(SolverSuite):
    solver: ClassVar[str] = "q-learning"


@pytest.mark.parametrize("goal", [1, 13, 42, 66, 78])
def test_its_ways_are_step_minimal_from_all_starts(goal):
    model = make_model(base_task(37, goal))
    policy = make_solver("q-learning", {}).solve(model, seed=2).policy
    assert policy is not None
    assert minimal_starts(policy, goal) == 1


def test_with_episodes_enough_it_finds_the_optimum_of_the_board():
    task = load_problem(str(CONFIGS / "inverter_board.yaml")).task
    solution = solve(task, "q-learning", Setup(options={"q-learning": {"episodes": 200_000}}))
    assert solution.cost == pytest.approx(solve(task, "exact").cost)


def test_its_values_without_exploration_noise_are_those_of_value_iteration():
    """Nothing is left to chance here, so that a step size of 1 makes the values exact."""
    options = {"alpha": 1.0, "alpha_end": 1.0, "epsilon": 1.0}
    learned, swept = (
        solve(base_task(66, 42), name, Setup(options={name: more}))
        for name, more in (("q-learning", options), ("value-iteration", {"objective": "reward"}))
    )
    assert [s.skill for s in learned.steps] == [s.skill for s in swept.steps]


def test_of_equal_values_the_lowest_action_is_taken():
    mdp = TabularMDP.from_model(make_model(lid_task()))
    chosen = greedy_rows(mdp, np.zeros(len(mdp.actions)))
    for state, row in enumerate(chosen):
        has_rows = mdp.rows[state] < mdp.rows[state + 1]
        assert row == (mdp.rows[state] if has_rows else -1)
