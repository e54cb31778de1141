"""The reward scheme, Table II of the paper."""

import itertools
import math

import pytest

from skillplan.model import replay
from skillplan.pipeline import Setup, make_model
from skillplan.task import Condition, Facts, Penalty, RewardScheme

FACTS = Facts(("changed_tool",))
AGAIN = Penalty(
    "repeated_tool_change",
    -2.5,
    frozenset({"load(a)", "load(b)"}),
    Condition(FACTS.of("changed_tool"), FACTS.none),
)
TABLE_2 = RewardScheme(-10.0, 10.0, -0.1, -10.0, (AGAIN,))


@pytest.mark.parametrize("index", range(4))
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_rewards_are_finite(index, value):
    """Every figure is checked."""
    figures = [-10.0, 10.0, -0.1, -10.0]
    figures[index] = value
    with pytest.raises(ValueError, match="finite"):
        RewardScheme(*figures)


def test_penalties_are_finite():
    """Theirs as well."""
    with pytest.raises(ValueError, match="finite"):
        RewardScheme(0, 0, 0, 0, (Penalty("p", math.inf, frozenset(), AGAIN.when),))


@pytest.mark.parametrize(
    ("goal", "out_of_time", "changed", "load"), list(itertools.product([False, True], repeat=4))
)
def test_exactly_one_term_of_table_2_is_paid_in_a_step(goal, out_of_time, changed, load):
    """The goal before the limit before a repeated tool change before the cost."""
    state = FACTS.of("changed_tool") if changed else FACTS.none
    skill = "load(a)" if load else "pick(a)"
    paid = TABLE_2.of_step(state, skill, 0.7, goal=goal, out_of_time=out_of_time)
    if goal:
        expected = 10.0
    elif out_of_time:
        expected = -10.0
    elif changed and load:
        expected = -2.5
    else:
        expected = -0.1 * 0.7
    assert expected == paid


def rewards_of(task, text):
    walked = replay(make_model(task, Setup(collision=("precedence",))), task.parse_sequence(text))
    return walked, [step.reward for step in walked.steps]


def test_the_board_pays_a_repeated_tool_change_once_for_every_repetition(board_task):
    """The first change costs its way, the next one right after it the penalty."""
    walked, rewards = rewards_of(board_task, "13,12,13")
    assert rewards[0] == -0.1 * walked.steps[0].cost
    assert rewards[1:] == [-2.5, -2.5]


def test_a_tool_change_after_other_work_is_not_repeated(board_task):
    """Only one right after another is."""
    walked, rewards = rewards_of(board_task, "13,12,0,1,13")
    assert rewards[4] == -0.1 * walked.steps[4].cost


def test_the_last_step_to_the_goal_is_paid_for_completion_only(board_task):
    """Also where it exhausts the step limit."""
    text = "0,1,2,3,4,5,8,9,10,11,6,7,13,14,15"
    walked, rewards = rewards_of(board_task, text)
    assert rewards[-1] == 10.0
    assert rewards[:-1] == [-0.1 * step.cost for step in walked.steps[:-1]]
    assert rewards_of(board_task.replace(step_limit=15), text)[1] == rewards


def test_the_step_that_exhausts_the_limit_is_paid_for_that_only(board_task):
    """Where it does not reach the goal."""
    _, rewards = rewards_of(board_task.replace(step_limit=2), "0,1")
    assert rewards[-1] == -10.0


def test_a_separate_change_is_repeated_where_the_new_tool_comes_off_at_once(motor_drive_task):
    """An offload right after a load; a load after an offload is one change."""
    text = "offload(gripper),load(suction_cup),offload(suction_cup),load(gripper)"
    walked, rewards = rewards_of(motor_drive_task, text)
    costs = [-0.1 * step.cost for step in walked.steps]
    assert rewards == [costs[0], costs[1], -2.5, costs[3]]
