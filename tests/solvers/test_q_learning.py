"""Q-learning."""

from __future__ import annotations

from typing import ClassVar

import pytest

from skillplan.pipeline import Setup, make_model, make_solver, solve
from skillplan.testing import SolverSuite
from swarm_situations import base_task, minimal_starts


class TestQLearningSolver(SolverSuite):
    solver: ClassVar[str] = "q-learning"


@pytest.mark.parametrize("goal", [1, 13, 42, 66, 78])
def test_its_ways_are_step_minimal_from_all_starts(goal):
    model = make_model(base_task(37, goal))
    policy = make_solver("q-learning", {}).solve(model, seed=2).policy
    assert policy is not None
    assert minimal_starts(policy, goal) == 1


def test_its_values_without_exploration_noise_are_those_of_value_iteration():
    """Nothing is left to chance here, so that a step size of 1 makes the values exact."""
    options = {"alpha": 1.0, "alpha_end": 1.0, "epsilon": 1.0}
    learned, swept = (
        solve(base_task(66, 42), name, Setup(options={name: more}))
        for name, more in (("q-learning", options), ("value-iteration", {"objective": "reward"}))
    )
    assert [s.skill for s in learned.steps] == [s.skill for s in swept.steps]
