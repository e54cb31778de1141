"""The chain of checks behind a verdict: cheapest first, and the first that fails names itself."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

from skillplan.checks.deciding import Link, deciding
from skillplan.checks.execution_times import ExecutionTimes
from skillplan.checks.parallel.query_batch import QueryBatch
from skillplan.checks.precondition import PRECONDITION, inapplicable
from skillplan.checks.reuse_sample import ReuseSample
from skillplan.checks.single_check import (
    Checked,
    CheckRequest,
    IntroducedBackEnds,
    check,
    introduce,
)
from skillplan.checks.verdict_cache import VerdictCache
from skillplan.checks.way_choice import Prices, choosing
from skillplan.checks.way_verdict import WAYS
from skillplan.checks.ways import Ways
from skillplan.task.back_end import BackEnd
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict
from skillplan.workers.executor import MakeExecutor

if TYPE_CHECKING:
    from skillplan.checks.parallel.check_workers import CheckWorkers
    from skillplan.checks.parallel.foresight import Foresight, Likely


@dataclass(frozen=True, slots=True)
class CheckCount:
    """How far the checks have come, for people who wait.

    Parameters
    ----------
    checks
        Queries for which at least one back end had to work.
    hits
        Queries answered from kept verdicts alone.
    to_go
        Queries of the current batch that are not answered yet.
    """

    checks: int
    hits: int
    to_go: int


def introduced(back_ends: Iterable[BackEnd]) -> IntroducedBackEnds:
    """Return back ends that know of each other, the cheapest first; the same ones if they do.

    Raises
    ------
    BackEndError
        If a back end does not get on with those beside it.
    """
    if isinstance(back_ends, IntroducedBackEnds):
        return back_ends
    return introduce(sorted(back_ends, key=lambda back_end: back_end.expected_s))


class Feasibility:
    """Decides about skills by querying back ends, each only for what is not known yet.

    Parameters
    ----------
    task
        The task whose skills are checked.
    back_ends
        Queried in ascending order of their `expected_s`.
    cache
        Where verdicts are kept; a fresh one in memory by default.
    jobs
        From 2 on, expensive back ends check in so many processes at once. Neither verdicts nor
        what is counted depends on it.
    make_executor
        Where those processes are; with one even a single job is done there. None for this
        machine.
    on_check
        Called before and after every query that an expensive back end has to work for.

    Attributes
    ----------
    checks
        Queries for which at least one back end had to work.
    hits
        Queries answered from kept verdicts alone.
    executions
        Queries for which an expensive back end had to work; any back end where none is expensive.
    reached
        Queries that reached such a back end, including those whose verdict was known.
    reused
        Some of the verdicts that were reused.
    queried
        How often each back end was queried.
    ways
        Of skills that have several.
    times
        How long skills take, as back ends tell.
    foresight
        What other processes checked ahead; None where all is checked in this one.

    Raises
    ------
    ValueError
        If `jobs` is below 1.
    BackEndError
        If a back end does not get on with those beside it.
    """

    def __init__(
        self,
        task: Task,
        back_ends: Iterable[BackEnd] = (),
        cache: VerdictCache | None = None,
        *,
        jobs: int = 1,
        make_executor: MakeExecutor | None = None,
        on_check: Callable[[CheckCount], None] | None = None,
    ) -> None:
        if jobs < 1:
            raise ValueError(f"There must be at least one process, not {jobs}.")
        self.task = task
        self.back_ends = introduced(back_ends)
        self.cache = VerdictCache() if cache is None else cache
        self.checks = 0
        self.hits = 0
        self.reused = ReuseSample()
        self.executions = 0
        self.reached = 0
        self.ways = Ways(task)
        self.queried: Counter[str] = Counter({back_end.name: 0 for back_end in self.back_ends})
        self._to_go = 0
        expensive = any(back_end.expensive for back_end in self.back_ends)
        self._on_check = on_check if expensive else None
        self._workers: CheckWorkers | None = None
        self.make_executor = make_executor
        apart = expensive and (jobs > 1 or make_executor is not None)
        if apart:
            # Here and not above: whoever needs no processes must not pay for importing this.
            from skillplan.checks.parallel.check_workers import CheckWorkers
            from skillplan.checks.parallel.foresight import Foresight

            executor = None if make_executor is None else make_executor(jobs)
            self._workers = CheckWorkers(task, self.back_ends, jobs, executor)
        self._chain = tuple(
            Link(index, one, one.expensive or not expensive, one.expensive and apart)
            for index, one in enumerate(self.back_ends)
        )
        self.foresight: Foresight | None = None
        if apart:
            self.foresight = Foresight(self._chain, self.cache, self.ways)
        self.times = ExecutionTimes(task, self.back_ends, self.ways)
        timed = task.metric.is_duration and bool(self.times.sources)
        self._prices = Prices(self._price, self.times.basis) if timed else None

    def verdict(
        self,
        skill: Skill,
        state: State,
        poll: Callable[[], None] = lambda: None,
        likely: Likely | None = None,
    ) -> Verdict:
        """Return the verdict on `skill` in `state`.

        Parameters
        ----------
        skill, state
            What is queried.
        poll
            Called now and then while another process checks; what it raises ends the check.
        likely
            Begins to yield what is likely to be queried next. Processes that have nothing to do
            meanwhile check that ahead.

        Raises
        ------
        BackEndError
            If a back end raises, or returns something else than a verdict.
        """
        if self._workers is not None:
            return self.verdicts([(skill, state)], poll, likely)[0]
        self._to_go = 1
        return _result_of(self._checking(skill, state))

    def verdicts(
        self,
        queries: Sequence[tuple[Skill, State]],
        poll: Callable[[], None] = lambda: None,
        likely: Likely | None = None,
    ) -> list[Verdict]:
        """Return the verdicts on several skills in states, in order.

        The same verdicts, and as many checks, as from querying one after the other: of one skill
        only one query runs at a time, as its verdict may answer the others.

        Parameters
        ----------
        queries
            Pairs of skill and state.
        poll
            Called now and then; what it raises ends the checks.
        likely
            As in `verdict`.

        Raises
        ------
        BackEndError
            If a back end raises, or returns something else than a verdict: of the first query
            for which one does.
        SkillplanError
            If processes cannot be started.
        """
        self._to_go = len(queries)
        if self._workers is None:
            verdicts = []
            for skill, state in queries:
                poll()
                verdicts.append(_result_of(self._checking(skill, state)))
            return verdicts
        batch = QueryBatch(self._checking, queries, self.ways.lane)
        if self.foresight is not None and likely is not None:
            self.foresight.expect(batch.asks, likely)
        self._workers.hold(batch.lanes, poll, self.foresight)
        return batch.verdicts()

    def stages(self, skill: Skill, state: State) -> list[Verdict]:
        """Return the verdict of every stage, also beyond the first that fails."""
        if not skill.applicable(state):
            return [inapplicable(self.task, skill, state)]
        condition = skill.condition(state)
        first = Verdict.feasible(condition.requires, condition.forbids)
        found = [first.grounded(state, PRECONDITION)]
        asked: Iterable[Skill] = (skill,)
        if skill.ways:
            verdict = self.verdict(skill, state)
            found.append(replace(verdict, stage=WAYS))
            every = [one.skill for one in self.ways.of(skill)]
            asked = [self._by(skill, verdict)] if verdict.is_feasible else every
        for one in asked:
            found += (self._query(back_end, one, state) for back_end in self.back_ends)
        return found

    def taken(self, skill: Skill, state: State) -> Skill:
        """Return a skill by the way that is taken in a state; itself where it has but one.

        The first way where none is granted.

        Raises
        ------
        BackEndError
            If a back end fails.
        """
        return self._by(skill, self.verdict(skill, state)) if skill.ways else skill

    def _price(self, skill: Skill, state: State) -> float:
        """Return what a skill by one of its ways costs where that is its time."""
        said_s = self.times.duration_s(skill, state)
        return math.inf if said_s is None else said_s

    def _by(self, skill: Skill, verdict: Verdict) -> Skill:
        label = verdict.evidence.get("way", skill.ways[0].label)
        return self.ways.variant(skill, str(label))

    @property
    def screens(self) -> tuple[BackEnd, ...]:
        """The back ends that are only there to rule something out."""
        return tuple(one for one in self.back_ends if one.screens)

    def close(self) -> None:
        """End the processes that were started; another query starts new ones."""
        if self._workers is not None:
            self._workers.close()

    def _checking(self, skill: Skill, state: State) -> Generator[CheckRequest, Checked, Verdict]:
        """Decide about a skill, yielding what is to be queried in another process."""
        if not skill.applicable(state):
            self._to_go -= 1
            return inapplicable(self.task, skill, state)
        tally = _Tally(self)
        if skill.ways:
            decide = partial(deciding, self._chain, tally)
            verdict = yield from choosing(self.ways, decide, skill, state, self._prices)
        else:
            verdict = yield from deciding(self._chain, tally, skill, state)
        self.checks += tally.worked
        self.hits += not tally.worked
        self.executions += tally.executed
        self.reached += tally.reached
        self._to_go -= 1
        if tally.executed:
            self.report()
        return verdict

    def _query(self, back_end: BackEnd, skill: Skill, state: State) -> Verdict:
        known = self.cache.find(back_end, skill, state)
        if known is not None:
            return known
        self.queried[back_end.name] += 1
        checked = check(back_end, skill, state)
        self.cache.keep(back_end, skill, checked, state)
        return checked.verdict

    def report(self) -> None:
        """Say to whoever waits how far the checks have come."""
        if self._on_check is not None:
            self._on_check(CheckCount(self.checks, self.hits, self._to_go))


class _Tally:
    """What it took to decide about a skill, by all ways of it that were looked at."""

    __slots__ = ("_of", "executed", "reached", "worked")

    def __init__(self, of: Feasibility) -> None:
        self._of = of
        self.worked = self.executed = self.reached = False

    def known(self, link: Link, skill: Skill, state: State) -> Verdict | None:
        """Return what is kept of a back end that holds in a state, and note its use."""
        self.reached = self.reached or link.counts
        verdict = self._of.cache.find(link.back_end, skill, state)
        if verdict is not None:
            self._of.reused.note(link.number, skill, state, verdict)
        return verdict

    def begin(self, link: Link) -> None:
        """Count a query of a back end."""
        self.worked = True
        if link.counts and not self.executed:
            self.executed = True
            self._of.report()
        self._of.queried[link.back_end.name] += 1

    def foretold(self, link: Link, skill: Skill, state: State) -> Checked | None:
        """Return what was said when this was checked ahead, or None."""
        foresight = self._of.foresight
        return None if foresight is None else foresight.take(link, skill, state)

    def keep(self, link: Link, skill: Skill, state: State, checked: Checked) -> None:
        """Keep what was said."""
        self._of.cache.keep(link.back_end, skill, checked, state)


def _result_of(checking: Generator[CheckRequest, Checked, Verdict]) -> Verdict:
    """Return what a check comes to that needs nobody in another process."""
    try:
        next(checking)
    except StopIteration as end:
        verdict: Verdict = end.value
        return verdict
    raise AssertionError("nobody is there to answer")
