"""Sets of finished jobs of an ordering task, and the least costs to go without failures.

There are far fewer sets than states, which also contain the held part, the arm's place and its
tool.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from skillplan.errors import NotASequencing
from skillplan.model.component_jobs import ComponentJobs, DoneSets
from skillplan.model.job_connections import JobConnections
from skillplan.model.sequencing import SequencingProblem
from skillplan.model.skill_model import SkillModel
from skillplan.solvers.stop import Stop
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict

Sets = NDArray[np.uint64]

# Sets are integers of 64 bits.
_MOST_JOBS = 63
_COST_BYTES = 8


class CertainModel(SkillModel):
    """A model of the same task with certain skills; verdicts come from the given model."""

    def __init__(self, model: SkillModel, certain: Task) -> None:
        super().__init__(model.feasibility)
        self.task = certain
        self.questions = 0
        self._model = model
        self._with_failures = {skill.name: skill for skill in model.task.skills}

    def verdict(self, state: State, skill: Skill, likely: object = None) -> Verdict:
        """Return the verdict on a skill with failures in `state`."""
        return self.verdicts([(skill, state)])[0]

    def verdicts(self, queries: Sequence[tuple[Skill, State]], /) -> list[Verdict]:
        """Return verdicts on skills in states, in order."""
        own = [(self._with_failures[skill.name], state) for skill, state in queries]
        verdicts = self._model.verdicts(own)
        for verdict in verdicts:
            if verdict.present is None or verdict.absent is None:
                self.questions = self.task.facts.all_bits
            else:
                self.questions |= verdict.present.bits | verdict.absent.bits
        return verdicts


class JobSets:
    """The jobs of a task, the feasible sets of finished jobs, and conversion of states.

    Attributes
    ----------
    jobs, chosen
        The n jobs, and their indices among all jobs of the task.
    situation, initial
        Bits of the facts outside jobs, and of the initial state.

    Raises
    ------
    NotASequencing
        If the task does not order at most 63 jobs, has too many sets, or was given up.
    """

    def __init__(self, model: CertainModel, most_sets: int, stop: Stop) -> None:
        self.problem = SequencingProblem.from_model(model)
        self._structure = structure = ComponentJobs(model.task)
        self.situation = structure.situation
        self.initial = model.task.initial.bits
        place = {job.component: index for index, job in enumerate(structure.jobs)}
        self.chosen = [place[name] for name in self.problem.jobs]
        self.jobs = [structure.jobs[index] for index in self.chosen]
        self.connections = JobConnections(model, structure, DoneSets(structure))
        self.connections.matrix()
        count = len(self.jobs)
        if count < len(structure.jobs):
            raise structure.no("a component is not in the goal, and its job might be of use")
        if count > _MOST_JOBS:
            raise structure.no(f"{count} jobs are more than {_MOST_JOBS}")
        self.needs = [0] * count
        for before, after in self.problem.precedence:
            self.needs[after] |= 1 << before
        self.layers = list_feasible_sets(self.needs, _limit_sets(most_sets, count, stop), stop)
        if not self.layers:
            raise structure.no(f"more than {most_sets:,} sets of jobs may be done")
        self.sets = sum(len(layer) for layer in self.layers)

    def no(self, reason: str) -> NotASequencing:
        """Return an error with the reason for missing values."""
        return self._structure.no(reason)

    def of(self, state: State) -> tuple[int, int, int] | None:
        """Return the finished set, the started job or -1, and its number of finished skills.

        None if several jobs are started.
        """
        done, started, position = 0, -1, 0
        for index, job in enumerate(self.jobs):
            own = state.bits & job.own
            if own == job.stages[-1]:
                done |= 1 << index
            elif own != job.stages[0]:
                if started >= 0 or own not in job.stages:
                    return None
                started, position = index, job.stages.index(own)
        return done, started, position


def _limit_sets(most_sets: int, count: int, stop: Stop) -> int:
    """Return the number of sets whose table fits memory, at most `most_sets`."""
    left = stop.memory_left_bytes()
    if left is None or not count:
        return most_sets
    # Half of it, because a table is filled from another one.
    return min(most_sets, left // (2 * _COST_BYTES * (count + 1)))


def list_feasible_sets(needs: Sequence[int], most: int, stop: Stop) -> list[Sets]:
    """Return the sets that contain all predecessors of their jobs, by size, in ascending order.

    Parameters
    ----------
    most
        Greatest number of sets; above it the result is None.
    stop
        Returns True to give up; then the result is None.
    """
    layers: list[Sets] = [np.zeros(1, dtype=np.uint64)]
    total = 1
    for _ in needs:
        here = layers[-1]
        following = [
            here[find_open(here, job, set_)] | make_bit(job) for job, set_ in enumerate(needs)
        ]
        layers.append(np.unique(np.concatenate(following)))
        total += len(layers[-1])
        if total > most or stop():
            return []
    return layers


def find_open(sets: Sets, job: int, needs: int) -> NDArray[np.bool_]:
    """Return the sets in which a job is open and its predecessors are done."""
    needed = np.uint64(needs)
    is_open: NDArray[np.bool_] = ((sets & make_bit(job)) == 0) & ((sets & needed) == needed)
    return is_open


def make_bit(job: int) -> np.uint64:
    """Return the set of one job."""
    return np.uint64(1 << job)


Costs = NDArray[np.float64]

# Relative difference of sums in another order.
_ROUNDING = 1e-12


class OrdersAhead:
    """The least cost to the goal from states between jobs or within one.

    Raises
    ------
    NotASequencing
        If the task does not order at most 63 jobs, has too many sets, or was given up.
    """

    def __init__(self, model: CertainModel, most_sets: int, stop: Stop) -> None:
        self._states = states = JobSets(model, most_sets, stop)
        self._from: dict[int, list[float]] = {}
        self._to_go = compute_costs_to_go(states.layers, states.needs, states.problem.costs, stop)
        if not self._to_go:
            raise states.no("there was no time to work out what is ahead")
        self.sets = states.sets
        self.questions = model.questions

    def __call__(self, state: State) -> float:
        """Return a lower bound on the cost to the goal, exact between jobs; 0 if unknown."""
        states = self._states
        at = states.of(state)
        if at is None:
            return 0.0
        done, started, position = at
        situation = state.bits & states.situation
        known = math.inf
        if started >= 0:
            rest = states.jobs[started].chain[position:]
            known = states.connections.tail(rest, situation) + self._after(done, started)
        else:
            costs = self._costs_from(situation)
            for index, needs in enumerate(states.needs):
                if not done >> index & 1 and not needs & ~done and costs[index] < known:
                    known = min(known, costs[index] + self._after(done, index))
        return known * (1.0 - _ROUNDING) if math.isfinite(known) else 0.0

    def _costs_from(self, situation: int) -> list[float]:
        """Return the costs from a situation to each job, including the job."""
        costs = self._from.get(situation)
        if costs is None:
            row = self._states.connections.costs_from(situation)
            costs = self._from[situation] = row[self._states.chosen].tolist()
        return costs

    def _after(self, done: int, job: int) -> float:
        """Return the cost to go after a job is added to a set."""
        done |= 1 << job
        layer = self._states.layers[done.bit_count()]
        place = int(np.searchsorted(layer, np.uint64(done)))
        if place == len(layer) or int(layer[place]) != done:
            return 0.0
        return float(self._to_go[done.bit_count()][place, job])


def find_orders_ahead(
    model: SkillModel, certain: Task, most_sets: int, stop: Stop
) -> OrdersAhead | None:
    """Return the costs to go of a task without failures, or None."""
    if not most_sets:
        return None
    try:
        return OrdersAhead(CertainModel(model, certain), most_sets, stop)
    except NotASequencing:
        return None


def compute_costs_to_go(
    layers: Sequence[Sets], needs: Sequence[int], costs: Costs, stop: Stop
) -> list[Costs]:
    """Return the least cost of the remaining jobs, by set and last job.

    Parameters
    ----------
    costs
        Cost from job i to job j, including j, shape (n, n).
    stop
        Returns True to give up; then the result is None.

    Returns
    -------
    list of ndarray
        For each layer of s sets, shape (s, n); rows of jobs outside the set are undefined.
    """
    count = len(needs)
    tables: list[Costs] = [np.zeros((1, count))]
    for size in range(count - 1, 0, -1):
        here, above = layers[size], layers[size + 1]
        full = np.full((count, len(here)), np.inf)
        for job, set_ in enumerate(needs):
            open_here = np.flatnonzero(find_open(here, job, set_))
            place = np.searchsorted(above, here[open_here] | make_bit(job))
            onward = tables[-1][place, job]
            for last in range(count):
                if costs[last, job] < np.inf:
                    row = full[last]
                    row[open_here] = np.minimum(row[open_here], onward + costs[last, job])
        tables.append(np.ascontiguousarray(full.T))
        if stop():
            return []
    tables.append(np.full((1, count), np.inf))
    return tables[::-1] if count else [np.zeros((1, 0))]
