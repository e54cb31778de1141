"""What a step pays a learner for its cost, apart from what the end of an episode pays."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan.env.reward import Payment
from skillplan.env.transition_table import COMPLETE, GOES_ON, OUT_OF_TIME
from skillplan.task.task import Task


@dataclass(frozen=True)
class StepPay:
    """Splits rewards of an environment in two.

    Parameters
    ----------
    complete, out_of_time
        What the environment pays where an episode ends so.
    per_cost
        What it would have paid beside that for the cost of the last skill, a factor; 0 where it
        has paid it.
    counts_last
        Whether a learner is to be told so where the task is completed: Table II of Moller et al.
        pays nothing for the last cost, so that the best paid way would end with a long one.
    usual
        What a skill usually loses: the mean of all skills from where the task starts.
    """

    complete: float
    out_of_time: float
    per_cost: float
    counts_last: bool
    usual: float

    @classmethod
    def of(cls, task: Task, objective: str, *, counts_last: bool) -> StepPay:
        """Return how rewards of a task are split."""
        payment = Payment.of(task, objective)
        by_scheme = payment.scheme is not None
        per_cost = float(getattr(task.reward, "per_cost", 0.0)) if by_scheme else 0.0
        late = payment.out_of_time
        if by_scheme and not hasattr(payment.scheme, "out_of_time"):
            late = 0.0  # it pays the last step as any other
        losses = list(_losses(task, payment))
        usual = sum(losses) / max(1, len(losses))
        return cls(payment.complete, late, per_cost, counts_last, usual)

    def of_steps(
        self,
        rewards: NDArray[np.float64],
        costs: NDArray[np.float64],
        ends: NDArray[np.int8],
    ) -> NDArray[np.float64]:
        """Return what steps paid for their costs; 0 of those that fail. All of shape (n,)."""
        last = self.per_cost * costs
        completing = rewards - self.complete + last * self.counts_last
        late = rewards - self.out_of_time + last
        return np.select(
            [ends == GOES_ON, ends == COMPLETE, ends == OUT_OF_TIME],
            [rewards, completing, late],
            0.0,
        )


def _losses(task: Task, payment: Payment) -> Iterator[float]:
    """Yield what every skill would pay where the task starts, as far as it can go."""
    start = task.initial
    for skill in task.skills:
        try:
            cost = skill.cost.at(start)
        except ValueError:
            continue  # no way leads there, such as to a tool that is attached already
        yield abs(payment.of_step(start, skill.name, cost, goal=False, out_of_time=False))
