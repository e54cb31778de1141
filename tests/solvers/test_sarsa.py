"""SARSA with the paper's parameters."""

from __future__ import annotations

from typing import ClassVar

import pytest

from skillplan.pipeline import make_model, make_solver
from skillplan.solvers import SarsaSolver
from skillplan.testing import SolverSuite
from swarm_situations import base_task, minimal_starts
from thinned import release_case, slow_case


class TestSarsaSolver(SolverSuite):
    solver: ClassVar[str] = "sarsa"


class TestExpectedSarsaSolver(SolverSuite):
    solver: ClassVar[str] = "sarsa"
    options: ClassVar = {"expected": True, "alpha_end": 0.01}


def test_the_defaults_are_the_parameters_of_the_paper():
    options = SarsaSolver().options
    assert (options.gamma, options.alpha, options.alpha_end) == (0.999, 0.1, None)
    derived = SarsaSolver().derived([base_task(66, 42)])
    assert derived == {
        "episodes": 35_000,
        "starts": "exploring",
        "optimistic": False,
        "alpha_end": 0.1,
        "epsilon": 0.1,
        "epsilon_end": 0.1,
    }


@pytest.mark.parametrize(
    "every",
    [
        slow_case(3, reason="learns a bench; value iteration is step-minimal in every run"),
        release_case(1, reason="learns a bench for every goal"),
    ],
)
def test_its_ways_are_step_minimal_from_nearly_all_starts_to_goals(every):
    """To all goals, or to every third."""
    shares = []
    for goal in range(1, 79, every):
        model = make_model(base_task(66 if goal != 66 else 1, goal))
        policy = make_solver("sarsa", {}).solve(model, seed=2).policy
        assert policy is not None
        shares.append(minimal_starts(policy, goal))
    assert sum(shares) / len(shares) >= 0.995


def test_the_second_parameter_set_of_the_paper_converges_more_slowly():
    """Fig. 8: all along, set 2 takes more steps an episode than set 1."""
    model = make_model(base_task(66, 42))
    first, second = (
        make_solver("sarsa", {"record": 35, **options}).solve(model).trace["steps_per_episode"]
        for options in ({}, {"gamma": 0.85, "alpha": 0.001, "epsilon": 0.01})
    )
    assert all(left < other for left, other in zip(first, second, strict=True))


def test_the_first_episode_wanders():
    """Fig. 8: hundreds of steps where ways of four would do."""
    trace = make_solver("sarsa", {"record": 1}).solve(make_model(base_task(66, 42))).trace
    assert trace["steps_of_first_episode"] > 100
    assert trace["steps_per_episode"][-1] < 6


def test_in_c66_the_action_b2_turns_out_best():
    """Fig. 7a."""
    options = {"record": 10, "watch": "at(C66)"}
    trace = make_solver("sarsa", options).solve(make_model(base_task(66, 42))).trace
    curves = trace["q_values"]["at(C66)"]
    assert max(curves, key=lambda name: curves[name][-1]) == "B2"
