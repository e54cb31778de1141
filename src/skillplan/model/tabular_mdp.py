"""A model as arrays, for solvers that sweep over all states.

Rows are the feasible (state, skill) pairs, grouped by state; outcomes are grouped by row. Both
groupings are offsets, as in compressed sparse rows.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan.errors import ModelTooLarge, SearchStopped
from skillplan.model.policy_value import Convergence
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
            Called before every state; once true, the model is given up. None for never.

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
                raise SearchStopped("The model was not enumerated to the end: it was stopped.")
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


# Values that a sweep lowers by less, as a fraction of the largest, have come to rest. A policy
# that is better by more than a billionth would have to take thousands of skills.
_AT_REST = 1e-13
# What needs more of them mixes so slowly that coming to rest would say little.
_MOST_SWEEPS = 5_000


@dataclass(frozen=True)
class _Rows:
    """The rows of a model that may be taken: which states they lead to, and how likely.

    Parameters
    ----------
    owners
        State of each of m rows, shape (m,).
    begins
        Offset of the first row of each state that has one, shape (states with rows,).
    costs
        Shape (m,).
    outcome_rows, successors, probabilities
        Row, next state and probability of each of k outcomes that leave the row's state,
        shape (k,).
    leaves
        Probability that a row leaves its state, above 0, shape (m,).
    """

    owners: NDArray[np.int64]
    begins: NDArray[np.int64]
    costs: NDArray[np.float64]
    outcome_rows: NDArray[np.int64]
    successors: NDArray[np.int64]
    probabilities: NDArray[np.float64]
    leaves: NDArray[np.float64]

    @classmethod
    def of(cls, mdp: TabularMDP, kept: NDArray[np.bool_]) -> _Rows:
        """Return some of a model's rows, without those that never leave their state."""
        owners = np.repeat(np.arange(len(mdp.states)), np.diff(mdp.rows))
        outcome_rows = np.repeat(np.arange(len(mdp.actions)), np.diff(mdp.outcomes))
        outside = mdp.successors != owners[outcome_rows]
        leaves = np.bincount(
            outcome_rows[outside], mdp.probabilities[outside], minlength=len(mdp.actions)
        ).astype(np.float64)
        kept = kept & (leaves > 0)
        number = np.cumsum(kept) - 1
        used = outside & kept[outcome_rows]
        return cls(
            owners[kept],
            np.unique(owners[kept], return_index=True)[1],
            mdp.costs[kept],
            number[outcome_rows[used]],
            mdp.successors[used],
            mdp.probabilities[used],
            leaves[kept],
        )

    def values(self, following: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what every row costs until its state is left, and from there on."""
        expected = np.bincount(
            self.outcome_rows,
            self.probabilities * following[self.successors],
            minlength=len(self.costs),
        )
        rows: NDArray[np.float64] = (self.costs + expected) / self.leaves
        return rows


def least_expected_cost(
    model: SkillModel, limit: int, over: Callable[[], bool] = lambda: False
) -> float | None:
    """Return the least expected cost of a policy that reaches the goal with certainty.

    The step limit does not count: under chance no number of skills suffices for certain.

    Parameters
    ----------
    model
        Queried about every skill that is applicable in a reachable state.
    limit
        The most states to look at, >= 1.
    over
        Polled with every sweep; the values are given up once it is true.

    Returns
    -------
    float or None
        In the task's metric, to a billionth; infinite where no policy is certain to arrive. None
        where the values did not come to rest.

    Raises
    ------
    ModelTooLarge
        If more states than `limit` can be reached.
    """
    mdp = TabularMDP.from_model(model, limit)
    chosen, safe = _certain(mdp)
    if mdp.goal[0]:
        return 0.0
    if chosen[0] < 0:
        return math.inf
    own = np.zeros(len(mdp.actions), dtype=np.bool_)
    own[chosen[chosen >= 0]] = True
    values = np.zeros(len(mdp.states))
    if not _come_to_rest(_Rows.of(mdp, own), values, over):
        return None
    return float(values[0]) if _come_to_rest(_Rows.of(mdp, safe), values, over) else None


def _come_to_rest(rows: _Rows, values: NDArray[np.float64], over: Callable[[], bool]) -> bool:
    """Sweep over the values of all states that have rows until they change no more."""
    states = rows.owners[rows.begins]
    convergence = Convergence(_AT_REST)
    for _ in range(_MOST_SWEEPS):
        if over():
            return False
        lowest = np.minimum.reduceat(rows.values(values), rows.begins)
        change = float(np.abs(lowest - values[states]).max())
        values[states] = lowest
        if convergence.reached(change, float(lowest.max())):
            return True
    return False


def _certain(mdp: TabularMDP) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return a policy that is certain to arrive, and the rows that never endanger that.

    States from which nothing leads to the goal are given up, with all rows that may lead to
    them, until no more are.

    Returns
    -------
    tuple
        Row of every state, -1 at goals and in states given up, shape (n,); and which rows lead
        to no state given up, shape (m,).
    """
    owners = np.repeat(np.arange(len(mdp.states)), np.diff(mdp.rows)).tolist()
    outcome_rows = np.repeat(np.arange(len(mdp.actions)), np.diff(mdp.outcomes)).tolist()
    into: list[list[int]] = [[] for _ in mdp.states]
    for row, following in zip(outcome_rows, mdp.successors.tolist(), strict=True):
        into[following].append(row)
    goals = np.flatnonzero(mdp.goal).tolist()
    safe = [True] * len(mdp.actions)
    lost = [False] * len(mdp.states)
    while True:
        chosen = [-1] * len(mdp.states)
        found = list(goals)
        for state in found:
            for row in into[state]:
                owner = owners[row]
                if safe[row] and chosen[owner] < 0 and not mdp.goal[owner]:
                    chosen[owner] = row
                    found.append(owner)
        arriving = set(found)
        newly = [s for s in range(len(lost)) if not lost[s] and s not in arriving]
        if not newly:
            return np.array(chosen, dtype=np.int64), np.array(safe, dtype=np.bool_)
        for state in newly:
            lost[state] = True
            for row in into[state]:
                safe[row] = False
