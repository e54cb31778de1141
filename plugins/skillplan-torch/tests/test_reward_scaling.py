"""What steps are paid apart from ends, against figures computed by hand."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from situations import two_roads_task
from skillplan import load_problem
from skillplan.env import COMPLETE, GOES_ON, INFEASIBLE, OUT_OF_TIME, SkillVectorEnv
from skillplan.pipeline import make_model
from skillplan.task import DistanceReward
from skillplan_torch import RewardScaling

BOARD = Path(__file__).parents[3] / "configs" / "inverter_board.yaml"


@pytest.fixture(scope="module")
def board():
    """The inverter board: 10 for completing, -10 for failing, -0.1 a metre, -2.5 for tools."""
    return load_problem(BOARD).task


def walked(task, actions, objective="reward"):
    """Return rewards, costs and ends of actions from the start."""
    env = SkillVectorEnv(make_model(task), 1, mask="none", objective=objective)
    env.reset(seed=0)
    steps = []
    for action in actions:
        _, rewards, _, _, infos = env.step(np.array([action]))
        steps.append((rewards[0], infos["cost"][0], infos["end"][0]))
    return tuple(np.array(column) for column in zip(*steps, strict=True))


class TestOfTheBoard:
    OPTIMAL = (0, 1, 2, 3, 4, 5, 8, 9, 10, 11, 6, 7, 13, 14, 15)

    def test_every_step_of_the_optimal_sequence_pays_a_tenth_of_its_way(self, board):
        rewards, costs, ends = walked(board, self.OPTIMAL)
        assert ends.tolist() == [GOES_ON] * 14 + [COMPLETE]
        assert rewards[-1] == 10.0
        paid = RewardScaling.of(board, "reward", counts_last=True).of_steps(rewards, costs, ends)
        np.testing.assert_allclose(paid, -0.1 * costs, atol=1e-12)
        assert paid.sum() == pytest.approx(-0.186709, abs=1e-6)

    def test_as_table_ii_has_it_the_last_way_is_free(self, board):
        rewards, costs, ends = walked(board, self.OPTIMAL)
        paid = RewardScaling.of(board, "reward", counts_last=False).of_steps(rewards, costs, ends)
        assert paid[-1] == 0.0
        assert paid.sum() == pytest.approx(-0.1 * costs[:-1].sum())

    def test_a_skill_that_fails_pays_for_no_way(self, board):
        rewards, costs, ends = walked(board, [1])
        assert (rewards.tolist(), ends.tolist()) == ([-10.0], [INFEASIBLE])
        pay = RewardScaling.of(board, "reward", counts_last=True)
        assert pay.of_steps(rewards, costs, ends).tolist() == [0.0]

    def test_at_the_step_limit_the_last_way_counts_and_the_end_does_not(self, board):
        rewards, costs, ends = walked(replace(board, step_limit=2), [0, 1])
        assert rewards.tolist() == [pytest.approx(-0.1 * costs[0]), -10.0]
        assert ends.tolist() == [GOES_ON, OUT_OF_TIME]
        pay = RewardScaling.of(board, "reward", counts_last=False)
        np.testing.assert_allclose(pay.of_steps(rewards, costs, ends), -0.1 * costs)

    def test_a_tool_changed_again_pays_its_penalty(self, board):
        names = [skill.name for skill in board.skills]
        tools = [i for i, name in enumerate(names) if name.startswith("load")]
        others = [i for i in tools if "gripper" not in names[i]]
        rewards, costs, ends = walked(board, [others[0], (set(tools) - set(others)).pop()])
        assert ends.tolist() == [GOES_ON, GOES_ON]
        paid = RewardScaling.of(board, "reward", counts_last=True).of_steps(rewards, costs, ends)
        assert paid.tolist() == rewards.tolist()
        assert -2.5 in paid

    def test_by_cost_every_step_pays_its_cost(self, board):
        rewards, costs, ends = walked(board, self.OPTIMAL, "cost")
        for counts_last in (False, True):
            pay = RewardScaling.of(board, "cost", counts_last=counts_last)
            np.testing.assert_allclose(pay.of_steps(rewards, costs, ends), -costs, atol=1e-12)

    def test_a_typical_step_is_the_mean_of_all_skills_that_can_be_priced_at_the_start(self, board):
        priced = []
        for skill in board.skills:
            try:
                priced.append(skill.cost.at(board.initial))
            except ValueError:
                assert skill.name == "load(gripper)"
        assert len(priced) == 15
        pay = RewardScaling.of(board, "cost", counts_last=True)
        assert pay.typical == pytest.approx(sum(priced) / 15)


class TestOfOtherTasks:
    @pytest.mark.parametrize("objective", ["reward", "cost"])
    @pytest.mark.parametrize("counts_last", [False, True])
    def test_without_a_scheme_every_step_pays_its_cost(self, objective, counts_last):
        task = two_roads_task()
        pay = RewardScaling.of(task, objective, counts_last=counts_last)
        assert pay.typical == (1 + 1 + 3 + 1) / 4
        for limit, actions in ((20, [0, 1, 3]), (1, [2]), (2, [0, 1])):
            rewards, costs, ends = walked(replace(task, step_limit=limit), actions, objective)
            assert ends[-1] == (COMPLETE if limit == 20 else OUT_OF_TIME)
            np.testing.assert_allclose(pay.of_steps(rewards, costs, ends), -costs, atol=1e-12)

    @pytest.mark.parametrize(
        ("limit", "actions"), [(20, [0, 1, 3]), (1, [2]), (2, [0, 1])], ids=str
    )
    def test_where_distances_are_paid_no_step_gains(self, limit, actions):
        """Veeramani and Muthuswamy: a distance each step, 1 for completing."""
        task = two_roads_task(step_limit=limit)
        a, b = (int(task.facts.of(name).bits) for name in ("a", "b"))
        reward = DistanceReward({a: 2.0, b: 3.0, 0: 0.0}, complete=1.0, infeasible=-5.0)
        task = replace(task, reward=reward)
        rewards, costs, ends = walked(task, actions)
        paid = RewardScaling.of(task, "reward", counts_last=True).of_steps(rewards, costs, ends)
        # Of where a step starts, whatever it comes to.
        distances = {0: 0.0, 1: 2.0, 2: 0.0, 3: 3.0}
        assert paid.tolist() == [-distances[action] for action in actions]
