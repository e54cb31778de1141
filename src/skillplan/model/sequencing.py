"""Sequential ordering problem of a model: jobs, costs between them, and precedence.

Escudero (1988): an asymmetric path through all jobs that respects a precedence relation. A job is a
sequence of skills that brings one component of the product to its goal, such as pick and place.
Tool changes are part of the path between jobs. Models without this structure are refused with a
reason.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from skillplan.chart.hypothetical_state import HypotheticalStates
from skillplan.chart.precedence_query import CheckSteps, Undecided, run_queries
from skillplan.model.component_jobs import ComponentJobs, DoneSets, close_relation, list_members
from skillplan.model.fact_analysis import iterate_bits
from skillplan.model.job_connections import (
    JobConnections,
    PricedConnections,
    find_needed_connections,
)
from skillplan.model.pooled_model import PooledModel, assign
from skillplan.model.skill_model import SkillModel
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict, VerdictStatus

# Greatest number of states that are checked for one job.
_MOST_QUERIES = 5_000


class JobQuery:
    """Queries about the skills of one job.

    Parameters
    ----------
    situation
        Bits of a situation in which the job can start.

    Attributes
    ----------
    before, after
        Jobs that must be done before this job, and jobs that must not be.
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
        """Find sets of done jobs with which each skill is feasible, and the necessary jobs of them.

        Raises
        ------
        NotASequencing
            If a skill is feasible in no order, or depends on more than the done jobs.
        """
        for position in range(len(self.job.chain)):
            yield from self._settle(position)
        return True

    def relations(self) -> CheckSteps[bool]:
        """Find the jobs that must be done before this one, and jobs that must not.

        Raises
        ------
        NotASequencing
            If a skill is feasible in no order, or depends on more than the done jobs.
        """
        positions = range(len(self.job.chain))
        for position in positions:
            yield from self._settle(position)
            yield from self._necessary(position)
        # Another skill may have been feasible without the jobs that this one needs.
        for position in positions:
            yield from self._settle(position)
        return True

    def beyond(
        self, closed_before: Mapping[int, int], closed_after: Mapping[int, int]
    ) -> CheckSteps[bool]:
        """Check that the skills are feasible in every order that respects the relation.

        Parameters
        ----------
        closed_before, closed_after
            Jobs that must come before each job, and jobs that are not done before it.

        Raises
        ------
        NotASequencing
            If a skill is infeasible in such an order.
        """
        for position, (done, named) in self._found.items():
            # A verdict that rests on no other job holds in all orders.
            if named & (done & ~self.before | ~done & ~self.after):
                base = closed_before[self._index]
                never = closed_after[self._index] | 1 << self._index
                yield from self._cover(position, base, never, closed_before)
        return True

    def _beginnings(self, situation: int) -> Iterator[int]:
        """Yield the situation before each skill."""
        for skill in self.job.chain:
            yield situation
            outcome = skill.prediction
            kept = situation & ~outcome.delete.bits
            situation = kept | outcome.add.bits & self._structure.situation

    def _check(self, position: int, done: int) -> CheckSteps[Verdict]:
        """Return the verdict on a skill if exactly some other jobs are done."""
        self._queries += 1
        skill, structure = self.job.chain[position], self._structure
        if self._queries > _MOST_QUERIES:
            raise Undecided
        own = self._sets.state_bits(done) & ~self.job.own | self.job.stages[position]
        state = structure.task.facts.state(own | self._begins[position])
        verdict = yield skill, state
        if verdict.status is VerdictStatus.UNKNOWN:
            raise Undecided
        _refuse_dependence(structure, self._index, position, verdict)
        return verdict

    def _blamed(self, verdict: Verdict) -> int:
        return self._sets.named(verdict) & ~(1 << self._index)

    def _settle(self, position: int) -> CheckSteps[None]:
        """Find a set of done jobs, within the known precedence, that makes a skill feasible."""
        if position in self._found:
            done, named = self._found[position]
            settled = (done | self.before) & ~self.after
            if not named & (done ^ settled):
                self._found[position] = settled, named
                return
        feasible_set = yield from self._feasible(position, self.before, self.after, sure=True)
        if feasible_set is None:
            verdict = yield from self._check(position, self.before)
            no_order = "in no order" if self.before | self.after else "never"
            why = f"{verdict.stage}: {verdict.reason}"
            name = self.job.chain[position].name
            raise self._structure.no(f"{name} is {no_order} feasible ({why})")
        self._found[position] = feasible_set

    def _feasible(
        self, position: int, done: int, undone: int, *, sure: bool = False
    ) -> CheckSteps[tuple[int, int] | None]:
        """Return a set of done jobs that makes a skill feasible, and the jobs its verdict names.

        None if there is no such set. An infeasible verdict rules out every set that agrees with the
        facts it rests on. Feasible sets differ in one of these: depth-first search over them.

        Parameters
        ----------
        done, undone
            Jobs that are fixed as done, and as not done.
        sure
            True if these are certain; then a single remaining difference is necessary.
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
        for other in iterate_bits(blamed):
            feasible_set = yield from self._feasible(position, done | other, undone)
            if feasible_set is not None:
                return feasible_set
            undone |= other
        return None

    def _necessary(self, position: int) -> CheckSteps[None]:
        """Find the necessary jobs of a feasible verdict.

        Other jobs are not necessary: the verdict holds either way.
        """
        done, named = self._found[position]
        blamed: dict[int, int] = {}
        for other in iterate_bits(named & ~(self.before | self.after)):
            verdict = yield from self._check(position, done ^ other)
            if not verdict.is_feasible:
                blamed[other] = self._blamed(verdict) & ~other
        while blamed:
            # A verdict that rests only on necessary jobs needs no search.
            sure = [o for o, rest in blamed.items() if not rest & ~(self.before | self.after)]
            for other in sure or [next(iter(blamed))]:
                del blamed[other]
                exception = (0, other) if other & done else (other, 0)
                feasible_set = None
                if not sure:
                    feasible_set = yield from self._feasible(
                        position, self.before | exception[0], self.after | exception[1]
                    )
                if feasible_set is None:
                    self.before |= other & done
                    self.after |= other & ~done

    def _cover(
        self, position: int, done: int, never: int, closed_before: Mapping[int, int]
    ) -> CheckSteps[None]:
        """Check that a skill is feasible with some jobs done, and with any others except some."""
        verdict = yield from self._check(position, done)
        if not verdict.is_feasible:
            facts = ", ".join(verdict.facts)
            name = self.job.chain[position].name
            raise self._structure.no(f"{name} depends on more than the order of parts: {facts}")
        for other in iterate_bits(self._blamed(verdict) & ~(done | never)):
            more = done | other | closed_before[other.bit_length() - 1]
            if not more & never:
                yield from self._cover(position, more, never, closed_before)
            never |= other


def _refuse_dependence(structure: ComponentJobs, job: int, position: int, verdict: Verdict) -> None:
    """Refuse a verdict on a skill of a job that rests on more than the done jobs."""
    open_bits = structure.find_open_bits(job, position, verdict)
    if open_bits:
        fact = structure.task.facts.names_of(open_bits)[0]
        literal = fact if verdict.present and fact in verdict.present else f"not {fact}"
        kind = HypotheticalStates(structure.task).dependence(fact)
        name = structure.jobs[job].chain[position].name
        raise structure.no(f"{name} depends on {kind}: {literal}")


def _try_first_skill(model: SkillModel, structure: ComponentJobs) -> None:
    """Refuse a model in which the first skill of a job depends on more than the done jobs.

    Skills between jobs are checked in many situations; this one check mostly spares them.
    """
    for index, job in enumerate(structure.jobs):
        if job.chain[0].applicable(model.initial):
            verdict = model.verdict(model.initial, job.chain[0])
            if verdict.status is not VerdictStatus.UNKNOWN:
                _refuse_dependence(structure, index, 0, verdict)
            return


# Rounding error of the cost of a path with one job less.
_TOLERANCE = 1e-9


@dataclass(frozen=True)
class SequencingProblem:
    """Jobs that must be ordered.

    The least cost of an order that respects the precedence is that of the best plan. Every such
    order of finite cost is a plan, unless it exceeds the step limit.

    Parameters
    ----------
    jobs
        Names of the n components.
    first
        Cost of reaching and doing each job from the initial state, shape (n,); inf if it cannot be
        the first.
    costs
        Cost of reaching and doing job j from job i, shape (n, n); inf on the diagonal and if j
        cannot follow i directly.
    precedence
        Pairs of indices, the first before the second; implied pairs may be left out.
    paths
        Skills between the initial state (-1), or a job, and a job, such as tool changes; pairs
        without skills are left out.
    step_limit
        Greatest number of skills in a plan. An order may exceed it, see `fits`.
    assigned
        Of interchangeable bodies, the skill of a plan by the skill that fills a place, and by that
        which took the body; see `PooledModel`.
    """

    jobs: tuple[str, ...]
    skills: tuple[tuple[str, ...], ...]
    first: NDArray[np.float64]
    costs: NDArray[np.float64]
    precedence: frozenset[tuple[int, int]]
    paths: dict[tuple[int, int], tuple[str, ...]]
    step_limit: int
    assigned: Mapping[str, Mapping[str, str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        n = len(self.jobs)
        if len(self.skills) != n or self.first.shape != (n,) or self.costs.shape != (n, n):
            raise ValueError(f"SequencingProblem needs n = {n} jobs, (n,) and (n, n) costs.")
        if any(not (0 <= i < n and 0 <= j < n) for i, j in self.precedence):
            raise ValueError("SequencingProblem precedence names an unknown job.")

    def cost(self, order: Sequence[int]) -> float:
        """Return the cost of an order."""
        between = sum(self.costs[i, j] for i, j in pairwise(order))
        return float(self.first[order[0]] + between) if len(order) else 0.0

    def plan(self, order: Sequence[int]) -> tuple[str, ...]:
        """Return the skills of an order, tool changes included."""
        names: list[str] = []
        for before, job in zip((-1, *order), order, strict=False):
            names += [*self.paths.get((before, job), ()), *self.skills[job]]
        return assign(names, self.assigned) if self.assigned else tuple(names)

    def fits(self, order: Sequence[int]) -> bool:
        """Return whether the plan of an order respects the step limit."""
        return len(self.plan(order)) <= self.step_limit

    def order(self, plan: Sequence[str]) -> tuple[int, ...] | None:
        """Return the order of the jobs in a plan.

        None if the plan does not do each job once and without interruption; other skills may come
        between jobs. Feasibility is not checked.
        """
        first_jobs = {chain[0]: job for job, chain in enumerate(self.skills)}
        inside = {name for chain in self.skills for name in chain}
        order: list[int] = []
        position = 0
        unnamed = {name: job for job, fills in self.assigned.items() for name in fills.values()}
        plan = [unnamed.get(name, name) for name in plan]
        while position < len(plan):
            name = plan[position]
            if name not in inside:
                position += 1
                continue
            job = first_jobs.get(name)
            if job is None:
                return None
            chain = self.skills[job]
            if tuple(plan[position : position + len(chain)]) != chain:
                return None
            order.append(job)
            position += len(chain)
        return tuple(order) if sorted(order) == list(range(len(self.jobs))) else None

    @classmethod
    def from_model(
        cls, model: SkillModel, must_stop: Callable[[], bool] = lambda: False
    ) -> SequencingProblem:
        """Return the sequencing problem of a model; back ends are queried for the precedence.

        If back ends compute costs, they are not queried for impossible connections, nor for paths
        that a lower bound excludes.

        Parameters
        ----------
        must_stop
            Returns True once the precedence is not derived further.

        Raises
        ------
        NotASequencing
            If the model does not have this structure, or the derivation was stopped; the message
            gives the reason.
        BackEndError
            If a back end fails.
        SearchStopped
            If the solver is overdue.
        """
        assigned: Mapping[str, Mapping[str, str]] = {}
        if model.task.pools and model.task.deterministic:
            model = pooled = PooledModel(model)
            assigned = pooled.assigned
        told_basis = model.feasibility.times.basis if model.asks_costs else 0
        structure = ComponentJobs(model.task, told_basis)
        several = next(
            (skill.name for skill in model.task.skills if skill.ways and model.asks_costs), None
        )
        if several is not None:
            raise structure.no(f"how long {several} takes depends on the way that it can take")
        _try_first_skill(model, structure)
        sets = DoneSets(structure)
        connections = JobConnections(model, structure, sets)
        costs, paths_by_job = connections.matrix(), connections.paths
        before = _precedence(model, structure, sets, connections, must_stop)
        if model.asks_costs:
            needed = find_needed_connections(
                len(structure.jobs), *close_relation(structure, before)
            )
            priced = PricedConnections(model, structure, connections, needed)
            costs, paths_by_job = priced.costs, priced.paths
        return assemble(model.task, structure, before, costs, paths_by_job, assigned)


def assemble(
    task: Task,
    structure: ComponentJobs,
    before: Mapping[int, int],
    costs: NDArray[np.float64],
    paths_by_job: Mapping[tuple[int, int], tuple[str, ...]],
    assigned: Mapping[str, Mapping[str, str]] | None = None,
) -> SequencingProblem:
    """Return the problem of the jobs that every plan does.

    Parameters
    ----------
    before
        Predecessors of each of these jobs, as a set.
    costs, paths_by_job
        As of `JobConnections`, of all jobs.

    Raises
    ------
    NotASequencing
        If another job may make a plan cheaper.
    """
    chosen = sorted(before)
    _check_left_out(structure, set(before), costs)
    index = {job: i for i, job in enumerate(chosen)}
    paths = {
        (index.get(source, -1), index[job]): path
        for (source, job), path in paths_by_job.items()
        if job in index and (source < 0 or source in index)
    }
    return SequencingProblem(
        tuple(structure.jobs[job].component for job in chosen),
        tuple(tuple(skill.name for skill in structure.jobs[job].chain) for job in chosen),
        costs[0, chosen],
        costs[np.ix_([1 + job for job in chosen], chosen)],
        frozenset(
            (index[member], index[job]) for job in chosen for member in list_members(before[job])
        ),
        paths,
        task.step_limit,
        assigned or {},
    )


def _precedence(
    model: SkillModel,
    structure: ComponentJobs,
    sets: DoneSets,
    connections: JobConnections,
    must_stop: Callable[[], bool],
) -> dict[int, int]:
    """Return the predecessors of each job that every plan does."""
    queries: dict[int, JobQuery] = {}

    def run(steps: Mapping[int, CheckSteps[bool]]) -> None:
        answers = run_queries(model, list(steps.values()), must_stop)
        for job, answered in zip(steps, answers, strict=True):
            if not answered:
                name = structure.jobs[job].component
                end = " in the time" if must_stop() else ""
                raise structure.no(f"the order around {name} could not be worked out{end}")

    todo = set(structure.goal)
    while todo:
        new = {job: JobQuery(sets, job, connections.begun_in(job)) for job in sorted(todo)}
        queries |= new
        run({job: query.feasible_sets() for job, query in new.items()})
        # Results for one job about another are not queried again.
        _exchange(queries)
        run({job: query.relations() for job, query in new.items()})
        _exchange(queries)
        # Every plan also does jobs that are not in the goal but needed for it.
        needed = {other for query in queries.values() for other in list_members(query.before)}
        todo = needed - set(queries)
    before = {job: query.before for job, query in queries.items()}
    all_before, all_after = close_relation(structure, before)
    left_out = sum(1 << job for job in range(len(structure.jobs)) if job not in queries)
    for job in queries:
        all_after[job] |= left_out
    run({job: query.beyond(all_before, all_after) for job, query in queries.items()})
    return before


def _exchange(queries: Mapping[int, JobQuery]) -> None:
    """Complete the relation: every predecessor has the job as a successor, and vice versa."""
    for job, query in queries.items():
        for other in list_members(query.before):
            if other in queries:
                queries[other].after |= 1 << job
        for other in list_members(query.after):
            if other in queries:
                queries[other].before |= 1 << job


def _check_left_out(structure: ComponentJobs, done: set[int], costs: NDArray[np.float64]) -> None:
    """Check that a job that is not needed never makes a plan cheaper.

    Then every plan can leave it out: no job needs it, and any path through it can be replaced by
    an equally cheap one.
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
