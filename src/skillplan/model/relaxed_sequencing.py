"""Sequencing problems of models in which not every order is a plan.

The path of the arm from one job to the next may be blocked, which depends on the parts in place.
Such a model is relaxed: every plan is an order, and the cheapest order costs no more than the best
plan. An order that is no plan has conflicts, each of which every plan avoids in one of few ways.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace

from skillplan.chart.precedence_query import Undecided
from skillplan.chart.whole_order import find_order
from skillplan.errors import NotASequencing
from skillplan.model.component_jobs import ComponentJobs, DoneSets, list_members
from skillplan.model.fact_analysis import iterate_bits
from skillplan.model.job_connections import JobConnections
from skillplan.model.replay import replay
from skillplan.model.sequencing import SequencingProblem, assemble
from skillplan.model.skill_model import SkillModel
from skillplan.task.skill import Skill
from skillplan.task.verdict import Verdict, VerdictStatus

# Greatest number of paths between two jobs that are tried one after the other.
_MOST_WAYS = 32

# Source (-1 for the start) and target of a connection.
Arc = tuple[int, int]
# Two jobs, the first before the second.
Pair = tuple[int, int]


@dataclass(frozen=True, slots=True)
class Conflict:
    """Why an order is no plan.

    Parameters
    ----------
    pairs
        Pairs of jobs, one of which is in this order in every plan that has no detour.
    arc, way
        Connection, and the number of its path, which a plan may avoid by a detour instead; None if
        the path does not matter.
    is_whole
        False if a plan may avoid the conflict in another way, too.
    """

    pairs: tuple[Pair, ...]
    arc: Arc | None = None
    way: int = 0
    is_whole: bool = True


_UNKNOWN = Conflict((), is_whole=False)


class RelaxedSequencing:
    """The relaxed sequencing problem of a model.

    Attributes
    ----------
    problem
        Every plan is an order of it, and costs at least as much.

    Raises
    ------
    NotASequencing
        If the model does not have the structure; the message gives the reason.
    """

    def __init__(self, model: SkillModel) -> None:
        if model.asks_costs or model.task.pools:
            words = "its costs come from back ends" if model.asks_costs else "parts are alike"
            raise NotASequencing(f"{model.task.name!r} is not relaxed: {words}.")
        self._model = model
        self._structure = ComponentJobs(model.task)
        self._sets = DoneSets(self._structure)
        self._connections = JobConnections(model, self._structure, self._sets, relaxed=True)
        costs, paths = self._connections.matrix(), self._connections.paths
        before = self._list_demanded()
        self.problem = assemble(model.task, self._structure, before, costs, paths)
        self._chosen = sorted(before)
        self._index = {job: i for i, job in enumerate(self._chosen)}
        self._skills = {skill.name: skill for skill in model.task.skills}
        self._ways: dict[Arc, _Ways] = {}

    def _list_demanded(self) -> dict[int, int]:
        """Return the predecessors of each job that every plan does, by preconditions alone."""
        before: dict[int, int] = {}
        todo, later = [*self._structure.goal], list[tuple[int, int]]()
        while todo:
            job = todo.pop()
            if job in before:
                continue
            before[job], after = self._sets.demands(job)
            todo += list_members(before[job])
            later += [(job, other) for other in list_members(after)]
        for job, other in later:
            if other in before:
                before[other] |= 1 << job
        return before

    def find_plan(self, must_stop: Callable[[], bool]) -> tuple[float, tuple[str, ...]] | None:
        """Return cost and skills of a plan that is found part by part, or None."""
        task = self._model.task
        order = find_order(task, self._model.feasibility, (), {}, must_stop, may_drop=False)
        walked = replay(self._model, order.skills)
        if not (walked.feasible and walked.complete):
            return None
        return walked.cost, tuple(skill.name for skill in order.skills)

    def divert(self, refused: Mapping[Arc, Set[int]]) -> tuple[SequencingProblem, dict[Arc, int]]:
        """Return the problem without some paths, and the numbers of the paths that it takes.

        Parameters
        ----------
        refused
            Numbers of the paths that are not taken, by connection.

        Raises
        ------
        Undecided
            If there are too many paths.
        """
        first, costs = self.problem.first.copy(), self.problem.costs.copy()
        paths, taken = dict(self.problem.paths), dict[Arc, int]()
        for arc, numbers in refused.items():
            taken[arc] = number = next(n for n in range(len(numbers) + 1) if n not in numbers)
            if number > _MOST_WAYS:
                raise Undecided
            cost, path = self._find_way(arc, number)
            source, job = arc
            if source < 0:
                first[job] = cost
            else:
                costs[source, job] = cost
            paths.pop(arc, None)
            if path:
                paths[arc] = path
        return replace(self.problem, first=first, costs=costs, paths=paths), taken

    def find_conflicts(
        self,
        problem: SequencingProblem,
        taken: Mapping[Arc, int],
        order: Sequence[int],
        must_stop: Callable[[], bool],
    ) -> list[Conflict]:
        """Return why an order of a diverted problem is no plan; empty if it is one."""
        conflicts = list[Conflict]()
        state, before, done = self._model.initial, -1, 0
        for job in order:
            if must_stop():
                return [*conflicts, _UNKNOWN]
            arc, path = (before, job), problem.paths.get((before, job), ())
            for number, name in enumerate((*path, *problem.skills[job]), -len(path)):
                skill = self._skills[name]
                verdict = self._model.verdict(state, skill)
                if not verdict.is_feasible:
                    refusal = _Refusal(skill, state.bits, job, number, done)
                    conflicts.append(self._explain(refusal, verdict, arc, taken.get(arc, 0)))
                state = skill.prediction_in(state).apply(state)
            before, done = job, done | 1 << self._chosen[job]
        return conflicts

    def _explain(self, refusal: _Refusal, verdict: Verdict, arc: Arc, way: int) -> Conflict:
        """Return the conflict of a refused skill."""
        if verdict.status is VerdictStatus.UNKNOWN:
            return _UNKNOWN
        named, depends = self._reduce(refusal, verdict)
        if depends and len(self._chosen) < len(self._structure.jobs):
            # Another way to the job may lead through a job outside the goal.
            return _UNKNOWN
        pairs = []
        for other in list_members(named):
            if other not in self._index:
                return _UNKNOWN
            pair = (refusal.job, self._index[other])
            pairs.append(pair if refusal.done >> other & 1 else pair[::-1])
        return Conflict(tuple(pairs), arc, way) if depends else Conflict(tuple(pairs))

    def _reduce(self, refusal: _Refusal, verdict: Verdict) -> tuple[int, bool]:
        """Return few jobs that a refusal rests on, and whether it rests on the path.

        A back end tells the first obstacle that it meets, so its verdict rests on the absence of
        the obstacles before it. If the skill is refused with another job done, and without, both
        verdicts together do not rest on this job: their resolvent.
        """
        named, depends = self._list_named(refusal, verdict)
        changed = []
        for other in iterate_bits(named):
            change = self._structure.jobs[other.bit_length() - 1].change
            state = self._structure.task.facts.state(refusal.bits ^ change)
            also = self._model.verdict(state, refusal.skill)
            if also.status is VerdictStatus.INFEASIBLE:
                rest, also_depends = self._list_named(refusal, also)
                if also_depends <= depends:
                    changed.append((rest, other))
        # Obstacles met last rest on most jobs; a job that is left out early does not come back.
        changed.sort(key=lambda pair: -pair[0].bit_count())
        for rest, other in changed:
            fewer = (named | rest) & ~other if rest & other else rest
            if named & other and fewer.bit_count() < named.bit_count():
                named = fewer
        return named, depends

    def _list_named(self, refusal: _Refusal, verdict: Verdict) -> tuple[int, bool]:
        """Return the other jobs that a verdict rests on, and whether it rests on the path."""
        named = self._sets.named(verdict)
        if refusal.number < 0:
            return named, True
        own = self._chosen[refusal.job]
        depends = bool(self._structure.find_open_bits(own, refusal.number, verdict))
        return named & ~(1 << own), depends

    def _find_way(self, arc: Arc, number: int) -> tuple[float, tuple[str, ...]]:
        """Return the cost and the path of one of the ways to a job; inf if there are fewer."""
        ways = self._ways.get(arc)
        if ways is None:
            source, job = arc
            task, jobs = self._structure.task, self._structure.jobs
            initial = task.initial.bits & self._structure.situation
            situation = initial if source < 0 else jobs[self._chosen[source]].after
            listed = self._connections.list_ways(situation, self._chosen[job])
            ways = self._ways[arc] = _Ways(listed)
        while len(ways.known) <= number:
            ways.known.append(next(ways.listed, (math.inf, ())))
        return ways.known[number]


@dataclass(frozen=True, slots=True)
class _Refusal:
    """A refused skill.

    Parameters
    ----------
    bits
        Bits of the state.
    job, number
        The job, and the position of the skill in it; negative for one on the path to it.
    done
        Jobs that are done before, as a set.
    """

    skill: Skill
    bits: int
    job: int
    number: int
    done: int


@dataclass(slots=True)
class _Ways:
    """Costs and paths of a connection, the cheapest first, and the ones known so far."""

    listed: Iterator[tuple[float, tuple[str, ...]]]
    known: list[tuple[float, tuple[str, ...]]] = field(default_factory=list)
