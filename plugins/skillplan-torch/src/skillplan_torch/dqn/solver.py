"""The solver `dqn`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from skillplan.env.skill_vector_env import SkillVectorEnv
from skillplan.solvers.learning.learner import Training
from skillplan.task.task import Task
from skillplan_torch.dqn.options import DqnOptions
from skillplan_torch.dqn.training import DqnTraining, reward_scale
from skillplan_torch.network_learner import NetworkLearner, can_plan


class DqnSolver(NetworkLearner):
    """Learn action values, with model-based planning; keep the best evaluated policy."""

    name = "dqn"

    Options = DqnOptions
    options: DqnOptions

    def derived(self, tasks: Sequence[Task]) -> dict[str, Any]:
        """Return values, chosen by what is learned on, of the options that are null."""
        found = super().derived(tasks)
        plans = self.options.planning is not False and can_plan(self.options, tasks)
        # Without a mask most actions at random end the episode.
        blind = self.options.mask == "none" and not plans
        deterministic = all(task.deterministic for task in tasks)
        return found | self.where_null(
            exploration="count" if blind else "epsilon", updates=0.5 if deterministic else 1.0
        )

    def scales(self, task: Task) -> dict[str, float]:
        """Return the step limit, and by what the rewards of steps are multiplied."""
        return {**super().scales(task), "reward_scale": reward_scale(self.options, task)}

    def begin(self, env: SkillVectorEnv, seeds: Sequence[int], steps: int) -> Training:
        """Return a training that is yet to do its first step."""
        options = self.options.model_copy(update=self.derived([one.task for one in env.models]))
        return DqnTraining(options, env, seeds, steps)
