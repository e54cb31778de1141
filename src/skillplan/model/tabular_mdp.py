"""A model as arrays, for solvers that sweep over all states.

Rows are the feasible (state, skill) pairs, grouped by state; outcomes are grouped by row. Both
groupings are offsets, as in compressed sparse rows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan.errors import ModelTooLarge, SearchStopped
from skillplan.model.skill_model import SkillModel
from skillplan.task.state import State

DEFAULT_LIMIT = 200_000


@dataclass(frozen=True)
class TabularMDP:
    """All reachable states of a model and what may be done in them.

    Parameters
    ----------
    states
        The n states that can be reached from the initial one, which is state 0, or from one of
        the task's other starts. Nothing follows a goal state.
    goal
        Whether the task is done, shape (n,).
    rows
        Rows of state i are ``rows[i]`` to ``rows[i + 1]``, shape (n + 1,).
    actions
        Action number of every row, shape (m,).
    costs, durations_s
        Cost, and time [s], of every row, shape (m,).
    outcomes
        Outcomes of row j are ``outcomes[j]`` to ``outcomes[j + 1]``, shape (m + 1,).
    successors, probabilities
        State index and probability of every outcome, shape (k,).
    rewards
        The reward of every outcome, shape (k,): by the task's reward scheme, or
        minus the cost where it has none.

    Raises
    ------
    ValueError
        If the offsets do not fit the arrays or a row's probabilities do not sum to 1.
    """

    states: tuple[State, ...]
    goal: NDArray[np.bool_]
    rows: NDArray[np.int64]
    actions: NDArray[np.int64]
    costs: NDArray[np.float64]
    durations_s: NDArray[np.float64]
    outcomes: NDArray[np.int64]
    successors: NDArray[np.int64]
    probabilities: NDArray[np.float64]
    rewards: NDArray[np.float64]

    def __post_init__(self) -> None:
        if len(self.rows) != len(self.states) + 1 or self.rows[-1] != len(self.actions):
            raise ValueError("TabularMDP rows do not fit the states and actions.")
        if len(self.outcomes) != len(self.actions) + 1:
            raise ValueError("TabularMDP outcomes do not fit the actions.")
        if self.outcomes[-1] != len(self.successors):
            raise ValueError("TabularMDP outcomes do not fit the successors.")
        if len(self.rewards) != len(self.successors):
            raise ValueError("TabularMDP rewards do not fit the successors.")
        if len(self.actions):
            sums = np.add.reduceat(self.probabilities, self.outcomes[:-1])
            if not np.allclose(sums, 1.0, atol=1e-9):
                raise ValueError("TabularMDP probabilities must sum to 1 in every row.")

    @classmethod
    def from_model(
        cls,
        model: SkillModel,
        limit: int = DEFAULT_LIMIT,
        stop: Callable[[], bool] | None = None,
    ) -> TabularMDP:
        """Return the arrays of everything that can be reached by feasible skills.

        Parameters
        ----------
        model
            Queried about every skill that is applicable in a reachable state.
        limit
            The most states to hold, >= 1.
        stop
            Queried before every state whether to give up; None for never.

        Raises
        ------
        ModelTooLarge
            If more states than `limit` can be reached.
        SearchStopped
            If `stop` said so.
        """
        states = list(dict.fromkeys((model.initial, *model.task.starts)))
        index = {state: i for i, state in enumerate(states)}
        reward = model.task.reward
        goal, rows, actions, costs, durations_s = [], [0], [], [], []
        outcomes, successors, probabilities, rewards = [0], [], [], []
        too_large = ModelTooLarge(
            f"{model.task.name!r} has more than {limit:,} reachable states. "
            "Use a solver that does not enumerate them, such as exact."
        )
        if len(states) > limit:
            raise too_large
        for state in states:
            if stop is not None and stop():
                raise SearchStopped("The model was not enumerated to the end: told to stop.")
            goal.append(model.is_goal(state))
            for step in () if goal[-1] else model.transitions(state):
                actions.append(model.task.action(step.skill))
                costs.append(step.cost)
                durations_s.append(step.duration_s)
                for probability, following in step.outcomes:
                    if following not in index:
                        if len(states) == limit:
                            raise too_large
                        index[following] = len(states)
                        states.append(following)
                    successors.append(index[following])
                    probabilities.append(probability)
                    rewards.append(
                        -step.cost
                        if reward is None
                        else reward.of_step(
                            state,
                            step.skill.name,
                            step.cost,
                            goal=model.is_goal(following),
                            out_of_time=False,
                        )
                    )
                outcomes.append(len(successors))
            rows.append(len(actions))
        return cls(
            tuple(states),
            np.array(goal, dtype=np.bool_),
            np.array(rows, dtype=np.int64),
            np.array(actions, dtype=np.int64),
            np.array(costs, dtype=np.float64),
            np.array(durations_s, dtype=np.float64),
            np.array(outcomes, dtype=np.int64),
            np.array(successors, dtype=np.int64),
            np.array(probabilities, dtype=np.float64),
            np.array(rewards, dtype=np.float64),
        )
