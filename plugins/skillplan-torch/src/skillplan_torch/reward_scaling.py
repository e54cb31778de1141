"""What learners make of the environment's rewards: the reward of a step apart from that of an end.

What the environment gives stays the task's. Its kinds of reward differ a thousandfold, so that a
learner scales those of steps to a typical one, and has rewards of its own for ends.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan.env.observation import RewardFunction
from skillplan.env.transition_table import COMPLETE, GOES_ON, OUT_OF_TIME
from skillplan.task.task import Task


@dataclass(frozen=True)
class RewardScaling:
    """Splits an environment's rewards in two, and knows the size of a typical step's.

    Parameters
    ----------
    complete, out_of_time
        What the environment gives where an episode ends so.
    per_cost
        What it would have given beside that for the cost of the last skill, a factor; 0 where
        it has given it.
    counts_last
        Whether this is added to the reward where the task is completed: Table II of Moller et al.
        gives nothing for the last cost, so that the path of most reward would end with a long
        motion.
    typical
        What a skill typically loses, >= 0: the mean of all skills from where the task starts.
    """

    complete: float
    out_of_time: float
    per_cost: float
    counts_last: bool
    typical: float

    @classmethod
    def of(cls, task: Task, objective: str, *, counts_last: bool) -> RewardScaling:
        """Return how rewards of a task are split."""
        rewards = RewardFunction.of(task, objective)
        by_scheme = rewards.scheme is not None
        per_cost = float(getattr(task.reward, "per_cost", 0.0)) if by_scheme else 0.0
        late = rewards.out_of_time
        if by_scheme and not hasattr(rewards.scheme, "out_of_time"):
            late = 0.0  # it rewards the last step as any other
        losses = list(_losses(task, rewards))
        typical = sum(losses) / max(1, len(losses))
        return cls(rewards.complete, late, per_cost, counts_last, typical)

    def of_steps(
        self,
        rewards: NDArray[np.float64],
        costs: NDArray[np.float64],
        ends: NDArray[np.int8],
    ) -> NDArray[np.float64]:
        """Return the rewards of steps for their costs; 0 of those that fail. All of shape (n,)."""
        last = self.per_cost * costs
        completing = rewards - self.complete + last * self.counts_last
        late = rewards - self.out_of_time + last
        over = np.where(ends == OUT_OF_TIME, late, 0.0)
        over = np.where(ends == COMPLETE, completing, over)
        return np.where(ends == GOES_ON, rewards, over)


def _losses(task: Task, rewards: RewardFunction) -> Iterator[float]:
    """Yield what every skill would lose where the task starts, as far as it can go."""
    start = task.initial
    for skill in task.skills:
        try:
            cost = skill.cost.at(start)
        except ValueError:
            continue  # no path leads there, such as to a tool that is attached already
        yield abs(rewards.of_step(start, skill.name, cost, goal=False, out_of_time=False))
