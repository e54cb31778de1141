"""Cheapest paths between jobs, such as tool changes."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan.chart.precedence_query import Undecided
from skillplan.model.component_jobs import ComponentJobs, DoneSets, Gate
from skillplan.model.fact_analysis import iterate_bits
from skillplan.model.skill_model import SkillModel
from skillplan.task.cost import NEVER, TableCost
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.verdict import Verdict, VerdictStatus

# Limits of the search between two jobs: situations, and queries about a skill.
_MOST_SITUATIONS = 1_000
_MOST_QUERIES = 1_000


@dataclass(frozen=True, slots=True)
class _Stop:
    """A situation after a job, the skills that reach it, and their cost."""

    cost: float
    situation: int
    path: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Group:
    """Jobs that can start in the same situations.

    Jobs of a single skill with a table of costs are listed separately, by the bits of the places.
    """

    needs: int
    bars: int
    jobs: list[int]
    tables: dict[int, list[int]]


class JobConnections:
    """Least costs of reaching and doing each job, and the skills on these paths.

    If back ends compute costs, these are lower bounds: see `PricedConnections`.

    Parameters
    ----------
    model
        The model, queried about the skills between jobs.
    relaxed
        True if skills between jobs count as feasible; then the costs are lower bounds.

    Attributes
    ----------
    paths
        Skills from a job, or the start (-1), to a job; pairs without skills are left out.

    Raises
    ------
    NotASequencing
        If a skill between jobs depends on the jobs that are done.
    """

    def __init__(
        self, model: SkillModel, structure: ComponentJobs, sets: DoneSets, *, relaxed: bool = False
    ) -> None:
        self._model, self._relaxed = model, relaxed
        self._bounds = model.asks_costs
        self._structure = structure
        self._sets = sets
        self._facts = structure.task.facts
        # Gates need jobs, too: in every order they are done by then.
        self._connectors = [
            (
                skill,
                skill.precondition.requires.bits & structure.situation,
                skill.precondition.forbids.bits & structure.situation,
            )
            for skill in structure.connectors
        ]
        self._passable: dict[str, list[tuple[int, int, bool]]] = {}
        self._edges: dict[int, list[tuple[float, int, str]]] = {}
        self._rows: dict[int, NDArray[np.float64]] = {}
        self._tables: dict[tuple[int, int], NDArray[np.float64]] = {}
        self._tails: dict[tuple[int, int], float] = {}
        self._begun_in: list[int] = [-1] * len(structure.jobs)
        self.paths: dict[tuple[int, int], tuple[str, ...]] = {}
        self._groups = self._grouped()

    def matrix(self) -> NDArray[np.float64]:
        """Return the costs from the start (row 0) and from each job, shape (n + 1, n).

        They are inf if a job cannot follow another directly.
        """
        structure = self._structure
        n = len(structure.jobs)
        matrix_costs = np.full((n + 1, n), math.inf)
        initial = structure.task.initial.bits & structure.situation
        taken: dict[int, tuple[NDArray[np.float64], list[tuple[str, ...]]]] = {}
        for source, situation in enumerate([initial, *(job.after for job in structure.jobs)]):
            if situation not in taken:
                taken[situation] = self._from(situation)
            costs, paths = taken[situation]
            matrix_costs[source] = costs
            if source:
                matrix_costs[source, source - 1] = math.inf
            for job, path in enumerate(paths):
                if path and math.isfinite(matrix_costs[source, job]):
                    self.paths[source - 1, job] = path
        return matrix_costs

    def begun_in(self, job: int) -> int:
        """Return the bits of the cheapest situation in which a job can start.

        Raises
        ------
        NotASequencing
            If no path leads to the job.
        """
        if self._begun_in[job] < 0:
            structure = self._structure
            start = self._facts.state(structure.task.initial.bits & structure.situation)
            raise structure.no(f"nothing leads to {structure.jobs[job].component} from {start}")
        return self._begun_in[job]

    def costs_from(self, situation: int) -> NDArray[np.float64]:
        """Return the costs of reaching and doing each job from a situation, shape (n,)."""
        return self._from(situation)[0]

    def stops_from(self, situation: int) -> list[tuple[float, int, tuple[str, ...]]]:
        """Return cost, situation and skills of all paths without a job."""
        return [(stop.cost, stop.situation, stop.path) for stop in self._stops(situation)]

    def _from(self, situation: int) -> tuple[NDArray[np.float64], list[tuple[str, ...]]]:
        """Return the costs of reaching and doing each job from a situation, and the paths."""
        stops = self._stops(situation)
        costs = np.stack([stop.cost + self.row(stop.situation) for stop in stops])
        # The first of equally expensive paths, which is the shortest.
        chosen = costs.argmin(axis=0)
        cost = costs[chosen, np.arange(len(chosen))]
        if -1 in self._begun_in:
            for job, position in enumerate(chosen.tolist()):
                if self._begun_in[job] < 0 and math.isfinite(cost[job]):
                    self._begun_in[job] = stops[position].situation
        return cost, [stops[position].path for position in chosen.tolist()] if chosen.any() else []

    def _stops(self, situation: int) -> list[_Stop]:
        """Return the situations that can be reached from one without a job, the cheapest first."""
        queue: list[tuple[float, int, int, tuple[str, ...]]] = [(0.0, 0, situation, ())]
        met: dict[int, _Stop] = {}
        pushed = 0
        while queue:
            cost, _, here, path = heapq.heappop(queue)
            if here in met:
                continue
            if len(met) >= _MOST_SITUATIONS:
                raise self._structure.no(f"more than {_MOST_SITUATIONS} situations between jobs")
            met[here] = _Stop(cost, here, path)
            for more, following, name in self.steps_from(here):
                if following not in met:
                    pushed += 1
                    heapq.heappush(queue, (cost + more, pushed, following, (*path, name)))
        return list(met.values())

    def list_ways(self, situation: int, job: int) -> Iterator[tuple[float, tuple[str, ...]]]:
        """Yield cost and skills of all paths to a job and through it, the cheapest first.

        Raises
        ------
        Undecided
            If there are too many paths.
        """
        queue = [(0.0, 0, situation, tuple[str, ...](), frozenset((situation,)))]
        ways, pushed = list[tuple[float, int, tuple[str, ...]]](), 0
        while queue or ways:
            if ways and (not queue or ways[0][0] <= queue[0][0]):
                cost, _, path = heapq.heappop(ways)
                yield cost, path
                continue
            cost, _, here, path, met = heapq.heappop(queue)
            if pushed > _MOST_SITUATIONS:
                raise Undecided
            pushed += 1
            total = cost + float(self.row(here)[job])
            if math.isfinite(total):
                heapq.heappush(ways, (total, pushed, path))
            for more, following, name in self.steps_from(here):
                if following not in met:
                    pushed += 1
                    step = (cost + more, pushed, following, (*path, name), met | {following})
                    heapq.heappush(queue, step)

    def steps_from(self, situation: int) -> list[tuple[float, int, str]]:
        """Return cost, next situation and name of each possible skill between jobs."""
        if situation not in self._edges:
            edges = []
            for skill, needs, bars in self._connectors:
                if situation & needs == needs and not situation & bars:
                    cost = self._cost_of(skill, self._facts.state(situation))
                    if math.isfinite(cost) and (self._relaxed or self._passes(skill, situation)):
                        following = self.following(skill, situation)
                        edges.append((cost, following, skill.name))
            self._edges[situation] = edges
        return self._edges[situation]

    def _passes(self, skill: Skill, situation: int) -> bool:
        """Return whether a skill between jobs is feasible in a situation, for any set of done jobs.

        Every job that a verdict rests on is checked both done and not done.
        """
        kept = self._passable.setdefault(skill.name, [])
        for basis, value, passes in kept:
            if situation & basis == value:
                return passes
        gate = self._structure.gates.get(skill.name, Gate(0, 0))
        first = self._verdict(skill, situation, gate.earlier)
        open_sets, queries, basis = [(first, gate.earlier, gate.later)], 1, 0
        while open_sets:
            verdict, done, never = open_sets.pop()
            assert verdict.present is not None
            assert verdict.absent is not None
            if verdict.status is not first.status:
                facts = ", ".join(verdict.facts)
                raise self._structure.no(f"{skill.name} depends on what has been done: {facts}")
            basis |= (verdict.present.bits | verdict.absent.bits) & self._structure.situation
            for other in iterate_bits(self._sets.named(verdict) & ~(done | never)):
                queries += 1
                more = self._verdict(skill, situation, done | other)
                open_sets.append((more, done | other, never))
                never |= other
            if queries > _MOST_QUERIES:
                raise self._structure.no(f"what {skill.name} depends on could not be worked out")
        kept.append((basis, situation & basis, first.is_feasible))
        return first.is_feasible

    def _verdict(self, skill: Skill, situation: int, done: int) -> Verdict:
        state = self._facts.state(situation | self._sets.state_bits(done))
        verdict = self._model.verdict(state, skill)
        if verdict.status is VerdictStatus.UNKNOWN:
            raise self._structure.no(f"whether {skill.name} is feasible is unknown")
        return verdict

    def _grouped(self) -> list[_Group]:
        """Return the jobs grouped by the situations in which they can start."""
        groups: dict[tuple[int, int], _Group] = {}
        for i, job in enumerate(self._structure.jobs):
            needs = job.chain[0].precondition.requires.bits & self._structure.situation
            bars = job.chain[0].precondition.forbids.bits & self._structure.situation
            group = groups.setdefault((needs, bars), _Group(needs, bars, [], {}))
            cost = job.chain[0].cost
            if isinstance(cost, TableCost) and len(job.chain) == 1 and not self._bounds:
                group.tables.setdefault(cost.places.bits, []).append(i)
            else:
                group.jobs.append(i)
        return list(groups.values())

    def row(self, situation: int) -> NDArray[np.float64]:
        """Return the cost of each job from a situation, inf if it cannot start there."""
        row_costs = self._rows.get(situation)
        if row_costs is None:
            state = self._facts.state(situation)
            row_costs = np.full(len(self._structure.jobs), math.inf)
            for group in self._groups:
                if situation & group.needs == group.needs and not situation & group.bars:
                    for job in group.jobs:
                        row_costs[job] = self._cost(job, state)
                    for places, jobs in group.tables.items():
                        row_costs[jobs] = self._column(places, jobs, situation)
            self._rows[situation] = row_costs
        return row_costs

    def _column(self, places: int, jobs: list[int], situation: int) -> NDArray[np.float64]:
        """Return the costs of single-skill jobs from the present place, by their tables."""
        key = (places, jobs[0])
        if key not in self._tables:
            costs = [self._structure.jobs[job].chain[0].cost for job in jobs]
            rows = [cost.values for cost in costs if isinstance(cost, TableCost)]
            table = np.array(rows, dtype=np.float64)
            self._tables[key] = np.where(table == NEVER, math.inf, table)
        here = situation & places
        if not here or here & (here - 1):
            return np.full(len(jobs), math.inf)
        return self._tables[key][:, here.bit_length() - (places & -places).bit_length()]

    def _cost(self, job: int, state: State) -> float:
        """Return the cost of a job from its first state, inf for a dead end."""
        chain = self._structure.jobs[job].chain
        cost = self._cost_of(chain[0], state)
        if len(chain) == 1:
            return cost
        situation = self.following(chain[0], state.bits)
        key = (job, situation)
        if key not in self._tails:
            self._tails[key] = self.tail(chain[1:], situation)
        return cost + self._tails[key]

    def tail(self, skills: tuple[Skill, ...], situation: int) -> float:
        """Return the cost of the last skills of a job from a situation, inf for a dead end."""
        cost = 0.0
        for skill in skills:
            needs = skill.precondition.requires.bits & self._structure.situation
            bars = skill.precondition.forbids.bits & self._structure.situation
            if situation & needs != needs or situation & bars:
                return math.inf
            cost += self._cost_of(skill, self._facts.state(situation))
            situation = self.following(skill, situation)
        return cost

    def _cost_of(self, skill: Skill, state: State) -> float:
        try:
            cost = skill.cost.at(state)
        except ValueError as error:
            why = str(error).rstrip(".")
            raise self._structure.no(f"the cost of {skill.name} is unknown: {why}") from None
        if self._bounds:
            lacks = self._structure.situation & ~state.bits
            return self._model.least_cost(skill, state.bits, lacks)
        return cost

    def following(self, skill: Skill, situation: int) -> int:
        """Return the bits of the situation after a skill."""
        outcome = skill.prediction
        kept = situation & ~outcome.delete.bits
        return kept | outcome.add.bits & self._structure.situation


_Path = tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Step:
    """The next step after a path: a skill between jobs, or a job, which ends the path.

    Parameters
    ----------
    cost, situation, path
        Cost of the path, bits of the situation it reaches, and its skills.
    skill
        The skill between jobs; empty for a job.
    job
        The job; -1 for a skill between jobs.
    priced
        True if `cost` includes the exact cost of the step instead of a lower bound.
    """

    cost: float
    situation: int
    path: _Path
    skill: str = ""
    job: int = -1
    priced: bool = False


class PricedConnections:
    """Least costs of reaching and doing each job, if back ends compute costs.

    Parameters
    ----------
    model
        The model, queried for costs.
    bounds
        Lower bounds on the costs.
    needed
        True if each connection is needed, shape (n + 1, n); row 0 is the start.

    Attributes
    ----------
    costs
        Costs from the start (row 0) and from each job, shape (n + 1, n); inf if a job cannot follow
        another directly, or the connection is not needed.
    paths
        Skills from a job, or the start (-1), to a job; pairs without skills are left out.
    """

    def __init__(
        self,
        model: SkillModel,
        structure: ComponentJobs,
        bounds: JobConnections,
        needed: NDArray[np.bool_],
    ) -> None:
        self._model = model
        self._structure = structure
        self._bounds = bounds
        self._skills = {skill.name: skill for skill in structure.connectors}
        self._kept: dict[tuple[str, int], float] = {}
        self.costs = np.full(needed.shape, math.inf)
        self.paths: dict[tuple[int, int], _Path] = {}
        initial = structure.task.initial.bits & structure.situation
        for source, situation in enumerate([initial, *(job.after for job in structure.jobs)]):
            needed_jobs = set(np.flatnonzero(needed[source]).tolist()) - {source - 1}
            for job, (cost, path) in self._cheapest(situation, needed_jobs).items():
                self.costs[source, job] = cost
                if path:
                    self.paths[source - 1, job] = path

    def _cheapest(self, situation: int, needed: set[int]) -> dict[int, tuple[float, _Path]]:
        """Return the least cost and path from a situation to each needed job that it can reach."""
        settled: dict[int, tuple[float, _Path]] = {}
        met = {situation}
        waiting = self._steps(_Step(0.0, situation, ()), needed)
        # The first of equally expensive paths, which is the shortest.
        queue = [(cost, number, step) for number, (cost, step) in enumerate(waiting)]
        heapq.heapify(queue)
        pushed = len(queue)
        while queue and len(settled) < len(needed):
            cost, _, step = heapq.heappop(queue)
            after = -1 if step.job >= 0 else self._after(step)
            if step.job in settled or after in met:
                continue
            if not step.priced:
                more = [(step.cost + self._price(step), _priced(step))]
            elif step.job >= 0:
                settled[step.job] = cost, step.path
                continue
            else:
                met.add(after)
                here = _Step(cost, after, (*step.path, step.skill))
                more = self._steps(here, needed - set(settled))
            for total, following in more:
                if math.isfinite(total):
                    pushed += 1
                    heapq.heappush(queue, (total, pushed, following))
        return settled

    def _steps(self, here: _Step, needed: set[int]) -> list[tuple[float, _Step]]:
        """Return the possible next steps, each with a lower bound on the cost of the whole path."""
        row = self._bounds.row(here.situation)
        steps = [
            (here.cost + float(row[job]), _Step(here.cost, here.situation, here.path, job=job))
            for job in sorted(needed)
            if math.isfinite(row[job])
        ]
        for bound, _, name in self._bounds.steps_from(here.situation):
            steps.append((here.cost + bound, _Step(here.cost, here.situation, here.path, name)))
        return steps

    def _after(self, step: _Step) -> int:
        return self._bounds.following(self._skills[step.skill], step.situation)

    def _price(self, step: _Step) -> float:
        if step.job < 0:
            return self._cost(self._skills[step.skill], step.situation)
        situation, costs = step.situation, []
        for skill in self._structure.jobs[step.job].chain:
            costs.append(self._cost(skill, situation))
            situation = self._bounds.following(skill, situation)
        return sum(costs)

    def _cost(self, skill: Skill, situation: int) -> float:
        key = (skill.name, situation)
        if key not in self._kept:
            state = self._structure.task.facts.state(situation)
            self._kept[key] = self._model.cost(state, skill)
        return self._kept[key]


def find_needed_connections(
    jobs: int, all_before: Mapping[int, int], all_after: Mapping[int, int]
) -> NDArray[np.bool_]:
    """Return whether each job may directly follow each other, shape (n + 1, n); row 0 is the start.

    Parameters
    ----------
    all_before, all_after
        Predecessors and successors of the jobs that every plan does, direct and indirect, as bits.
        If there are other jobs, all connections are needed.
    """
    if len(all_before) < jobs:
        return np.ones((jobs + 1, jobs), dtype=np.bool_)
    needed = np.zeros((jobs + 1, jobs), dtype=np.bool_)
    for job, before in all_before.items():
        needed[0, job] = not before
        for other in all_before:
            earlier = other == job or all_after[job] >> other & 1
            needed[1 + other, job] = not (earlier or before & all_after[other])
    return needed


def _priced(step: _Step) -> _Step:
    return _Step(step.cost, step.situation, step.path, step.skill, step.job, priced=True)
