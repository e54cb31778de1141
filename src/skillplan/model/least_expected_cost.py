"""The least expected cost of reaching the goal with certainty, worked out for the referee.

A stochastic shortest path problem (Bertsekas and Tsitsiklis, "An analysis of stochastic shortest
path problems", 1991), solved by code that no solver shares. What makes the figure a proof:

- Values V >= 0 with V = 0 at the goal that are nowhere above ``cost + E[V(next)]`` bound from
  below what every policy costs that reaches the goal with certainty, circles that cost nothing
  included: V is bounded and the policy ends, so that what is left of V tends to 0.
- Sweeps from the values of such a policy come down to values that some such policy has.

Both meet where sweeping changes nothing any more.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan.model.policy_value import Convergence
from skillplan.model.skill_model import SkillModel
from skillplan.model.tabular_mdp import TabularMDP

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
