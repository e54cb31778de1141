"""A model as arrays, for solvers that sweep over all states; and its least expected cost.

Rows are feasible (state, skill) pairs, grouped by state; outcomes are grouped by row. Both
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
    """All reachable states of a model, and their actions.

    Parameters
    ----------
    states
        The n reachable states; state 0 is the initial one. Goal states have no successors.
    goal
        True if each state is a goal, shape (n,).
    rows
        Rows of state i are ``rows[i]`` to ``rows[i + 1]``, shape (n + 1,).
    actions
        Action number of every row, shape (m,).
    costs, durations_s
        Cost and duration [s] of every row, shape (m,).
    outcomes
        Outcomes of row j are ``outcomes[j]`` to ``outcomes[j + 1]``, shape (m + 1,).
    successors, probabilities
        State index and probability of every outcome, shape (k,).
    rewards
        Reward of every outcome, shape (k,); minus the cost if the task has no reward scheme.
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
        cls, model: SkillModel, limit: int = DEFAULT_LIMIT, stop: Callable[[], bool] | None = None
    ) -> TabularMDP:
        """Return the arrays of all states that feasible skills reach.

        Parameters
        ----------
        model
            The model, queried about every applicable skill in every reachable state.
        limit
            Greatest number of states, >= 1.
        stop
            Returns True to stop; called before every state. None for never.

        Raises
        ------
        ModelTooLarge
            If more than `limit` states are reachable.
        SearchStopped
            If `stop` returned True.
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


# Largest change of converged values in a sweep, as a fraction of the largest value. A policy better
# by more than a billionth would take thousands of skills.
_AT_REST = 1e-13
# Greatest number of sweeps; a chain that needs more mixes so slowly that convergence means little.
_MOST_SWEEPS = 5_000


@dataclass(frozen=True)
class _Rows:
    """The allowed rows of a model, with next states and probabilities.

    Parameters
    ----------
    owners
        State of each of m rows, shape (m,).
    begins
        Offset of the first row of each state that has one, shape (states with rows,).
    costs
        Cost of each row, shape (m,).
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
        """Return some rows of a model, without rows that never leave their state."""
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
        """Return the cost of every row until its state is left, and all costs after that."""
        expected = np.bincount(
            self.outcome_rows,
            self.probabilities * following[self.successors],
            minlength=len(self.costs),
        )
        rows: NDArray[np.float64] = (self.costs + expected) / self.leaves
        return rows


def compute_least_expected_cost(
    model: SkillModel, limit: int, over: Callable[[], bool] = lambda: False
) -> float | None:
    """Return the least expected cost of a policy that reaches the goal with certainty.

    The step limit is ignored: under chance no number of skills is certainly enough.

    Parameters
    ----------
    model
        The model, queried about every applicable skill in every reachable state.
    limit
        Greatest number of states, >= 1.
    over
        Returns True to stop; called before every sweep.

    Returns
    -------
    float or None
        Cost in the task's metric, to a billionth; inf if no policy is certain to reach the goal;
        None if the values did not converge.

    Raises
    ------
    ModelTooLarge
        If more than `limit` states are reachable.
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
    """Sweep over the values of all states that have rows until they converge."""
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
    """Return a policy that certainly reaches the goal, and the rows that never endanger that.

    States that cannot reach the goal are removed with all rows that may lead to them, until none
    are left.

    Returns
    -------
    tuple
        Row of every state, -1 at goals and removed states, shape (n,); and whether each row leads
        to no removed state, shape (m,).
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
        policy = list(goals)
        for state in policy:
            for row in into[state]:
                owner = owners[row]
                if safe[row] and chosen[owner] < 0 and not mdp.goal[owner]:
                    chosen[owner] = row
                    policy.append(owner)
        arriving = set(policy)
        newly = [s for s in range(len(lost)) if not lost[s] and s not in arriving]
        if not newly:
            return np.array(chosen, dtype=np.int64), np.array(safe, dtype=np.bool_)
        for state in newly:
            lost[state] = True
            for row in into[state]:
                safe[row] = False
