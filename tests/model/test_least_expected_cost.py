"""The least expected cost under chance, against closed forms and all policies that there are."""

from __future__ import annotations

import itertools
import math
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from situations import make_skill, make_task, model_of, retry_task, two_roads_task
from skillplan.errors import ModelTooLarge
from skillplan.model import compute_least_expected_cost, evaluate_policy
from skillplan.task import Facts, Task


def least(task: Task, limit: int = 1_000) -> float | None:
    return compute_least_expected_cost(model_of(task), limit)


def walk_of(moves: list[tuple[int, float, list[tuple[float, int]]]], count: int) -> Task:
    """Return a task of places 0 to count - 1; the goal is to be at the last.

    Moves are given by the place where they are made, their cost, and chances of next places.
    """
    names = tuple(f"s{i}" for i in range(count))
    facts = Facts(names, (names,))
    skills = []
    for number, (here, cost, chances) in enumerate(moves):
        outcomes = []
        for probability, there in chances:
            left = () if there == here else (names[here],)
            outcomes.append((probability, (names[there],), left))
        requires = (names[here],)
        skills.append(
            make_skill(facts, f"move_{number}", requires=requires, outcomes=outcomes, cost=cost)
        )
    return make_task(facts, skills, initial=names[:1], goal=names[-1:])


@st.composite
def walks(draw: st.DrawFn) -> Task:
    """Draw a walk of a few places with chance; some moves cost nothing, some lead astray."""
    rng = random.Random(draw(st.integers(0, 2**32)))
    count = draw(st.integers(2, 5))
    moves = []
    for here in range(count - 1):
        for _ in range(rng.randint(0, 3)):
            reached = rng.sample(range(count), rng.randint(1, 2))
            share = rng.choice([0.2, 0.5, 0.9])
            shares = [share, 1 - share] if len(reached) == 2 else [1.0]
            cost = rng.choice([0.0, 0.0, 0.5, 1.0, 3.0])
            moves.append((here, cost, list(zip(shares, reached, strict=True))))
    return walk_of(moves or [(0, 1.0, [(1.0, 1)])], count)


@given(st.floats(0.01, 1.0), st.floats(0.0, 10.0))
def test_trying_until_it_works_costs_the_inverse_of_the_probability(probability, cost):
    """However often it stays where it is."""
    assert least(retry_task(probability, cost)) == pytest.approx(cost / probability)


def test_without_chance_it_is_the_cost_of_the_cheapest_way():
    """Of two roads the longer one."""
    assert least(two_roads_task()) == pytest.approx(3.0)


def test_a_start_that_is_the_goal_costs_nothing():
    """Whatever else could be done."""
    assert least(make_task(Facts(("done",)), [], initial=("done",), goal=("done",))) == 0.0


def test_a_fall_back_is_paid_for():
    """x0 = 1 + x1 and x1 = 2 + x0 / 4, so that x0 = 4."""
    moves = [(0, 1.0, [(1.0, 1)]), (1, 2.0, [(0.75, 2), (0.25, 0)])]
    assert least(walk_of(moves, 3)) == pytest.approx(4.0)


def test_a_circle_that_costs_nothing_is_no_way_to_the_goal():
    """To go round for ever is free, and ends nowhere."""
    moves = [(0, 0.0, [(1.0, 1)]), (1, 0.0, [(1.0, 0)]), (1, 3.0, [(1.0, 2)])]
    assert least(walk_of(moves, 3)) == pytest.approx(3.0)


def test_what_may_end_astray_is_no_way_to_the_goal_either():
    """The cheap move misses one time in ten for good, so that the expensive one counts."""
    moves = [(0, 1.0, [(0.9, 2), (0.1, 1)]), (0, 7.0, [(1.0, 2)])]
    assert least(walk_of(moves, 3)) == pytest.approx(7.0)


def test_where_nothing_is_certain_to_arrive_it_is_infinite():
    """Nor where nothing leads to the goal at all."""
    assert least(walk_of([(0, 1.0, [(0.9, 2), (0.1, 1)])], 3)) == math.inf
    assert least(walk_of([(0, 1.0, [(1.0, 1)])], 3)) == math.inf


@given(task=walks())
@settings(max_examples=examples(150))
def test_it_is_the_least_of_all_policies(task):
    """Of those that always do the same in the same place, evaluated one by one."""
    options = [
        [skill for skill in task.skills if fact in str(skill.precondition)] or [None]
        for fact in task.facts.names
    ]
    values = []
    for chosen in itertools.product(*options):
        policy = dict(zip(task.facts.names, chosen, strict=True))
        value = evaluate_policy(model_of(task), lambda state, p=policy: p[next(iter(state))])
        values.append(math.inf if value.cost is None else value.cost)
    assert least(task) == pytest.approx(min(values), rel=1e-9, abs=1e-9)


def test_a_model_that_is_too_large_is_refused():
    """Rather than half looked at."""
    assert least(two_roads_task(), 4) is not None
    with pytest.raises(ModelTooLarge, match="more than 3 reachable states"):
        least(two_roads_task(), 3)


def test_values_that_do_not_come_to_rest_say_nothing():
    """Two places between which one is thrown to and fro ten thousand times."""
    moves = [(0, 1.0, [(1.0, 1)]), (1, 1.0, [(1e-4, 2), (1 - 1e-4, 0)])]
    assert least(walk_of(moves, 3)) is None
