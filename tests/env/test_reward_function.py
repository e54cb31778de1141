"""What an environment pays."""

from __future__ import annotations

import pytest

from situations import two_roads_task
from skillplan.env import RewardFunction
from skillplan.errors import OptionError
from skillplan.task import DistanceReward, Task


def paid(reward_function: RewardFunction, task: Task, **ended: bool) -> float:
    ends = {"goal": False, "out_of_time": False, **ended}
    return reward_function.of_step(task.initial, task.skills[0].name, 3.0, **ends)


def test_by_default_the_scheme_is_paid_to_the_letter(board_task):
    reward_function = RewardFunction.of(board_task, "reward")
    assert board_task.reward is reward_function.scheme
    assert -0.1 * 3.0 == pytest.approx(paid(reward_function, board_task))
    assert 10.0 == paid(reward_function, board_task, goal=True)
    assert -10.0 == paid(reward_function, board_task, out_of_time=True)
    assert -10.0 == reward_function.infeasible


def test_the_objective_cost_pays_minus_every_cost_and_the_ends_beside_it(board_task):
    reward_function = RewardFunction.of(board_task, "cost")
    assert -3.0 == paid(reward_function, board_task)
    assert 10.0 - 3.0 == paid(reward_function, board_task, goal=True)
    assert -10.0 - 3.0 == paid(reward_function, board_task, out_of_time=True)
    assert -10.0 == reward_function.infeasible


@pytest.mark.parametrize("objective", ["reward", "cost"])
def test_without_a_scheme_costs_are_paid_and_10_or_minus_10_at_the_end(objective):
    task = two_roads_task()
    reward_function = RewardFunction.of(task, objective)
    assert [-3.0, 7.0, -13.0] == [
        paid(reward_function, task),
        paid(reward_function, task, goal=True),
        paid(reward_function, task, out_of_time=True),
    ]
    assert -10.0 == reward_function.infeasible


def test_a_scheme_without_a_figure_for_time_takes_that_of_the_infeasible():
    task = two_roads_task()
    reward = DistanceReward({task.facts.bit("a"): 1.0}, complete=1.0, infeasible=-4.0)
    reward_function = RewardFunction.of(task.replace(reward=reward), "cost")
    assert (-4.0, 1.0, -4.0) == (
        reward_function.infeasible,
        reward_function.complete,
        reward_function.out_of_time,
    )


def test_an_unknown_objective_is_refused_with_the_nearest(board_task):
    with pytest.raises(OptionError, match=r"Unknown objective 'costs'\. Did you mean 'cost'"):
        RewardFunction.of(board_task, "costs")
