"""The lazy model."""

from typing import Any

import pytest
from hypothesis import given

import situations
from skillplan.checks import Feasibility
from skillplan.domains.assembly import AssemblyConfig, ground
from skillplan.errors import SearchStopped
from skillplan.model import SkillModel, Transition, explain_obstruction
from skillplan.pipeline import Setup, make_model
from skillplan.task import Facts, Task, Verdict
from skillplan.testing import lid_content, lid_task, reachable_states, shut_box_task


def test_a_transition_leads_somewhere_at_a_cost():
    """Both checks of its constructor."""
    task = situations.two_roads_task()
    state, skill = task.initial, task.skills[0]
    with pytest.raises(ValueError, match="probabilities must sum to 1"):
        Transition(state, skill, ((0.5, state),), 1.0, 1.0)
    with pytest.raises(ValueError, match="probabilities must sum to 1"):
        Transition(state, skill, (), 1.0, 1.0)
    for cost in (-1.0, float("nan")):
        with pytest.raises(ValueError, match="cost must be >= 0"):
            Transition(state, skill, ((1.0, state),), cost, 1.0)


def test_what_is_applicable_asks_nobody():
    """Nor does a predicted transition, nor the goal."""
    task = situations.two_roads_task()
    back_end = situations.fake_back_end(task)
    model = situations.model_of(task, back_end)
    assert [s.name for s in model.applicable(model.initial)] == ["to_a", "to_b"]
    assert model.transition(model.initial, task.skills[0]).cost == 1.0
    assert not model.is_goal(model.initial)
    assert back_end.asked == []
    assert model.stats.checks == 0


def test_transitions_ask_about_each_applicable_skill_once():
    """However often they are looked at."""
    task = situations.two_roads_task()
    back_end = situations.fake_back_end(task, Verdict.feasible())
    model = situations.model_of(task, back_end)
    for _ in range(3):
        steps = model.transitions(model.initial)
    assert [name for name, _ in back_end.asked] == ["to_a", "to_b"]
    assert [(s.skill.name, str(s.next_state), s.cost) for s in steps] == [
        ("to_a", "{a}", 1.0),
        ("to_b", "{b}", 3.0),
    ]
    assert (model.stats.states, model.stats.checks) == (1, 2)


def test_what_is_unknown_is_left_out_and_counted():
    """What is infeasible is left out only."""
    task = situations.two_roads_task()

    def answer(skill, state):
        if skill.name == "to_a":
            return Verdict.unknown("too slow")
        return Verdict.infeasible("blocked")

    model = situations.model_of(task, situations.fake_back_end(task, answer))
    assert model.transitions(model.initial) == ()
    assert model.stats.unknown == 1


def test_a_skill_with_chance_leads_to_several_states():
    """The nominal one first."""
    model = situations.model_of(situations.retry_task(0.25))
    (step,) = model.transitions(model.initial)
    assert [(p, str(s)) for p, s in step.outcomes] == [(0.25, "{done}"), (0.75, "{}")]
    assert str(step.next_state) == "{done}"


@given(situations.small_assemblies())
def test_the_bit_masks_of_the_model_agree_with_the_preconditions(content):
    """In every reachable state: applicable skills are those whose precondition holds."""
    task = situations.assembly(content)
    model = situations.model_of(task)
    for state in reachable_states(model, 200):
        expected = [skill for skill in task.skills if skill.precondition.holds(state)]
        assert expected == model.applicable(state)
        for step in model.transitions(state):
            assert sum(p for p, _ in step.outcomes) == pytest.approx(1)
            assert step.skill.postcondition.holds(step.next_state)


def test_a_solver_that_goes_on_long_after_the_stop_is_cut_off():
    """Wherever it asks, also about states that it has asked about before."""
    task = situations.two_roads_task()
    overdue = [False]
    model = SkillModel(Feasibility(task), lambda: overdue[0])
    model.transitions(model.initial)
    overdue[0] = True
    with pytest.raises(SearchStopped):
        model.verdict(model.initial, task.skills[0])
    with pytest.raises(SearchStopped):
        model.transitions(model.initial)


def test_the_model_passes_on_what_its_task_says():
    """Initial state, step limit and goal."""
    facts = Facts(("a",))
    task = situations.make_task(
        facts, [situations.make_skill(facts, "do", add=("a",))], goal=("a",), step_limit=7
    )
    model = situations.model_of(task)
    assert (model.initial, model.step_limit) == (facts.none, 7)
    assert model.is_goal(facts.of("a"))


# What is said of a task that cannot be done.


def lid_with(**changes: Any) -> Task:
    content = lid_content()
    content["parts"] = {**content["parts"], **changes}
    return ground(AssemblyConfig.model_validate(content), "")


def test_the_skill_that_fails_everywhere_is_named_with_its_reason():
    fuse = {**lid_content()["parts"]["fuse"], "goal_m": [0.57, 0.0]}
    model = make_model(lid_with(fuse=fuse), Setup(collision=("aabb",), with_chart=False))
    message = explain_obstruction(model)
    assert message == (
        "place(fuse) fails in all 4 states in which it can be tried: "
        "aabb: fuse has nothing beneath it"
    )


def test_only_what_the_goal_lacks_is_named():
    message = explain_obstruction(make_model(shut_box_task()))
    assert message is not None
    assert message.startswith("place(fuse)")
    assert "load(" not in message


def test_where_every_skill_succeeds_somewhere_none_is_blamed():
    assert explain_obstruction(make_model(lid_task(), Setup(collision=("aabb",)))) is None


def test_a_task_with_too_many_states_is_not_gone_through():
    model = make_model(shut_box_task(), Setup(collision=("precedence",)))
    assert explain_obstruction(model, most_states=2) is None
