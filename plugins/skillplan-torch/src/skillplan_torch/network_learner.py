"""What `dqn` and `ppo` have in common as solvers: what they choose by the task."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from skillplan.model.skill_model import SkillModel
from skillplan.solvers.learned_model import can_model
from skillplan.solvers.learning.learner import MODEL_BASED, Learner, usual_steps
from skillplan.task.task import Task
from skillplan_torch.network_options import NetworkOptions


class NetworkLearner(Learner):
    """A learner that trains networks on scaled rewards.

    Attributes
    ----------
    steps_factor
        How many times the usual number of steps it takes.
    """

    Options = NetworkOptions
    options: NetworkOptions
    steps_factor = 1.0

    @property
    def hidden_layers(self) -> tuple[int, ...]:
        """Units of every hidden layer."""
        return (self.options.width,) * self.options.layers

    def derived(self, tasks: Sequence[Task]) -> dict[str, Any]:
        """Return values, chosen by what is learned on, of the options that are null."""
        return self.where_null(
            steps=usual_steps(tasks, self.steps_factor),
            planning=can_plan(self.options, tasks),
        )

    def figures(self, model: SkillModel) -> dict[str, Any]:
        """Return the learner's full name: whether it plans its episodes is part of the result."""
        tasks = [model.task]
        plans = self.options.planning is not False and can_plan(self.options, tasks)
        return {"learner": f"{self.name}{MODEL_BASED}"} if plans else {}

    def where_null(self, **values: Any) -> dict[str, Any]:
        """Return those of the values whose option is null."""
        return {
            name: value for name, value in values.items() if getattr(self.options, name) is None
        }


def can_plan(options: NetworkOptions, tasks: Sequence[Task]) -> bool:
    """Return whether episodes can be planned with learned action schemas."""
    return can_model(tasks, options.observation)
