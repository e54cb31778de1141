"""Chance that depends on the state: every installed learner solves it, or refuses in words."""

from __future__ import annotations

import pytest

from situations import two_places_task
from skillplan.pipeline import registry, solve
from skillplan.records import Status
from skillplan.solvers import EpisodicSolver, Learner
from skillplan.solvers.mdp import BellmanSolver

LEARNERS = (Learner, EpisodicSolver, BellmanSolver)
# They are made for chance, and learn nothing.
PLANNERS = ("auto", "job-values", "replan")
# These have to solve it.
SOLVE = {
    *("dqn", "ppo", "learned-model", "q-learning", "sarsa", "monte-carlo"),
    *("value-iteration", "policy-iteration", "auto"),
}


def installed():
    """Return the names of the solvers; a learner of a new plugin is among them."""
    names = registry.names("solver")
    loaded = {name: registry.load("solver", name) for name in names}
    learners = [name for name, solver in loaded.items() if issubclass(solver, LEARNERS)]
    return sorted({*learners, *PLANNERS} & set(names))


@pytest.mark.parametrize("name", installed())
def test_the_place_where_the_skill_mostly_succeeds_is_chosen(name):
    """Success in 1 of 10 tries here, in 9 of 10 at the other place: 1 + 1 / 0.9 against 10."""
    result = solve(two_places_task(), name, seed=1)
    if result.status is Status.REFUSED and name not in SOLVE:
        assert result.reason
        return
    assert result.status in (Status.SOLVED, Status.OPTIMAL), result.reason
    assert result.cost == pytest.approx(1 + 1 / 0.9)
    assert next(step.skill for step in result.steps) == "go"


def test_the_list_has_all_learners_of_this_project():
    assert set(installed()) >= SOLVE
