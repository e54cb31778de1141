"""Fewest steps of walking: the same as the bench counts by its geometry."""

import pytest

from situations import make_skill, make_task
from skillplan.task import Facts, Place
from skillplan.views.figures import WalkSteps
from skillplan_swarmitfix import BaseGrounding, Bench, at


@pytest.fixture
def bench():
    """A small bench of all eleven actions."""
    return Bench(4, 5, 0.1, 11)


def test_steps_are_those_of_the_bench(bench):
    """From every position, found by skills alone."""
    goal = 7
    task = BaseGrounding(bench, {0: 0.0}.fromkeys(range(-360, 361), 1.0)).task("walk", 0, goal)
    walk = WalkSteps(task, at(bench.name(goal)))
    expected = {at(bench.name(i)): int(n) for i, n in enumerate(bench.distances(goal))}
    assert expected == walk.fewest


def test_successors_stand_in_the_order_of_the_actions(bench):
    """Of equal steps the first action counts, as on the bench."""
    task = BaseGrounding(bench, {0: 0.0}.fromkeys(range(-360, 361), 1.0)).task("walk", 0, 7)
    walk = WalkSteps(task, at(bench.name(7)))
    ends = [at(bench.name(end)) for end in bench.successors[3].tolist() if end >= 0]
    assert ends == list(walk.successors[at(bench.name(3))])


def test_a_place_from_which_nothing_leads_to_the_goal_has_no_steps():
    """A road of one direction."""
    facts = Facts(["a", "b", "c"])
    go = make_skill(facts, "go", requires=["a"], add=["b"], delete=["a"])
    task = make_task(facts, [go], initial=["a"], goal=["b"]).replace(
        places={name: Place(name, (0.0, 0.0, 0.0)) for name in ("a", "b", "c")}
    )
    assert {"b": 0, "a": 1} == WalkSteps(task, "b").fewest
