"""The reward scheme of a task: what a learner is paid, in exactly one term a step."""

from __future__ import annotations

import math
from dataclasses import dataclass

from skillplan.task.condition import Condition
from skillplan.task.state import State


@dataclass(frozen=True, slots=True)
class Penalty:
    """A fixed reward for taking one of some skills where a condition holds.

    Parameters
    ----------
    name
        What it punishes, such as ``repeated_tool_change``.
    reward
        Paid instead of the cost term.
    skills
        Names of the skills.
    when
        Condition on the state in which the skill is started.
    """

    name: str
    reward: float
    skills: frozenset[str]
    when: Condition


@dataclass(frozen=True, slots=True)
class RewardScheme:
    """Table II of Moller et al., with the figures of the task file.

    Parameters
    ----------
    infeasible
        A skill that is not applicable or not feasible (the paper's collision); ends the episode.
    complete
        The step that reaches the goal.
    per_cost
        Factor on the cost of any other successful step.
    out_of_time
        The step that exhausts the step limit without reaching the goal.
    penalties
        Paid instead of the cost term where they apply.

    Raises
    ------
    ValueError
        If a figure is not finite.
    """

    infeasible: float
    complete: float
    per_cost: float
    out_of_time: float
    penalties: tuple[Penalty, ...] = ()

    def __post_init__(self) -> None:
        figures = (
            self.infeasible,
            self.complete,
            self.per_cost,
            self.out_of_time,
            *(penalty.reward for penalty in self.penalties),
        )
        if not all(math.isfinite(figure) for figure in figures):
            raise ValueError("Rewards must be finite.")

    def of_step(
        self, state: State, skill: str, cost: float, *, goal: bool, out_of_time: bool
    ) -> float:
        """Return the reward of a successful step from `state`.

        Parameters
        ----------
        state
            Where the step started.
        skill
            Its skill's name.
        cost
            Its cost in the task's metric.
        goal
            Whether it reached the goal.
        out_of_time
            Whether it was the last one that the step limit allows.
        """
        if goal:
            return self.complete
        if out_of_time:
            return self.out_of_time
        for penalty in self.penalties:
            if skill in penalty.skills and penalty.when.holds(state):
                return penalty.reward
        return self.per_cost * cost
