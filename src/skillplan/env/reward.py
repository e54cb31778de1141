"""The rewards of an environment: those of the task's scheme, or minus its costs."""

from __future__ import annotations

from dataclasses import dataclass

from skillplan.env.env_options import Objective, checked_name
from skillplan.task.reward import Reward
from skillplan.task.state import State
from skillplan.task.task import Task

# Beside costs, where the task has no reward scheme that says what.
_COMPLETE = 10.0
_FAILED = -10.0


@dataclass(frozen=True)
class RewardFunction:
    """The rewards of an environment, one a step.

    Parameters
    ----------
    scheme
        The task's reward scheme, taken as it is; None for minus the cost of every skill that is
        executed, and beside it the figures that follow.
    infeasible
        For a skill that cannot be executed; it costs nothing.
    complete
        Beside the cost of the skill that completes the task.
    out_of_time
        Beside the cost of the last skill that the step limit allows.
    """

    scheme: Reward | None
    infeasible: float
    complete: float
    out_of_time: float

    @classmethod
    def of(cls, task: Task, objective: str) -> RewardFunction:
        """Return the rewards of a task.

        For the objective ``reward`` that is the task's reward scheme, to the letter. For
        ``cost``, and of a task without a scheme, it is minus the cost, so that of the policies
        that complete the task the best rewarded is the cheapest; what ends of an episode add to
        it is taken from the scheme, or else 10 for completing the task and -10 for failing.

        Raises
        ------
        OptionError
            If there is no such objective.
        """
        checked_name("objective", objective, Objective)
        reward = task.reward
        infeasible = _FAILED if reward is None else reward.infeasible
        return cls(
            reward if objective == "reward" else None,
            infeasible,
            float(getattr(reward, "complete", _COMPLETE)),
            float(getattr(reward, "out_of_time", infeasible)),
        )

    def of_step(
        self, state: State, skill: str, cost: float, *, goal: bool, out_of_time: bool
    ) -> float:
        """Return the reward of a step that could be executed.

        Parameters
        ----------
        state, skill, cost, goal, out_of_time
            As in `Reward.of_step`.
        """
        if self.scheme is not None:
            return self.scheme.of_step(state, skill, cost, goal=goal, out_of_time=out_of_time)
        if goal:
            return self.complete - cost
        return self.out_of_time - cost if out_of_time else -cost
