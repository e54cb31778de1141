"""The sets of jobs that may be done, where a task is one of putting jobs in order.

There are far fewer of them than states: what is held, where the arm stands and with which tool are
left out of them.
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

# Sets are whole numbers of 64 bits.
_MOST_JOBS = 63
_COST_BYTES = 8


class CertainModel(SkillModel):
    """A model of the same task whose skills always succeed; asks what the model itself does.

    Parameters
    ----------
    model
        Of the task as it is.
    certain
        The task of the same skills without failures.

    Attributes
    ----------
    questions
        Bits of the facts that verdicts rested on.
    """

    def __init__(self, model: SkillModel, certain: Task) -> None:
        super().__init__(model.feasibility)
        self.task = certain
        self.questions = 0
        self._model = model
        self._with_failures = {skill.name: skill for skill in model.task.skills}

    def verdict(self, state: State, skill: Skill, likely: object = None) -> Verdict:
        """Return the verdict on a skill, as it is with its failures, in `state`."""
        return self.verdicts([(skill, state)])[0]

    def verdicts(self, queries: Sequence[tuple[Skill, State]], /) -> list[Verdict]:
        """Return the verdicts on several skills in states, in order."""
        own = [(self._with_failures[skill.name], state) for skill, state in queries]
        found = self._model.verdicts(own)
        for verdict in found:
            if verdict.present is None or verdict.absent is None:
                self.questions = self.task.facts.all_bits
            else:
                self.questions |= verdict.present.bits | verdict.absent.bits
        return found


class JobSets:
    """The jobs of a task and the sets of them that may be done, and what a state says of them.

    Parameters
    ----------
    model
        Of the certain task.
    most_sets
        More sets of jobs are refused.
    stop
        When to give up.

    Attributes
    ----------
    problem
        Jobs, costs between them, and precedence.
    jobs, chosen
        The n jobs, and their places among all jobs of the task.
    needs
        By job the set of those that must be done before it.
    layers
        The sets that may be done, by size.
    sets
        How many there are.
    connections
        The ways between jobs.
    situation, initial
        Bits of the facts that are no job's own, and of the initial state.

    Raises
    ------
    NotASequencing
        If the task is not one of putting at most 63 jobs in order, or there are more sets, or it
        was given up.
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
        self.layers = feasible_sets(self.needs, _afforded(most_sets, count, stop), stop)
        if not self.layers:
            raise structure.no(f"more than {most_sets:,} sets of jobs may be done")
        self.sets = sum(len(layer) for layer in self.layers)

    def no(self, reason: str) -> NotASequencing:
        """Return the error that says why nothing is worked out."""
        return self._structure.no(reason)

    def of(self, state: State) -> tuple[int, int, int] | None:
        """Return the set done in a state, the job begun or -1, and how many of its skills are done.

        None where more than one job is begun.
        """
        done, begun, position = 0, -1, 0
        for index, job in enumerate(self.jobs):
            own = state.bits & job.own
            if own == job.stages[-1]:
                done |= 1 << index
            elif own != job.stages[0]:
                if begun >= 0 or own not in job.stages:
                    return None
                begun, position = index, job.stages.index(own)
        return done, begun, position


def _afforded(most_sets: int, count: int, stop: Stop) -> int:
    """Return of how many sets there is memory for a table, at most `most_sets`."""
    left = stop.memory_left_bytes()
    if left is None or not count:
        return most_sets
    # Half of it: a table is filled from another one.
    return min(most_sets, left // (2 * _COST_BYTES * (count + 1)))


def feasible_sets(needs: Sequence[int], most: int, stop: Stop) -> list[Sets]:
    """Return the sets that hold with every job all that it needs, by size, in ascending order.

    Parameters
    ----------
    needs
        By job the set of those that must be done before it.
    most
        With more sets than this nothing is returned.
    stop
        When to give up; then nothing is returned.
    """
    layers: list[Sets] = [np.zeros(1, dtype=np.uint64)]
    total = 1
    for _ in needs:
        here = layers[-1]
        following = [here[open_in(here, job, set_)] | bit_of(job) for job, set_ in enumerate(needs)]
        layers.append(np.unique(np.concatenate(following)))
        total += len(layers[-1])
        if total > most or stop():
            return []
    return layers


def open_in(sets: Sets, job: int, needs: int) -> NDArray[np.bool_]:
    """Return in which sets a job is not done, and all that it needs is."""
    needed = np.uint64(needs)
    found: NDArray[np.bool_] = ((sets & bit_of(job)) == 0) & ((sets & needed) == needed)
    return found


def bit_of(job: int) -> np.uint64:
    """Return the set of one job."""
    return np.uint64(1 << job)


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
        full = np.full((count, len(here)), np.inf)
        for job, set_ in enumerate(needs):
            open_here = np.flatnonzero(open_in(here, job, set_))
            place = np.searchsorted(above, here[open_here] | bit_of(job))
            onward = found[-1][place, job]
            for last in range(count):
                if costs[last, job] < np.inf:
                    row = full[last]
                    row[open_here] = np.minimum(row[open_here], onward + costs[last, job])
        found.append(np.ascontiguousarray(full.T))
        if stop():
            return []
    found.append(np.full((1, count), np.inf))
    return found[::-1] if count else [np.zeros((1, 0))]
