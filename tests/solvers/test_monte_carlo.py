"""First-visit Monte Carlo with exploring starts."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pytest

from example_count import examples
from skillplan.pipeline import make_model, make_solver
from skillplan.solvers import Environment, Schedule, monte_carlo_episodes
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


def test_a_row_moves_towards_what_followed_its_first_visit():
    """One state; staying costs 1 with an even chance to end: discounted by hand."""
    env = Environment(
        rows=np.array([0, 1, 1]),
        outcomes=np.array([0, 2]),
        successors=np.array([1, 0]),
        probabilities=np.array([0.5, 0.5]),
        rewards=np.array([-1.0, -1.0]),
        ends=np.array([False, True]),
        final=np.zeros(2),
        starts=np.array([0]),
    )
    schedule = Schedule(0.5, 0.0, 0.0, 0.0, 0.9, 50)
    stream = np.array([11], dtype=np.uint64)
    value, q, seen = 0.0, np.zeros(1), np.full(1, -1)
    for episode in range(40):
        lengths = np.zeros(1, dtype=np.int64)
        monte_carlo_episodes(
            env, schedule, episode, q, seen, np.zeros(50, int), np.zeros(50), stream, lengths
        )
        paid = -sum(0.9**step for step in range(lengths[0]))
        value += 0.5 * (paid - value)
        assert q[0] == pytest.approx(value)
        assert seen[0] == -1
