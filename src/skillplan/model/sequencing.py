"""A model as a sequential ordering problem: jobs, costs between them, and precedence.

Escudero (1988): an asymmetric path through all jobs that respects a precedence relation. A job
is the run of skills that brings one component of the product to its goal, such as pick and place;
what a tool change costs is part of the path from one job to the next. Models that do not have
this structure are refused in words.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from skillplan.chart.hypothetical_state import HypotheticalStates
from skillplan.chart.precedence_query import CheckSteps, Undecided, run_queries
from skillplan.model.component_jobs import ComponentJobs, DoneSets, closed, members
from skillplan.model.fact_analysis import each_bit
from skillplan.model.job_connections import JobConnections, PricedConnections, needed_connections
from skillplan.model.skill_model import SkillModel
from skillplan.task.verdict import Verdict, VerdictStatus

# The most states that are considered for one job before the model is given up.
_MOST_QUERIES = 5_000


class JobQuery:
    """The queries to back ends about the skills of one job.

    Parameters
    ----------
    sets
        The states that are considered.
    job
        Index of the job.
    situation
        Bits of a situation in which it can be begun.

    Attributes
    ----------
    before, after
        Jobs that must be done, and must not, while this one is done; grows.
    """

    def __init__(self, sets: DoneSets, job: int, situation: int) -> None:
        self._sets = sets
        self._structure = sets.structure
        self.job = self._structure.jobs[job]
        self._index = job
        self._queries = 0
        self._found: dict[int, tuple[int, int]] = {}
        self._begins = list(self._beginnings(situation))
        self.before, self.after = sets.demands(job)

    def feasible_sets(self) -> CheckSteps[bool]:
        """Find jobs with which done each skill is feasible, and those of them that are necessary.

        Raises
        ------
        NotASequencing
            If a skill is feasible in no order, or depends on more than on what is done.
        """
        for position in range(len(self.job.chain)):
            yield from self._settle(position)
        return True

    def relations(self) -> CheckSteps[bool]:
        """Find the other jobs that must be done before this one, and those that must not.

        Raises
        ------
        NotASequencing
            If a skill is feasible in no order, or depends on more than on what is done.
        """
        positions = range(len(self.job.chain))
        for position in positions:
            yield from self._settle(position)
            yield from self._necessary(position)
        # What one skill needs, another may have been feasible without.
        for position in positions:
            yield from self._settle(position)
        return True

    def beyond(
        self, closed_before: Mapping[int, int], closed_after: Mapping[int, int]
    ) -> CheckSteps[bool]:
        """Demand that the skills are feasible in every order that respects the relation.

        Parameters
        ----------
        closed_before, closed_after
            By job the jobs that must come before it, and those that are not done before it.

        Raises
        ------
        NotASequencing
            If there is an order in which one is not feasible.
        """
        for position, (done, named) in self._found.items():
            # A verdict that rests on nothing else holds in all of them.
            if named & (done & ~self.before | ~done & ~self.after):
                base = closed_before[self._index]
                never = closed_after[self._index] | 1 << self._index
                yield from self._cover(position, base, never, closed_before)
        return True

    def _beginnings(self, situation: int) -> Iterator[int]:
        """Yield the situation in which each skill is begun."""
        for skill in self.job.chain:
            yield situation
            outcome = skill.prediction
            kept = situation & ~outcome.delete.bits
            situation = kept | outcome.add.bits & self._structure.situation

    def _check(self, position: int, done: int) -> CheckSteps[Verdict]:
        """Return the verdict on a skill of the job where exactly these others are done."""
        self._queries += 1
        skill, structure = self.job.chain[position], self._structure
        if self._queries > _MOST_QUERIES:
            raise Undecided
        own = self._sets.state_bits(done) & ~self.job.own | self.job.stages[position]
        state = structure.task.facts.state(own | self._begins[position])
        verdict = yield skill, state
        if verdict.status is VerdictStatus.UNKNOWN:
            raise Undecided
        assert verdict.present is not None
        assert verdict.absent is not None
        holds, lacks = structure.settled(self._index, position)
        open_bits = verdict.present.bits & ~holds | verdict.absent.bits & ~lacks
        if open_bits & structure.situation:
            fact = structure.task.facts.names_of(open_bits & structure.situation)[0]
            literal = fact if fact in verdict.present else f"not {fact}"
            kind = HypotheticalStates(structure.task).dependence(fact)
            raise structure.no(f"{skill.name} depends on {kind}: {literal}")
        return verdict

    def _blamed(self, verdict: Verdict) -> int:
        return self._sets.named(verdict) & ~(1 << self._index)

    def _settle(self, position: int) -> CheckSteps[None]:
        """Find jobs with which done a skill is feasible that agree with what is known by now."""
        if position in self._found:
            done, named = self._found[position]
            settled = (done | self.before) & ~self.after
            if not named & (done ^ settled):
                self._found[position] = settled, named
                return
        found = yield from self._feasible(position, self.before, self.after, sure=True)
        if found is None:
            verdict = yield from self._check(position, self.before)
            no_order = "in no order" if self.before | self.after else "never"
            why = f"{verdict.stage}: {verdict.reason}"
            name = self.job.chain[position].name
            raise self._structure.no(f"{name} is {no_order} feasible ({why})")
        self._found[position] = found

    def _feasible(
        self, position: int, done: int, undone: int, *, sure: bool = False
    ) -> CheckSteps[tuple[int, int] | None]:
        """Return jobs with which done a skill is feasible, and those its verdict names, or None.

        An infeasible verdict rules out every set that agrees with what it names, so that any
        feasible one differs in that: depth-first search over which.

        Parameters
        ----------
        position
            Which skill.
        done, undone
            Jobs that must, and must not, be done.
        sure
            Whether these are certain to be so: then what alone is left to differ must, too.
        """
        while True:
            verdict = yield from self._check(position, done)
            blamed = self._blamed(verdict)
            if verdict.is_feasible:
                return done, blamed
            blamed &= ~(done | undone)
            if not blamed:
                return None
            if blamed & (blamed - 1):
                break
            done |= blamed
            if sure:
                self.before = done
        for other in each_bit(blamed):
            found = yield from self._feasible(position, done | other, undone)
            if found is not None:
                return found
            undone |= other
        return None

    def _necessary(self, position: int) -> CheckSteps[None]:
        """Find which of the jobs that a feasible verdict names have to be as they are.

        No others can have to be: the verdict holds whatever they are.
        """
        done, named = self._found[position]
        blamed: dict[int, int] = {}
        for other in each_bit(named & ~(self.before | self.after)):
            verdict = yield from self._check(position, done ^ other)
            if not verdict.is_feasible:
                blamed[other] = self._blamed(verdict) & ~other
        while blamed:
            # What rests on nothing but what has to be as it is needs no search.
            sure = [o for o, rest in blamed.items() if not rest & ~(self.before | self.after)]
            for other in sure or [next(iter(blamed))]:
                del blamed[other]
                exception = (0, other) if other & done else (other, 0)
                found = None
                if not sure:
                    found = yield from self._feasible(
                        position, self.before | exception[0], self.after | exception[1]
                    )
                if found is None:
                    self.before |= other & done
                    self.after |= other & ~done

    def _cover(
        self, position: int, done: int, never: int, closed_before: Mapping[int, int]
    ) -> CheckSteps[None]:
        """Demand that a skill is feasible with these done, and whatever else but some jobs."""
        verdict = yield from self._check(position, done)
        if not verdict.is_feasible:
            facts = ", ".join(verdict.facts)
            name = self.job.chain[position].name
            raise self._structure.no(f"{name} depends on more than the order of parts: {facts}")
        for other in each_bit(self._blamed(verdict) & ~(done | never)):
            more = done | other | closed_before[other.bit_length() - 1]
            if not more & never:
                yield from self._cover(position, more, never, closed_before)
            never |= other


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
