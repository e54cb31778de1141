"""Rewards of a task: exactly one term per step."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

from skillplan.task.state import Condition, State


class Reward(Protocol):
    """The rewards of a task."""

    @property
    def infeasible(self) -> float:
        """Reward of a skill that is not applicable or not feasible; it ends the episode."""

    def of_step(
        self, state: State, skill: str, cost: float, *, goal: bool, out_of_time: bool
    ) -> float:
        """Return the reward of a successful step from `state`.

        Parameters
        ----------
        goal
            True if the step reached the goal.
        out_of_time
            True if it was the last step that the step limit allows.
        """


@dataclass(frozen=True)
class DistanceReward:
    """Steps cost less near the goal: Veeramani and Muthuswamy, Eqs 6 and 7.

    Parameters
    ----------
    distances
        Distances to the goal, >= 0, by the bit of the fact for the robot's place.
    complete
        Bonus of the step that reaches the goal; 1 in the paper.
    infeasible
        Reward of a skill that cannot be executed.
    """

    distances: Mapping[int, float] = field(hash=False)
    complete: float
    infeasible: float
    _mask: int = field(init=False, repr=False, compare=False)
    _numbers: Mapping[int, float] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not all(math.isfinite(value) for value in (self.complete, self.infeasible)):
            raise ValueError("Rewards must be finite.")
        if not all(math.isfinite(d) and d >= 0 for d in self.distances.values()):
            raise ValueError("Distances must be finite and >= 0.")
        object.__setattr__(self, "_mask", sum(self.distances))
        # Keyed by the number of the bit: powers of two hash badly, see `State.__hash__`.
        numbers = {bit.bit_length(): distance for bit, distance in self.distances.items()}
        object.__setattr__(self, "_numbers", numbers)

    def of_step(
        self, state: State, skill: str, cost: float, *, goal: bool, out_of_time: bool
    ) -> float:
        """Return the reward of a step."""
        return (self.complete if goal else 0.0) - self._numbers[
            (state.bits & self._mask).bit_length()
        ]


@dataclass(frozen=True, slots=True)
class Penalty:
    """A fixed reward for some skills under a condition.

    Parameters
    ----------
    name
        Name, such as ``repeated_tool_change``.
    reward
        Given instead of the cost term.
    when
        Condition on the state before the step.
    """

    name: str
    reward: float
    skills: frozenset[str]
    when: Condition


@dataclass(frozen=True, slots=True)
class RewardScheme:
    """Table II of Moller et al., with the figures of a task file.

    Parameters
    ----------
    infeasible
        Reward of a skill that is not applicable or not feasible (the paper's collision); it ends
        the episode.
    complete
        Reward of the step that reaches the goal.
    per_cost
        Factor on the cost of other successful steps.
    out_of_time
        Reward of the step that exhausts the step limit without reaching the goal.
    penalties
        Rewards instead of the cost term.
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
        """Return the reward of a step."""
        if goal:
            return self.complete
        if out_of_time:
            return self.out_of_time
        for penalty in self.penalties:
            if skill in penalty.skills and penalty.when.holds(state):
                return penalty.reward
        return self.per_cost * cost
