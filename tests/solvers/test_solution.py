"""What a solver hands over."""

import math

import pytest

from situations import two_roads_task
from skillplan.solvers import Plan, Policy, Solution


@pytest.mark.parametrize("skills", [["a"], "a", (1,), None, (None,)])
def test_a_plan_is_a_tuple_of_names(skills):
    """Whatever else a solver might take for one."""
    with pytest.raises(ValueError, match="tuple of skill names"):
        Plan(skills)


def test_a_bound_is_a_number():
    """NaN is none."""
    with pytest.raises(ValueError, match="lower bound must be a number"):
        Solution(lower_bound=math.nan)


def test_a_solution_is_a_plan_or_a_policy_or_nothing():
    """Each is shown as what it is."""
    task = two_roads_task()
    plan, policy = Plan(("to_b", "finish"), 4.0), Policy({task.initial: task.skills[0]})
    assert (Solution(plan).plan, Solution(plan).policy) == (plan, None)
    assert (Solution(policy).plan, Solution(policy).policy) == (None, policy)
    assert (Solution().plan, Solution().policy) == (None, None)
    assert len(plan) == 2


def test_a_policy_is_a_mapping_that_cannot_be_changed():
    """Not through what it was made from either."""
    task = two_roads_task()
    choices = {task.initial: task.skills[0]}
    policy = Policy(choices)
    choices.clear()
    assert list(policy.items()) == [(task.initial, task.skills[0])]
    assert repr(policy) == "Policy(1 states)"
    with pytest.raises(TypeError):
        policy[task.initial] = task.skills[1]
