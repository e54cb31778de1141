"""What is still to pay in every state between jobs, where a task is one of putting jobs in order.

Held and Karp, "A dynamic programming approach to sequencing problems" (1962), with precedence: of
every set of jobs that may be done, and the last of them, the least cost of the others.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from skillplan.errors import NotASequencing
from skillplan.model.skill_model import SkillModel
from skillplan.solvers.chance.job_sets import CertainModel, JobSets, Sets, bit_of, open_in
from skillplan.solvers.stop import Stop
from skillplan.task.state import State
from skillplan.task.task import Task

Costs = NDArray[np.float64]

# Sums in another order may differ by so much, as a fraction.
_ROUNDING = 1e-12


class OrdersAhead:
    """The least cost to the goal, wherever the task can be between jobs or within one.

    Parameters
    ----------
    model
        Of the certain task.
    most_sets
        Of more sets of jobs nothing is worked out.
    stop
        When to give up.

    Attributes
    ----------
    sets
        How many sets of jobs may be done.
    questions
        Bits of the facts that verdicts rested on.

    Raises
    ------
    NotASequencing
        If the task is not one of putting at most 63 jobs in order, or there are more sets, or it
        was given up.
    """

    def __init__(self, model: CertainModel, most_sets: int, stop: Stop) -> None:
        self._states = states = JobSets(model, most_sets, stop)
        self._from: dict[int, list[float]] = {}
        self._to_go = costs_to_go(states.layers, states.needs, states.problem.costs, stop)
        if not self._to_go:
            raise states.no("there was no time to work out what is ahead")
        self.sets = states.sets
        self.questions = model.questions

    def __call__(self, state: State) -> float:
        """Return a lower bound on the cost to the goal, exact between jobs; 0 if none is known."""
        states = self._states
        at = states.of(state)
        if at is None:
            return 0.0
        done, begun, position = at
        situation = state.bits & states.situation
        found = math.inf
        if begun >= 0:
            rest = states.jobs[begun].chain[position:]
            found = states.connections.tail(rest, situation) + self._after(done, begun)
        else:
            costs = self._costs_from(situation)
            for index, needs in enumerate(states.needs):
                if not done >> index & 1 and not needs & ~done and costs[index] < found:
                    found = min(found, costs[index] + self._after(done, index))
        return found * (1.0 - _ROUNDING) if math.isfinite(found) else 0.0

    def _costs_from(self, situation: int) -> list[float]:
        """Return what coming from a situation to each job, and doing it, costs."""
        costs = self._from.get(situation)
        if costs is None:
            row = self._states.connections.costs_from(situation)
            costs = self._from[situation] = row[self._states.chosen].tolist()
        return costs

    def _after(self, done: int, job: int) -> float:
        """Return what is to pay when a job has been done after others."""
        done |= 1 << job
        layer = self._states.layers[done.bit_count()]
        place = int(np.searchsorted(layer, np.uint64(done)))
        if place == len(layer) or int(layer[place]) != done:
            return 0.0
        return float(self._to_go[done.bit_count()][place, job])


def orders_ahead(
    model: SkillModel, certain: Task, most_sets: int, stop: Stop
) -> OrdersAhead | None:
    """Return what is ahead in a task without failures; None where that is not to be had."""
    if not most_sets:
        return None
    try:
        return OrdersAhead(CertainModel(model, certain), most_sets, stop)
    except NotASequencing:
        return None


def costs_to_go(
    layers: Sequence[Sets], needs: Sequence[int], costs: Costs, stop: Stop
) -> list[Costs]:
    """Return the least cost of all jobs that are left, by set and by the last job of it.

    Parameters
    ----------
    layers
        The sets by size.
    needs
        By job the set of those that must be done before it.
    costs
        Of coming from job i to job j and doing it, shape (n, n).
    stop
        When to give up; then nothing is returned.

    Returns
    -------
    list of ndarray
        For each layer of s sets, shape (s, n); rows of jobs that are not in a set mean nothing.
    """
    count = len(needs)
    found: list[Costs] = [np.zeros((1, count))]
    for size in range(count - 1, 0, -1):
        here, above = layers[size], layers[size + 1]
        least = np.full((count, len(here)), np.inf)
        for job, set_ in enumerate(needs):
            open_here = np.flatnonzero(open_in(here, job, set_))
            place = np.searchsorted(above, here[open_here] | bit_of(job))
            onward = found[-1][place, job]
            for last in range(count):
                if costs[last, job] < np.inf:
                    row = least[last]
                    row[open_here] = np.minimum(row[open_here], onward + costs[last, job])
        found.append(np.ascontiguousarray(least.T))
        if stop():
            return []
    found.append(np.full((1, count), np.inf))
    return found[::-1] if count else [np.zeros((1, 0))]
