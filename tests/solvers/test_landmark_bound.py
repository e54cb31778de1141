"""The bound: admissible and consistent in every reachable state."""

import pytest
from hypothesis import given, settings

from example_count import examples
from situations import (
    assembly,
    costs_to_go,
    make_skill,
    make_task,
    model_of,
    small_assemblies,
    small_tasks,
    two_roads_task,
)
from skillplan.solvers import COST_UNIT, LandmarkBound, convert_from_units, convert_to_units
from skillplan.task import Facts


def assert_admissible_and_consistent(task):
    """Hold the bound against the true costs to go, no back end asked; return its worst ratio."""
    arrows, cost, steps = costs_to_go(model_of(task))
    bound = LandmarkBound(task)
    # Whole units: each of the skills to go may be rounded by half of one.
    slack = len(task.skills) * 4
    for state, leaving in arrows.items():
        units, length = bound(state)
        if units < 0:
            assert cost[state] == float("inf")
            continue
        assert units <= cost[state] / COST_UNIT + slack
        assert length <= steps[state]
        for _, step_cost, target in leaving:
            further, more = bound(target)
            if further >= 0:
                assert units <= convert_to_units(step_cost) + further
                assert length <= 1 + more
    return arrows, cost, bound


@settings(max_examples=examples(150))
@given(small_assemblies())
def test_it_never_exceeds_the_true_cost_to_go_and_never_jumps(content):
    """On random assemblies: swap and separate tool changes, stacks, feeders, reloading."""
    assert_admissible_and_consistent(assembly(content))


@settings(max_examples=examples(400))
@given(small_tasks())
def test_it_holds_on_tasks_of_any_structure(task):
    """Dead ends, detours, several makers of a fact, skills that undo others, free skills."""
    assert_admissible_and_consistent(task)


@pytest.mark.parametrize("situation", ["lid_task", "board_task"])
def test_it_never_exceeds_the_true_cost_to_go_on(situation, request):
    """The lid and the board, in every state that can be reached without regard to collisions."""
    task = request.getfixturevalue(situation)
    arrows, _, bound = assert_admissible_and_consistent(task)
    goals = [state for state in arrows if task.goal.holds(state)]
    assert goals
    assert all(bound(state) == (0, 0) for state in goals)


def test_it_is_not_idle(board_task):
    """At the start of the board it covers four fifths of the optimum and nearly all its skills."""
    units, length = LandmarkBound(board_task)(board_task.initial)
    assert 0.8 * 1.86709 < convert_from_units(units) <= 1.86709
    assert 14 <= length <= 15


def test_a_goal_out_of_reach_is_a_dead_end():
    """Also where only its first precondition is."""
    facts = Facts(("a", "b", "done"))
    skills = [make_skill(facts, "finish", requires=("a",), add=("done",))]
    task = make_task(facts, skills, goal=("done",))
    assert LandmarkBound(task)(task.initial) == (-1, 0)
    assert LandmarkBound(task)(facts.of("a")) == (convert_to_units(1.0), 1)


def test_a_fact_with_several_makers_counts_what_they_have_in_common():
    """Either of two roads leads through the same gate."""
    facts = Facts(("gate", "done"))
    skills = [
        make_skill(facts, "open", add=("gate",), cost=5.0),
        make_skill(facts, "left", requires=("gate",), add=("done",), cost=1.0),
        make_skill(facts, "right", requires=("gate",), add=("done",), cost=2.0),
    ]
    task = make_task(facts, skills, goal=("done",))
    assert LandmarkBound(task)(task.initial) == (convert_to_units(5.0), 1)


def test_what_only_one_skill_brings_about_is_a_landmark():
    """On two roads: the last step and nothing else."""
    task = two_roads_task()
    assert LandmarkBound(task)(task.initial) == (convert_to_units(1.0), 1)


@pytest.mark.parametrize("cost", [0.0, 1e-12, 0.1, 1.8670860141568904, 12345.678])
def test_units_keep_twelve_digits(cost):
    """A cost survives the way to whole units and back."""
    assert convert_from_units(convert_to_units(cost)) == pytest.approx(cost, rel=1e-12, abs=1e-12)
    assert isinstance(convert_to_units(cost), int)
