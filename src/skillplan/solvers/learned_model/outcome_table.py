"""Outcomes of actions by observation, and the costs to go that follow from them.

The table is the model that remains if no action schemas fit: it predicts nothing about
observations that it has not met. Costs to go are optimistic and are updated along every episode
(real-time dynamic programming: Barto, Bradtke and Singh, "Learning to act using real-time dynamic
programming", 1995); untried actions cost nothing, so that they are tried.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skillplan.solvers.learning.episode_training import Arrays, read_array
from skillplan.solvers.learning.observation_counts import ObservationCounts

GOAL, FAILURE = -1, -2
"""Successors that end an episode."""

# Cost to go after a failed action, in units of the greatest cost of a step times the step limit.
_FAILURE_FACTOR = 10.0
# Additional cost of every step, in units of the greatest: cycles without cost, such as tool
# changes at one place, must not look as good as progress. The second value only breaks ties.
_EXPLORING_COST, _TIE_COST = 0.02, 1e-7
# Most sweeps of value iteration; it stops when values change by less, relative to a failure.
_MOST_SWEEPS = 1_000
_TOLERANCE = 1e-12


class _Solution(NamedTuple):
    """Costs to go of observations and actions, shapes (m, 2) and (m,)."""

    pairs: NDArray[np.int64]
    costs: NDArray[np.float64]


class OutcomeTable:
    """The table of one run.

    Parameters
    ----------
    counts
        Observations of all runs.
    run
        Index of the run.
    step_limit
        Most skills of an episode.
    """

    def __init__(self, counts: ObservationCounts, run: int, step_limit: int) -> None:
        self._counts, self._run, self._limit = counts, run, step_limit
        # By observation and action: number and summed cost of the steps to every successor.
        self._outcomes: dict[tuple[int, int], dict[int, list[float]]] = {}
        self._values = np.zeros((64, counts.masks.shape[2]))
        self._most_cost = 0.0

    def add(self, index: int, action: int, successor: int, cost: float) -> None:
        """Add a step.

        Parameters
        ----------
        index, action
            Index of the observation, and the action.
        successor
            Index of the next observation, `GOAL` or `FAILURE`.
        cost
            Cost of the step.
        """
        outcome = self._outcomes.setdefault((index, action), {}).setdefault(successor, [0, 0.0])
        outcome[0] += 1
        outcome[1] += cost
        self._most_cost = max(self._most_cost, cost)

    def update(self, index: int, action: int) -> None:
        """Set an optimistic cost to go to the mean over the outcomes seen."""
        while index >= len(self._values):
            self._values = np.concatenate([self._values, np.zeros_like(self._values)])
        outcomes = self._outcomes[index, action]
        total = sum(
            cost + number * self._least(next_) for next_, (number, cost) in outcomes.items()
        )
        self._values[index, action] = total / sum(number for number, _ in outcomes.values())

    def choose(self, index: int, generator: np.random.Generator) -> int:
        """Return the action of least optimistic cost to go; of equals a rarely taken one."""
        allowed = np.flatnonzero(self._counts.masks[self._run, index])
        if index >= len(self._values):
            return int(generator.choice(allowed))
        values = self._values[index, allowed]
        best = allowed[values <= values.min() + 1e-12]
        visits = self._counts.visits[self._run, index, best]
        return int(generator.choice(best[visits == visits.min()]))

    def refresh(self) -> None:
        """Set all optimistic costs to go to the fixed point of `update`.

        Dead ends get the cost of a failure, which updates along episodes approach slowly.
        """
        size = self._counts.known(self._run)
        visits, masks = self._counts.visits[self._run, :size], self._counts.masks[self._run, :size]
        solution = self._solve(_EXPLORING_COST, (masks & (visits == 0)).any(axis=1))
        while size > len(self._values):
            self._values = np.concatenate([self._values, np.zeros_like(self._values)])
        self._values[solution.pairs[:, 0], solution.pairs[:, 1]] = solution.costs

    def policy(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the best action by the outcomes seen, untried actions excluded.

        Returns
        -------
        indices, actions
            Observations from which the goal can be reached, and the action there, shape (n,).
        """
        size = self._counts.known(self._run)
        pairs, costs = self._solve(_TIE_COST, np.zeros(size, dtype=np.bool_))
        order = np.lexsort((pairs[:, 1], costs, pairs[:, 0]))
        indices, first = np.unique(pairs[order, 0], return_index=True)
        best = order[first]
        reached = costs[best] < self._failure_cost()
        return indices[reached], pairs[best, 1][reached]

    def _solve(self, step_cost: float, open_: NDArray[np.bool_]) -> _Solution:
        """Return the costs to go of all actions taken, by value iteration.

        Parameters
        ----------
        step_cost
            Additional cost of every step, in units of the greatest cost.
        open_
            Observations at which an untried action ends the search at no cost, shape (n,).
        """
        size, ceiling = len(open_), self._failure_cost()
        flat = self._flat()
        pairs, rows = np.unique(flat[:, :2].astype(np.int64), axis=0, return_inverse=True)
        rows, numbers, successors = rows.reshape(-1), flat[:, 3], flat[:, 2].astype(np.int64)
        totals = np.bincount(rows, numbers, minlength=len(pairs))
        costs = np.bincount(rows, flat[:, 4], minlength=len(pairs)) / totals
        costs += step_cost * self._most_cost
        shares = numbers / totals[rows]
        # From above: from below, cycles without cost would hold values down.
        values = np.full(size + 2, ceiling)
        values[GOAL] = 0.0
        ahead = np.zeros(len(pairs))
        for _ in range(_MOST_SWEEPS):
            ahead = costs + np.bincount(rows, shares * values[successors], minlength=len(pairs))
            updated = np.full(size + 2, ceiling)
            np.minimum.at(updated, pairs[:, 0], ahead)
            updated[:size][open_] = 0.0
            updated[GOAL], updated[FAILURE] = 0.0, ceiling
            if np.abs(updated - values).max() <= _TOLERANCE * ceiling:
                break
            values = updated
        return _Solution(pairs, ahead)

    def arrays(self, name: str) -> Arrays:
        """Return copies of all arrays for `read`."""
        return {
            f"{name}.outcomes": self._flat(),
            f"{name}.values": self._values.copy(),
            f"{name}.most_cost": np.array(self._most_cost),
        }

    def read(self, name: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Restore what `arrays` returned.

        Raises
        ------
        ValueError
            If it has another shape.
        """
        rows = len(arrays.get(f"{name}.outcomes", ()))
        self._outcomes = {}
        for line in read_array(arrays, f"{name}.outcomes", (rows, 5)).tolist():
            index, action, successor = (int(number) for number in line[:3])
            self._outcomes.setdefault((index, action), {})[successor] = line[3:]
        size = len(arrays.get(f"{name}.values", ()))
        shape = (size, self._values.shape[1])
        self._values = read_array(arrays, f"{name}.values", shape).copy()
        self._most_cost = float(read_array(arrays, f"{name}.most_cost", ()))

    def _least(self, successor: int) -> float:
        """Return the optimistic cost to go of a successor."""
        if successor == GOAL:
            return 0.0
        if successor == FAILURE:
            return self._failure_cost()
        if successor >= len(self._values):
            return 0.0
        mask = self._counts.masks[self._run, successor]
        return float(self._values[successor, mask].min())

    def _failure_cost(self) -> float:
        return _FAILURE_FACTOR * self._limit * (self._most_cost or 1.0)

    def _flat(self) -> NDArray[np.float64]:
        """Return a row for every outcome: index, action, successor, number and summed cost."""
        return np.array(
            [
                (index, action, successor, *outcome)
                for (index, action), outcomes in self._outcomes.items()
                for successor, outcome in outcomes.items()
            ]
        ).reshape(-1, 5)
