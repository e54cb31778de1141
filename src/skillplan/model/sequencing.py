"""A model as a sequential ordering problem: jobs, costs between them, and precedence.

Escudero (1988): an asymmetric path through all jobs that respects a precedence relation. A job
is the run of skills that brings one component of the product to its goal, such as pick and place;
what a tool change costs is part of the path from one job to the next. Models that do not have
this structure are refused in words.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from skillplan.chart.precedence_query import CheckSteps, run_queries
from skillplan.model.component_jobs import ComponentJobs
from skillplan.model.done_jobs import DoneSets, closed, members
from skillplan.model.job_connections import JobConnections
from skillplan.model.job_precedence import JobQuery
from skillplan.model.priced_connections import PricedConnections, needed_connections
from skillplan.model.skill_model import SkillModel

# By how much a path may cost more for leaving a job out, because of rounding.
_TOLERANCE = 1e-9


@dataclass(frozen=True)
class SequencingProblem:
    """Jobs to be put into an order.

    The least cost of an order that respects the precedence is the least of any plan, and every
    such order of finite cost is a plan, but for the step limit.

    Parameters
    ----------
    jobs
        Names of the n components.
    skills
        The skills of every job.
    first
        Cost of coming to a job from the initial state and doing it, shape (n,); inf where it
        cannot be the first.
    costs
        Cost of coming from job i to job j and doing it, shape (n, n); inf on the diagonal and
        where j cannot come right after i.
    precedence
        Pairs of indices: the first before the second. What follows from others may be left out.
    paths
        The skills between the initial state (-1), or a job, and a job, such as tool changes;
        pairs without any are left out.
    step_limit
        The most skills a plan of the task may have. An order does not know of it: one whose
        plan is longer is no solution of the task, see `fits`.

    Raises
    ------
    ValueError
        If the shapes do not fit or the precedence names an unknown job.
    """

    jobs: tuple[str, ...]
    skills: tuple[tuple[str, ...], ...]
    first: NDArray[np.float64]
    costs: NDArray[np.float64]
    precedence: frozenset[tuple[int, int]]
    paths: dict[tuple[int, int], tuple[str, ...]]
    step_limit: int

    def __post_init__(self) -> None:
        n = len(self.jobs)
        if len(self.skills) != n or self.first.shape != (n,) or self.costs.shape != (n, n):
            raise ValueError(f"SequencingProblem needs n = {n} jobs, (n,) and (n, n) costs.")
        if any(not (0 <= i < n and 0 <= j < n) for i, j in self.precedence):
            raise ValueError("SequencingProblem precedence names an unknown job.")

    def cost(self, order: Sequence[int]) -> float:
        """Return the cost of doing all jobs in an order."""
        between = sum(self.costs[i, j] for i, j in pairwise(order))
        return float(self.first[order[0]] + between) if len(order) else 0.0

    def plan(self, order: Sequence[int]) -> tuple[str, ...]:
        """Return the skills of doing all jobs in an order, tool changes included."""
        names: list[str] = []
        for before, job in zip((-1, *order), order, strict=False):
            names += [*self.paths.get((before, job), ()), *self.skills[job]]
        return tuple(names)

    def fits(self, order: Sequence[int]) -> bool:
        """Whether the plan of an order respects the step limit."""
        return len(self.plan(order)) <= self.step_limit

    def order(self, plan: Sequence[str]) -> tuple[int, ...] | None:
        """Return the order in which a plan does the jobs.

        None where it does not do each job once and without anything between its skills; other
        skills may come between jobs. Whether it is feasible is not looked at.

        Parameters
        ----------
        plan
            Names of skills.
        """
        begun = {chain[0]: job for job, chain in enumerate(self.skills)}
        inside = {name for chain in self.skills for name in chain}
        order: list[int] = []
        position = 0
        while position < len(plan):
            name = plan[position]
            if name not in inside:
                position += 1
                continue
            job = begun.get(name)
            if job is None:
                return None
            chain = self.skills[job]
            if tuple(plan[position : position + len(chain)]) != chain:
                return None
            order.append(job)
            position += len(chain)
        return tuple(order) if sorted(order) == list(range(len(self.jobs))) else None

    @classmethod
    def from_model(cls, model: SkillModel) -> SequencingProblem:
        """Recognise the structure in a model; back ends are queried for the precedence.

        And for costs where they tell them: then what cannot come right after each other, and what
        is not cheapest even by its lower bound, is not asked.

        Raises
        ------
        NotASequencing
            If the model does not have it; the message says why.
        BackEndError
            If a back end fails.
        SearchStopped
            If the caller should have stopped long ago.
        """
        told_basis = model.feasibility.times.basis if model.asks_costs else 0
        structure = ComponentJobs(model.task, told_basis)
        several = next(
            (one.name for one in model.task.skills if one.ways and model.asks_costs), None
        )
        if several is not None:
            raise structure.no(f"how long {several} takes depends on the way that it can take")
        sets = DoneSets(structure)
        connections = JobConnections(model, structure, sets)
        costs, paths_found = connections.matrix(), connections.paths
        before = _precedence(model, structure, sets, connections)
        if model.asks_costs:
            needed = needed_connections(len(structure.jobs), *closed(structure, before))
            priced = PricedConnections(model, structure, connections, needed)
            costs, paths_found = priced.costs, priced.paths
        chosen = sorted(before)
        _check_left_out(structure, set(before), costs)
        index = {job: i for i, job in enumerate(chosen)}
        paths = {
            (index.get(source, -1), index[job]): path
            for (source, job), path in paths_found.items()
            if job in index and (source < 0 or source in index)
        }
        return cls(
            tuple(structure.jobs[job].component for job in chosen),
            tuple(tuple(skill.name for skill in structure.jobs[job].chain) for job in chosen),
            costs[0, chosen],
            costs[np.ix_([1 + job for job in chosen], chosen)],
            frozenset((index[one], index[job]) for job in chosen for one in members(before[job])),
            paths,
            model.task.step_limit,
        )


def _precedence(
    model: SkillModel, structure: ComponentJobs, sets: DoneSets, connections: JobConnections
) -> dict[int, int]:
    """Return, by each job that every plan does, the set of those that must come before it."""
    queries: dict[int, JobQuery] = {}

    def run(steps: Mapping[int, CheckSteps[bool]]) -> None:
        answers = run_queries(model, list(steps.values()))
        for job, answered in zip(steps, answers, strict=True):
            if not answered:
                name = structure.jobs[job].component
                raise structure.no(f"the order around {name} could not be worked out")

    todo = set(structure.goal)
    while todo:
        new = {job: JobQuery(sets, job, connections.begun_in(job)) for job in sorted(todo)}
        queries |= new
        run({job: query.feasible_sets() for job, query in new.items()})
        # What the query of one job found about another need not be queried again.
        _exchange(queries)
        run({job: query.relations() for job, query in new.items()})
        _exchange(queries)
        # What is not in the goal, but needed for it, is done in every plan, too.
        needed = {other for query in queries.values() for other in members(query.before)}
        todo = needed - set(queries)
    before = {job: query.before for job, query in queries.items()}
    all_before, all_after = closed(structure, before)
    left_out = sum(1 << job for job in range(len(structure.jobs)) if job not in queries)
    for job in queries:
        all_after[job] |= left_out
    run({job: query.beyond(all_before, all_after) for job, query in queries.items()})
    return before


def _exchange(queries: Mapping[int, JobQuery]) -> None:
    """Have each of two jobs that every plan does know which of them comes first."""
    for job, query in queries.items():
        for other in members(query.before):
            if other in queries:
                queries[other].after |= 1 << job
        for other in members(query.after):
            if other in queries:
                queries[other].before |= 1 << job


def _check_left_out(structure: ComponentJobs, done: set[int], costs: NDArray[np.float64]) -> None:
    """Demand that a job which nothing needs never makes a plan cheaper.

    Then every plan can leave it out at no more cost: nothing needs it, and from any job before it
    a path that costs no more leads to any job after it.
    """
    for job in sorted(set(range(len(structure.jobs))) - done):
        around = costs[:, [job]] + costs[[1 + job], :]
        around[:, job] = around[1 + job, :] = math.inf
        np.fill_diagonal(around[1:], math.inf)
        if not (costs <= around + _TOLERANCE).all():
            component = structure.jobs[job].component
            raise structure.no(
                f"{component} is not in the goal, and doing it might make a plan cheaper"
            )
