"""The tables of tabular control, which grow with the states and actions that episodes meet."""

from __future__ import annotations

import math
import random
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from skillplan.env.observation import MaskKind, list_allowed_actions
from skillplan.model.skill_model import SkillModel
from skillplan.solvers.learning.episode_kernels import COMPLETE, FAILURE, GOES_ON, UNTRIED, Tables
from skillplan.task.state import State

_FIRST_SIZE = 256
_LEAST_WORTH = 1e-6
_Array = TypeVar("_Array", bound=NDArray[np.generic])


class SampledTable:
    """The states and actions that episodes have met, with values.

    A state is added with the actions that the mask allows. The model is queried about an action
    when it is taken for the first time; an infeasible action leads to state 0, in which the episode
    has failed.

    Parameters
    ----------
    model
        The model.
    mask
        Kind of the action mask: see `list_allowed_actions`.
    objective
        ``reward`` for the task's reward scheme. ``cost``, or without a scheme: minus the costs; an
        end has a value of plus or minus the largest cost so far, rounded up to a power of two,
        times the step limit.
    exploring
        True if episodes may begin in every state met and in all starts of the task; else in the
        task's start alone.
    optimistic
        True if an action is worth as much as completing the task until it is taken, and ties are
        broken at random; else actions begin with 0 and the first in the order of the task wins.
    seed
        Seed of random ties.

    Attributes
    ----------
    states
        The states, in order; None for state 0.
    actions
        Action of every row.
    tables
        The arrays; replaced when they grow.
    """

    def __init__(
        self,
        model: SkillModel,
        mask: MaskKind,
        objective: str,
        *,
        exploring: bool,
        optimistic: bool,
        seed: int,
    ) -> None:
        self._model, self._mask = model, mask
        self._exploring, self._optimistic = exploring, optimistic
        self._ties = random.Random(seed)
        self._reward = model.task.reward if objective == "reward" else None
        # Value of completing the task. It is above 0 before a cost is known, because a cycle that
        # costs nothing must be worth less than the goal.
        self._worth = _LEAST_WORTH
        if self._reward is not None:
            self._worth = float(getattr(self._reward, "complete", 0.0))
        self._outcomes = 0
        self.states: list[State | None] = [None]
        self.actions: list[int] = []
        self._numbers: dict[State, int] = {}

        def whole() -> NDArray[np.int64]:
            return np.zeros(_FIRST_SIZE, dtype=np.int64)

        def real() -> NDArray[np.float64]:
            return np.zeros(_FIRST_SIZE)

        self.tables = Tables(
            rows=whole(),
            ends=whole(),
            final=real(),
            best=whole(),
            starts=whole(),
            counts=np.array([1, 0]),
            owners=whole(),
            q=real(),
            seen=np.full(_FIRST_SIZE, -1),
            outcomes=np.full(_FIRST_SIZE, UNTRIED),
            last_outcomes=whole(),
            costs=real(),
            successors=whole(),
            probabilities=real(),
            rewards=real(),
        )
        self.tables.ends[0] = FAILURE
        for state in dict.fromkeys((model.initial, *(model.task.starts if exploring else ()))):
            self.number(state)

    def __len__(self) -> int:
        """Return the number of states met."""
        return len(self.states) - 1

    @property
    def tried(self) -> int:
        """Number of rows that were taken."""
        return int(np.count_nonzero(self.tables.outcomes[: len(self.actions)] != UNTRIED))

    def number(self, state: State) -> int:
        """Return the number of a state; an unknown one is added with its rows."""
        number = self._numbers.get(state)
        if number is not None:
            return number
        number, first = len(self.states), len(self.actions)
        self._numbers[state] = number
        self.states.append(state)
        if self._model.is_goal(state):
            end, allowed = COMPLETE, []
        else:
            allowed = list(list_allowed_actions(self._model, state, self._mask, self._is_feasible))
            end = GOES_ON if allowed else FAILURE
            if self._optimistic:
                # Of equal values the first is taken.
                self._ties.shuffle(allowed)
        self.actions += allowed
        self._grow("rows", number + 2)
        self._grow("ends final best starts", number + 1)
        self._grow("owners q seen outcomes last_outcomes costs", len(self.actions))
        tables = self.tables
        tables.rows[number + 1] = len(self.actions)
        tables.ends[number] = end
        tables.best[number] = first
        tables.owners[first : len(self.actions)] = number
        tables.q[first : len(self.actions)] = self._worth if self._optimistic else 0.0
        tables.counts[0] = number + 1
        if end == GOES_ON and (self._exploring or number == 1):
            tables.starts[tables.counts[1]] = number
            tables.counts[1] += 1
        tables.final[number] = self._value_of_end(end)
        return number

    def take(self, row: int) -> None:
        """Query the model about a row that is taken for the first time.

        Raises
        ------
        BackEndError
            If a back end fails.
        SearchStopped
            If the solver is overdue.
        """
        model, skill = self._model, self._model.task.skills[self.actions[row]]
        state = self.states[self.tables.owners[row]]
        assert state is not None
        if not model.verdict(state, skill).is_feasible:
            reward = 0.0 if self._reward is None else self._reward.infeasible
            self._add_outcome(0, 1.0, reward)
            self._set_outcomes(row, 1)
            return
        step = model.transition(state, skill)
        for probability, following in step.outcomes:
            number = self.number(following)
            reward = -step.cost
            if self._reward is not None:
                goal = self.tables.ends[number] == COMPLETE
                reward = self._reward.of_step(
                    state, skill.name, step.cost, goal=bool(goal), out_of_time=False
                )
            self._add_outcome(number, probability, reward)
        self.tables.costs[row] = step.cost
        self._set_outcomes(row, len(step.outcomes))
        if self._reward is None:
            self._raise_worth(step.cost)

    def greedy_rows(self) -> dict[int, int]:
        """Return the row of the largest value among feasible rows, by state; of equals, the first.

        States without a row that was taken and found feasible are left out.
        """
        tables, chosen = self.tables, {}
        for number in range(1, len(self.states)):
            first, end = int(tables.rows[number]), int(tables.rows[number + 1])
            outcomes = tables.outcomes[first:end]
            feasible = (outcomes != UNTRIED) & (tables.successors[outcomes] != 0)
            if feasible.any():
                values = np.where(feasible, tables.q[first:end], -np.inf)
                chosen[number] = first + int(np.argmax(values))
        return chosen

    def _is_feasible(self, action: int) -> bool:
        state = self.states[-1]
        assert state is not None
        return self._model.verdict(state, self._model.task.skills[action]).is_feasible

    def _set_outcomes(self, row: int, count: int) -> None:
        self.tables.outcomes[row] = self._outcomes - count
        self.tables.last_outcomes[row] = self._outcomes - 1

    def _add_outcome(self, successor: int, probability: float, reward: float) -> None:
        number = self._outcomes
        self._outcomes += 1
        self._grow("successors probabilities rewards", self._outcomes)
        self.tables.successors[number] = successor
        self.tables.probabilities[number] = probability
        self.tables.rewards[number] = reward

    def _raise_worth(self, cost: float) -> None:
        """Make ends worth more than the most expensive plan by the costs so far."""
        if cost * self._model.step_limit <= self._worth:
            return
        worth = 2.0 ** math.ceil(math.log2(cost)) * self._model.step_limit
        count, tables = len(self.states), self.tables
        if self._optimistic:
            tables.q[: len(self.actions)] += worth - self._worth
        self._worth = worth
        tables.final[:count] = [self._value_of_end(end) for end in tables.ends[:count].tolist()]

    def _value_of_end(self, end: int) -> float:
        if self._reward is not None:
            # A robot that can do nothing can only fail; a skill that failed had its reward.
            return self._reward.infeasible if end == FAILURE else 0.0
        return {COMPLETE: self._worth, FAILURE: -self._worth}.get(end, 0.0)

    def _grow(self, names: str, size: int) -> None:
        """Double arrays until they have a size."""
        for name in names.split():
            array = getattr(self.tables, name)
            while len(array) < size:
                empty = UNTRIED if name in ("seen", "outcomes") else 0
                array = np.concatenate((array, np.full_like(array, empty)))
                self.tables = self.tables._replace(**{name: array})
