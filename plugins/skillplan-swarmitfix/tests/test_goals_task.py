"""Choosing goals of the base, as a task."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from skillplan.pipeline import make_model, solve
from skillplan_swarmitfix import (
    Bench,
    GoalRule,
    GoalSet,
    How,
    Timings,
    choose,
    goal_of,
    goals_task,
    serve,
)

BENCH = Bench(6, 13, 0.34)
SWING_S = Timings().swing_s
HOME = BENCH.position("C66")


def made(sets):
    return [
        GoalSet(i, (0.0, 0.0), (1.0, 0.0), tuple(sorted(item)), How.EQ34, "", (0.5, 0.2))
        for i, item in enumerate(sets)
    ]


def random_sets(seed):
    rng = random.Random(seed)
    return made([rng.sample(range(78), rng.randint(1, 6)) for _ in range(rng.randint(1, 9))])


@settings(max_examples=examples(25))
@given(st.integers(0, 10_000))
def test_exact_search_finds_what_the_dynamic_program_finds(seed):
    sets = random_sets(seed)
    choice = choose(BENCH, HOME, sets, GoalRule.WHOLE_TRAJECTORY, SWING_S)
    task = goals_task(BENCH, HOME, sets, SWING_S, choice.goals, name="goals")
    result = solve(task, "exact")
    assert result.status == "optimal"
    assert result.cost == choice.total_steps
    duration_s = sum(step.duration_s for step in result.steps)
    assert duration_s == pytest.approx(choice.duration_s)


@pytest.mark.parametrize("rule", list(GoalRule))
def test_the_preset_is_the_plan_of_the_choice(rule):
    sets = random_sets(3)
    choice = choose(BENCH, HOME, sets, rule, SWING_S)
    task = goals_task(BENCH, HOME, sets, SWING_S, choice.goals, name="goals", sha256="ab")
    assert task.preset is not None
    assert tuple(BENCH.position(goal_of(name)) for name in task.preset) == choice.goals
    model, state, total = make_model(task), task.initial, 0.0
    for name in task.preset:
        assert task.skill(name).applicable(state)
        step = model.transition(state, task.skill(name))
        state, total = step.next_state, total + step.cost
    assert model.is_goal(state)
    assert total == choice.total_steps
    assert (task.sha256, task.stage, task.metric.unit) == ("ab", "goals", "steps")


def test_a_goal_occupies_the_pins_that_the_base_is_docked_on():
    task = goals_task(BENCH, HOME, made([[16]]), SWING_S, None, name="goals")
    (skill,) = task.skills
    case = skill.case(task.initial)
    assert case is not None
    assert case.occupies == {BENCH.pin_name(int(pin)) for pin in BENCH.legs[16]}
    assert task.preset is None


def test_sets_are_served_in_their_order_and_once():
    task = goals_task(BENCH, HOME, made([[16, 17], [16], [30]]), SWING_S, None, name="goals")
    model, state = make_model(task), task.initial
    for number, position in ((1, "C17"), (2, "C17"), (3, "C31")):
        applicable = {skill.name for skill in model.applicable(state)}
        assert {name.partition(":")[0] for name in applicable} == {f"serve({number}"}
        step = model.transition(state, task.skill(serve(number, position)))
        state = step.next_state
        assert task.places_in(state)[0].name == position
    assert model.is_goal(state)
    assert not model.applicable(state)


def test_a_plan_can_be_given_by_names():
    task = goals_task(BENCH, HOME, made([[16], [30]]), SWING_S, None, name="goals")
    names = [skill.name for skill in task.parse_sequence("serve(1:C17), serve(2:C31)")]
    assert names == ["serve(1:C17)", "serve(2:C31)"]
    assert goal_of(names[1]) == "C31"


def test_a_preset_that_is_no_choice_is_refused():
    for goals in ((16,), (16, 16)):
        with pytest.raises(ValueError, match="one position of every goal set"):
            goals_task(BENCH, HOME, made([[16], [30]]), SWING_S, goals, name="goals")


def test_without_sets_there_is_no_task():
    with pytest.raises(ValueError, match="at least one goal set"):
        goals_task(BENCH, HOME, [], SWING_S, None, name="goals")
