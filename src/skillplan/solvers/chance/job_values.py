"""The least expected cost of ordering jobs whose first skill may fail.

Bellman's equations over the feasible sets of finished jobs, and the places of the arm: after a job,
or after a failed start of one. A failure changes nothing else, so values of a set follow from those
of larger sets and from each other. With Held and Karp's states (1962) that is a finite-horizon
program with a small fixed point in each stage. The fixed point is approached from above, starting
with the policy that tries a job again until it succeeds.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from skillplan.errors import NotASequencing
from skillplan.model.component_jobs import ComponentJobs, Job
from skillplan.model.job_connections import JobConnections
from skillplan.model.skill_model import SkillModel
from skillplan.solvers.chance.job_sets import CertainModel, JobSets, Sets, find_open, make_bit
from skillplan.solvers.chance.retries import assume_retries, collect_touched, list_failures
from skillplan.solvers.stop import Stop
from skillplan.task.skill import Outcome, Skill
from skillplan.task.state import State
from skillplan.task.task import Task

Costs = NDArray[np.float64]

# Relative change of a sweep below which values have converged.
_AT_REST = 1e-15
# From above a few sweeps suffice, unless it is best to try several jobs in turns.
_MOST_SWEEPS = 1_000
# Relative difference below which costs count as equal.
_ROUNDING = 1e-12


@dataclass(frozen=True)
class Ways:
    """Costs of starting jobs from all places between them.

    Parameters
    ----------
    costs
        Cost from s situations to each of n jobs with one try of its first skill, shape (s, n); inf
        if
        impossible. The first n situations follow the jobs, the last is the initial one, and those
        in
        between follow failures.
    rest
        Cost of each job after its first skill has succeeded, shape (n,).
    success
        Probability that the first skill of a job succeeds, shape (n,).
    lost
        Pairs of failure probability and following situation for each job.
    """

    costs: Costs
    rest: Costs
    success: Costs
    lost: tuple[tuple[tuple[float, int], ...], ...]


def relax_to_one_try(task: Task) -> Task:
    """Return a task with certain skills, in which the first skill of a job costs one try.

    A later skill that fails is tried again, and costs all its tries.

    Raises
    ------
    NotASequencing
        If the task does not order jobs, or a skill between jobs may fail.
    """
    sure = assume_retries(task)
    structure = ComponentJobs(sure)
    failing = {skill.name for skill in task.skills if not skill.deterministic}
    for skill in structure.connectors:
        if skill.name in failing:
            raise structure.no(f"{skill.name}, which is part of no job, may fail")
    first = {job.chain[0].name for job in structure.jobs}
    own = {skill.name: skill.cost for skill in task.skills}
    skills = (
        replace(skill, cost=own[skill.name]) if skill.name in first else skill
        for skill in sure.skills
    )
    return replace(sure, skills=tuple(skills))


class JobValues(Mapping[State, Skill]):
    """The policy with the least expected cost, computed on demand.

    Raises
    ------
    NotASequencing
        If the task does not order jobs, there are too many sets, verdicts depend on facts that a
        failure changes, or it was given up.
    """

    def __init__(self, model: SkillModel, most_sets: int, stop: Stop) -> None:
        certain = CertainModel(model, relax_to_one_try(model.task))
        self._model = model
        self._states = states = JobSets(certain, most_sets, stop)
        self._skills = {skill.name: skill for skill in model.task.skills}
        self.sets = states.sets
        if certain.questions & collect_touched(model.task):
            raise states.no("verdicts rest on what a failure changes")
        self._paths: dict[int, list[tuple[str, ...]]] = {}
        self._situations = _Situations(states, self._skills)
        self._ways = self._situations.ways()
        self._after = compute_set_values(states.layers, states.needs, self._ways, stop)
        if not self._after:
            raise states.no("its values were not worked out in time, or did not come to rest")
        self._onward: dict[int, Costs] = {}
        self._said: dict[State, Skill] = {}
        self.cost = 0.0
        if states.jobs:
            self.cost = float((self._ways.costs[-1] + self._begun(0)).min())

    def __getitem__(self, state: State) -> Skill:
        skill = self._said.get(state)
        if skill is None:
            skill = None if self._model.is_goal(state) else self._chosen(state)
            if skill is None:
                raise KeyError(state)
            self._said[state] = skill
        return skill

    def __iter__(self) -> Iterator[State]:
        return iter(list(self._said))

    def __len__(self) -> int:
        return len(self._said)

    def _chosen(self, state: State) -> Skill | None:
        """Return the skill with the least expected cost; None in a dead end."""
        states = self._states
        choice = states.of(state)
        if choice is None:
            return None
        done, started, position = choice
        if started >= 0:
            return self._skills[states.jobs[started].chain[position].name]
        situation = state.bits & states.situation
        totals = self._situations.costs_from(situation) + self._begun(done)
        job = int(totals.argmin())
        if not math.isfinite(totals[job]):
            return None
        path = self._situations.path(situation, job)
        return self._skills[(*path, states.jobs[job].chain[0].name)[0]]

    def _begun(self, done: int) -> Costs:
        """Return the costs to go after a try of each job, for a set of finished jobs."""
        known = self._onward.get(done)
        if known is None:
            states = self._states
            layer = states.layers[done.bit_count()]
            place = int(np.searchsorted(layer, np.uint64(done)))
            above = done.bit_count() + 1
            if place == len(layer) or int(layer[place]) != done:
                return np.full(len(states.jobs), np.inf)
            onward = _add_success(
                layer[place : place + 1],
                states.layers[above],
                self._after[above],
                states.needs,
                self._ways,
            )
            after_a_try = _add_tries(onward, self._ways)
            if after_a_try is None:
                raise states.no("its values did not come to rest")
            known = self._onward[done] = after_a_try[:, 0]
        return known


class _Situations:
    """Places of the arm between jobs, and the costs of starting a job there."""

    def __init__(self, states: JobSets, skills: Mapping[str, Skill]) -> None:
        self._states, self._skills = states, skills
        self._connections: JobConnections = states.connections
        self._rest = np.array([self._rest_of(job) for job in states.jobs])
        self._costs: dict[int, Costs] = {}
        self._stops: dict[int, list[tuple[float, int, tuple[str, ...]]]] = {}

    def ways(self) -> Ways:
        """Return the costs of starting jobs from all situations."""
        states = self._states
        initial = states.initial & states.situation
        after = [job.after for job in states.jobs]
        lost: list[list[tuple[float, int]]] = []
        extra: dict[int, int] = {}
        for index, job in enumerate(states.jobs):
            begin = self._connections.begun_in(states.chosen[index])
            lost.append([])
            for failure in list_failures(self._skills[job.chain[0].name]):
                here = self._failed(job, failure, begin)
                number = extra.setdefault(here, len(after) + len(extra))
                lost[-1].append((failure.probability, number))
        every = [*after, *extra, initial]
        costs = [self.costs_from(situation) for situation in every]
        for index in range(len(states.jobs)):
            costs[index] = costs[index].copy()
            costs[index][index] = np.inf
        success = [1.0 - math.fsum(share for share, _ in pairs) for pairs in lost]
        return Ways(
            np.array(costs).reshape(len(every), len(after)),
            self._rest,
            np.array(success),
            tuple(tuple(pairs) for pairs in lost),
        )

    def costs_from(self, situation: int) -> Costs:
        """Return the costs of reaching each job and trying its first skill, shape (n,)."""
        costs = self._costs.get(situation)
        if costs is None:
            costs = np.full(len(self._states.jobs), np.inf)
            for cost, stop, _ in self._stops_from(situation):
                row = self._connections.row(stop)[self._states.chosen]
                costs = np.minimum(costs, cost + row - self._rest)
            self._check(situation)
            self._costs[situation] = costs
        return costs

    def path(self, situation: int, job: int) -> tuple[str, ...]:
        """Return the skills on the cheapest path to a job, such as a tool change."""
        place = self._states.chosen[job]
        best: tuple[str, ...] = ()
        lowest = math.inf
        for cost, stop, path in self._stops_from(situation):
            total = cost + self._connections.row(stop)[place]
            if total < lowest - _ROUNDING:
                best, lowest = path, total
        return best

    def _stops_from(self, situation: int) -> list[tuple[float, int, tuple[str, ...]]]:
        if situation not in self._stops:
            self._stops[situation] = self._connections.stops_from(situation)
        return self._stops[situation]

    def _rest_of(self, job: Job) -> float:
        """Return the cost of a job after its first skill."""
        index = self._states.jobs.index(job)
        begin = self._connections.begun_in(self._states.chosen[index])
        return self._rest_from(job, begin)

    def _rest_from(self, job: Job, begin: int) -> float:
        onward = self._connections.following(job.chain[0], begin)
        return self._connections.tail(job.chain[1:], onward)

    def _failed(self, job: Job, failure: Outcome, begin: int) -> int:
        """Return the situation after a failed start of a job."""
        situation = self._states.situation
        return begin & ~failure.delete.bits | failure.add.bits & situation

    def _check(self, situation: int) -> None:
        """Check that a started job does not depend on where it was started."""
        states = self._states
        for _, stop, _ in self._stops_from(situation):
            row = self._connections.row(stop)
            for index, job in enumerate(states.jobs):
                if not math.isfinite(row[states.chosen[index]]):
                    continue
                first = self._connections.begun_in(states.chosen[index])
                same = abs(self._rest_from(job, stop) - self._rest[index]) <= _ROUNDING
                for failure in list_failures(self._skills[job.chain[0].name]):
                    origin, other = (self._failed(job, failure, each) for each in (first, stop))
                    same = same and origin == other
                if not same:
                    raise states.no(f"what follows {job.chain[0].name} depends on where it begins")


def find_job_values(model: SkillModel, most_sets: int, stop: Stop) -> JobValues | None:
    """Return the policy with the least expected cost, or None."""
    try:
        return JobValues(model, most_sets, stop)
    except NotASequencing:
        return None


def compute_set_values(
    layers: Sequence[Sets], needs: Sequence[int], ways: Ways, stop: Stop
) -> list[Costs]:
    """Return the least expected cost of the remaining jobs, by set and last job.

    Parameters
    ----------
    stop
        Returns True to give up; the result is None then, or if values do not converge.

    Returns
    -------
    list of ndarray
        For each layer of s sets, shape (s, n); rows of jobs outside the set are undefined.
    """
    count = len(needs)
    tables: list[Costs] = [np.zeros((1, count))]
    for size in range(count - 1, 0, -1):
        onward = _add_success(layers[size], layers[size + 1], tables[-1], needs, ways)
        after_a_try = _add_tries(onward, ways)
        if after_a_try is None:
            return []
        full = np.full((count, len(layers[size])), np.inf)
        for last in range(count):
            for job in range(count):
                if ways.costs[last, job] < np.inf:
                    np.minimum(full[last], after_a_try[job] + ways.costs[last, job], out=full[last])
        tables.append(np.ascontiguousarray(full.T))
        if stop():
            return []
    tables.append(np.full((1, count), np.inf))
    return tables[::-1] if count else [np.zeros((1, 0))]


def _add_success(here: Sets, above: Sets, values: Costs, needs: Sequence[int], ways: Ways) -> Costs:
    """Return the costs to go after the first skill of each job has succeeded, shape (n, sets)."""
    onward = np.full((len(needs), len(here)), np.inf)
    for job, set_ in enumerate(needs):
        open_here = np.flatnonzero(find_open(here, job, set_))
        place = np.searchsorted(above, here[open_here] | make_bit(job))
        onward[job, open_here] = ways.rest[job] + values[place, job]
    return onward


def _add_tries(onward: Costs, ways: Ways) -> Costs | None:
    """Return the costs to go after a try of each job's first skill, shape (n, sets).

    After a failure it is the value of the resulting situation. Values are approached from above,
    starting with the policy that tries a job again until it succeeds. Its values have a closed
    form, so
    almost certain failures need no more sweeps than others.

    Returns
    -------
    ndarray or None
        None if the values have not converged.
    """
    costs = onward * ways.success[:, None]
    failing = [job for job, pairs in enumerate(ways.lost) if pairs]
    if not failing:
        return costs
    succeeded = costs.copy()
    for job in failing:
        again = sum(share * ways.costs[number, job] for share, number in ways.lost[job])
        costs[job] = onward[job] + again / ways.success[job]
    for _ in range(_MOST_SWEEPS):
        change = 0.0
        for job in failing:
            value = _add_retry(job, costs, succeeded[job], ways)
            finite = np.isfinite(value)
            if finite.any():
                moved = np.abs(value[finite] - costs[job][finite]) / np.maximum(1.0, value[finite])
                change = max(change, float(moved.max()))
            costs[job] = value
        if change <= _AT_REST:
            return costs
    return None


def _add_retry(job: int, costs: Costs, succeeded: Costs, ways: Ways) -> Costs:
    """Return the costs to go after a try of one job, shape (sets,).

    If the same job is the best one after a failure, its share returns to the same value and is
    divided
    out.

    Parameters
    ----------
    costs
        Best known cost of every job, shape (n, sets).
    succeeded
        Cost to go after a success, times its probability, shape (sets,).
    """
    total = succeeded.copy()
    leaving = np.full(len(total), ways.success[job])
    for share, number in ways.lost[job]:
        other = np.full(len(total), np.inf)
        for following in np.flatnonzero(np.isfinite(ways.costs[number])):
            if following != job:
                np.minimum(other, costs[following] + ways.costs[number, following], out=other)
        returns = costs[job] + ways.costs[number, job] <= other
        total += share * np.where(returns, ways.costs[number, job], other)
        leaving += np.where(returns, 0.0, share)
    # From above values only fall: rounding alone would make them oscillate for ever.
    value: Costs = np.minimum(costs[job], total / leaving)
    return value
