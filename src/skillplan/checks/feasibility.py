"""Feasibility of skills: a chain of back ends, the cheapest first, until one refuses.

Every answer is kept and reused, and back ends check only unknown queries.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce
from operator import or_
from typing import TYPE_CHECKING, NamedTuple

from skillplan.checks.audit import ReuseSample
from skillplan.checks.single_check import (
    Checked,
    bound_execution_time_s,
    can_time,
    check,
    introduce_back_ends,
    query_execution_time_s,
)
from skillplan.checks.variants import (
    VARIANTS,
    Prices,
    SkillVariants,
    Variant,
    VariantVerdicts,
    choose_variant,
)
from skillplan.checks.verdict_cache import VerdictCache
from skillplan.errors import BackEndError
from skillplan.task.back_end import BackEnd
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict, VerdictStatus
from skillplan.workers.executor import MakeExecutor

if TYPE_CHECKING:
    from skillplan.checks.check_workers import CheckWorkers, SteppedDecision
    from skillplan.checks.foresight import Foresight, Likely

PRECONDITION = "precondition"
"""Stage of a verdict on a skill that is not applicable."""

_MOST_NAMED_FACTS = 12
# Relative and absolute [s] rounding error of a time and its lower bound.
_ROUNDING = 1e-9


class Link(NamedTuple):
    """A back end of the chain.

    Parameters
    ----------
    number
        Its position, by which worker processes name it.
    counts
        True if its checks count as executions.
    in_worker
        True if a worker process checks.
    """

    number: int
    back_end: BackEnd
    counts: bool
    in_worker: bool


Ask = Callable[[Link, Skill, State], Verdict]
"""Returns the verdict of one back end on a skill with one motion, kept or fresh."""


def ask_chain(chain: tuple[Link, ...], ask: Ask, skill: Skill, state: State) -> Verdict:
    """Return the verdict of a chain of back ends on an applicable skill with one motion.

    Returns
    -------
    Verdict
        Infeasible by the first back end that refuses; else unknown by the first that cannot
        decide; else feasible. It rests on the facts that all of them name.
    """
    facts = state.facts
    condition = skill.condition(state)
    # A pick is also checked with its place, which may need a turn of the product first.
    bits = condition.requires.bits | condition.forbids.bits
    present, absent = bits & state.bits, bits & ~state.bits
    unknown: Verdict | None = None
    for link in chain:
        verdict = ask(link, skill, state)
        if verdict.status is VerdictStatus.INFEASIBLE:
            return verdict
        if verdict.status is VerdictStatus.UNKNOWN:
            unknown = unknown or verdict
        if verdict.present is not None and verdict.absent is not None:
            present |= verdict.present.bits
            absent |= verdict.absent.bits
    return unknown or Verdict.feasible(facts.state(present), facts.state(absent))


@dataclass(frozen=True, slots=True)
class CheckCount:
    """Progress of the checks.

    Parameters
    ----------
    checks
        Queries that made at least one back end check.
    hits
        Queries that kept verdicts answered.
    to_go
        Open queries of the current batch.
    """

    checks: int
    hits: int
    to_go: int


class Feasibility:
    """Decides whether skills are feasible, and keeps every verdict of a back end.

    Parameters
    ----------
    task
        The task whose skills are checked.
    back_ends
        Queried in ascending order of their `expected_s`.
    cache
        Kept verdicts; by default a new cache in memory.
    jobs
        Number of worker processes for expensive back ends, >= 1; 1 checks in this process.
        Verdicts and counts do not depend on it.
    make_executor
        Starts the workers; with one, even a single job runs in a worker. None for this machine.
    on_check
        Called before and after every query that an expensive back end checks.

    Attributes
    ----------
    checks
        Queries that made at least one back end check.
    hits
        Queries that kept verdicts answered.
    executions
        Queries that made an expensive back end check, or any back end if none is expensive.
    reached
        Queries that got as far as such a back end, known verdicts included.
    queried
        Number of checks by name of the back end.
    variants
        Variants of the skills that have several motions.
    foresight
        Checks that workers made ahead; None without workers.

    Raises
    ------
    ValueError
        If `jobs` is below 1.
    BackEndError
        If two back ends are incompatible.
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
        self.back_ends = introduce_back_ends(back_ends)
        self.screens = tuple(back_end for back_end in self.back_ends if back_end.screens)
        self.cache = VerdictCache() if cache is None else cache
        self.checks = 0
        self.hits = 0
        self.reused = ReuseSample()
        self.executions = 0
        self.reached = 0
        self.variants = SkillVariants(task)
        self.queried: Counter[str] = Counter({back_end.name: 0 for back_end in self.back_ends})
        self._to_go = 0
        expensive = any(back_end.expensive for back_end in self.back_ends)
        self._on_check = on_check if expensive else None
        self._workers: CheckWorkers | None = None
        self.make_executor = make_executor
        in_worker = expensive and (jobs > 1 or make_executor is not None)
        self._chain = tuple(
            Link(
                number,
                back_end,
                back_end.expensive or not expensive,
                back_end.expensive and in_worker,
            )
            for number, back_end in enumerate(self.back_ends)
        )
        self.foresight: Foresight | None = None
        if in_worker:
            # Imported here because searches without workers must start fast.
            from skillplan.checks.check_workers import CheckWorkers
            from skillplan.checks.foresight import Foresight

            executor = None if make_executor is None else make_executor(jobs)
            self._workers = CheckWorkers(task, self.back_ends, jobs, executor)
            self.foresight = Foresight(self._chain, self.cache, self.variants)
        self.times = ExecutionTimes(task, self.back_ends, self.variants)
        timed = task.metric.depends_on_time and bool(self.times.sources)
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
        poll
            Called several times a second while a worker checks; its exceptions end the check.
        likely
            Yields queries that may follow. Idle workers check them ahead.

        Raises
        ------
        BackEndError
            If a back end raises or does not return a verdict.
        """
        if self._workers is not None:
            return self.verdicts([(skill, state)], poll, likely)[0]
        self._to_go = 1
        return self._decide_here(skill, state)

    def verdicts(
        self,
        queries: Sequence[tuple[Skill, State]],
        poll: Callable[[], None] = lambda: None,
        likely: Likely | None = None,
    ) -> list[Verdict]:
        """Return the verdicts on pairs of skill and state, in order.

        Verdicts and counts equal those of sequential queries: queries about one skill
        run in sequence, because the verdict on the first may answer the rest.

        Raises
        ------
        BackEndError
            If a back end raises or does not return a verdict; the error of the first such query.
        SkillplanError
            If workers cannot be started.
        """
        self._to_go = len(queries)
        if self._workers is None:
            verdicts = []
            for skill, state in queries:
                poll()
                verdicts.append(self._decide_here(skill, state))
            return verdicts
        from skillplan.checks.check_workers import QueryBatch

        batch = QueryBatch(self._decide_in_steps, queries, self.variants.lane)
        if self.foresight is not None and likely is not None:
            self.foresight.expect(batch.is_open, likely)
        self._workers.run(batch.lanes, poll, self.foresight)
        return batch.verdicts()

    def refuse_early(self, skill: Skill, state: State) -> Verdict | None:
        """Return a refusal of an applicable skill if back ends find it early, else None.

        All variants of the skill are refused then.
        """
        verdicts = VariantVerdicts(skill, state)
        variants = self.variants.of(skill) or (Variant("", skill),)
        for variant in variants:
            refusals = (
                (back_end.refuse_early(variant.skill, state), back_end.name)
                for back_end in self.back_ends
            )
            refusal = next((pair for pair in refusals if pair[0] is not None), None)
            if refusal is None or refusal[0] is None:
                return None
            verdict = refusal[0].grounded(state, refusal[1])
            if not skill.ways:
                return verdict
            verdicts.note(variant.label, verdict)
        return verdicts.refuse()

    def stages(self, skill: Skill, state: State) -> list[Verdict]:
        """Return the verdict of every stage, also beyond the first that refuses."""
        if not skill.applicable(state):
            return [refuse_inapplicable(self.task, skill, state)]
        condition = skill.condition(state)
        first = Verdict.feasible(condition.requires, condition.forbids)
        verdicts = [first.grounded(state, PRECONDITION)]
        checked: Iterable[Skill] = (skill,)
        if skill.ways:
            verdict = self.verdict(skill, state)
            verdicts.append(replace(verdict, stage=VARIANTS))
            if verdict.is_feasible:
                checked = [self._chosen(skill, verdict)]
            else:
                checked = [variant.skill for variant in self.variants.of(skill)]
        for variant in checked:
            verdicts += (self._query(back_end, variant, state) for back_end in self.back_ends)
        return verdicts

    def taken(self, skill: Skill, state: State) -> Skill:
        """Return the variant of a skill that is executed in a state.

        The skill itself if it has one motion; its first variant if none is feasible.

        Raises
        ------
        BackEndError
            If a back end fails.
        """
        return self._chosen(skill, self.verdict(skill, state)) if skill.ways else skill

    def close(self) -> None:
        """End the workers; another query starts new ones."""
        if self._workers is not None:
            self._workers.close()

    def report(self) -> None:
        """Report progress to `on_check`."""
        if self._on_check is not None:
            self._on_check(CheckCount(self.checks, self.hits, self._to_go))

    def _decide_here(self, skill: Skill, state: State) -> Verdict:
        tally = Tally(self)
        return self._decide(skill, state, tally, tally.ask)

    def _decide_in_steps(self, skill: Skill, state: State) -> SteppedDecision:
        from skillplan.checks.check_workers import SteppedDecision

        tally = Tally(self)
        return SteppedDecision(tally, lambda ask: self._decide(skill, state, tally, ask))

    def _decide(self, skill: Skill, state: State, tally: Tally, ask: Ask) -> Verdict:
        """Return the verdict on a skill, and add the work for it to the counts."""
        if not skill.applicable(state):
            self._to_go -= 1
            return refuse_inapplicable(self.task, skill, state)
        decide = partial(ask_chain, self._chain, ask)
        if skill.ways:
            verdict = choose_variant(self.variants, decide, skill, state, self._prices)
        else:
            verdict = decide(skill, state)
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

    def _price(self, skill: Skill, state: State) -> float:
        """Return the execution time of a variant [s]; inf if no back end can time it."""
        duration_s = self.times.duration_s(skill, state)
        return math.inf if duration_s is None else duration_s

    def _chosen(self, skill: Skill, verdict: Verdict) -> Skill:
        label = verdict.evidence.get("way", skill.ways[0].label)
        return self.variants.by_label(skill, str(label))


class Tally:
    """Work of the back ends for one query, over all variants of its skill."""

    __slots__ = ("_feasibility", "executed", "reached", "worked")

    def __init__(self, feasibility: Feasibility) -> None:
        self._feasibility = feasibility
        self.worked = self.executed = self.reached = False

    def ask(self, link: Link, skill: Skill, state: State) -> Verdict:
        """Return the verdict of a back end, kept or from a check in this process."""
        verdict = self.known(link, skill, state)
        if verdict is None:
            self.begin(link)
            checked = check(link.back_end, skill, state)
            self.keep(link, skill, state, checked)
            verdict = checked.verdict
        return verdict

    def known(self, link: Link, skill: Skill, state: State) -> Verdict | None:
        """Return a kept verdict that applies, and note its reuse; None if there is none."""
        self.reached = self.reached or link.counts
        verdict = self._feasibility.cache.find(link.back_end, skill, state)
        if verdict is not None:
            self._feasibility.reused.note(link.number, skill, state, verdict)
        return verdict

    def begin(self, link: Link) -> None:
        """Count a check."""
        self.worked = True
        if link.counts and not self.executed:
            self.executed = True
            self._feasibility.report()
        self._feasibility.queried[link.back_end.name] += 1

    def checked_ahead(self, link: Link, skill: Skill, state: State) -> Checked | None:
        """Return the answer of a check that a worker made ahead, or None."""
        foresight = self._feasibility.foresight
        return None if foresight is None else foresight.take(link, skill, state)

    def keep(self, link: Link, skill: Skill, state: State, checked: Checked) -> None:
        """Keep an answer."""
        self._feasibility.cache.keep(link.back_end, skill, checked, state)


class ExecutionTimes:
    """Execution times of skills, queried once for every place of the robots and their tools.

    Parameters
    ----------
    task
        The task whose skills take time.
    back_ends
        The first that can time a skill counts. Screens are left out: a time must not depend on
        whether its skill was screened.

    Attributes
    ----------
    basis
        Bits of the facts that a time may depend on, without facts that choose a route.
    computed
        Number of times that back ends have returned; each is one trajectory.
    """

    def __init__(self, task: Task, back_ends: Iterable[BackEnd], variants: SkillVariants) -> None:
        self._variants = variants
        self._timers = tuple(
            back_end for back_end in back_ends if can_time(type(back_end)) and not back_end.screens
        )
        self.sources = tuple(back_end.name for back_end in self._timers)
        self.basis = _place_and_tool_bits(task) if self._timers else 0
        self.computed = 0
        self._all_bits = task.facts.all_bits
        self._durations_s: dict[tuple[str, int], float | None] = {}
        self._least_s: dict[tuple[str, int, int], float] = {}
        self._masks: dict[str, int] = {}

    def duration_s(self, skill: Skill, state: State) -> float | None:
        """Return the execution time of a skill [s], or None if no back end can time it.

        Parameters
        ----------
        skill
            A skill with one motion, or a variant.
        state
            Start of the skill.

        Raises
        ------
        BackEndError
            If a back end raises, or returns no time or one below its own lower bound.
        """
        key = (skill.name, state.bits & self.basis)
        if key not in self._durations_s:
            self._durations_s[key] = self._query(skill, state)
        return self._durations_s[key]

    def least_s(self, skill: Skill, true_bits: int, false_bits: int) -> float:
        """Return a lower bound on the execution time of a skill if some facts are known [s].

        It is inf if no back end can time the skill, and the least over all variants if the skill
        has several: which one is taken may depend on the state. No trajectory is computed.

        Raises
        ------
        BackEndError
            If a back end raises or returns no time.
        """
        if skill.ways:
            return min(
                self.least_s(variant.skill, true_bits, false_bits)
                for variant in self._variants.of(skill)
            )
        mask = self._masks.get(skill.name)
        if mask is None:
            # Facts that choose a route count, too; a skill names them in its own routes only.
            routes = () if skill.motion is None else skill.motion.routes
            mask = reduce(or_, (route.when.bits for route in routes), self.basis)
            self._masks[skill.name] = mask
        key = (skill.name, true_bits & mask, false_bits & mask)
        if key not in self._least_s:
            self._least_s[key] = min(
                (bound_execution_time_s(timer, skill, *key[1:]) for timer in self._timers),
                default=math.inf,
            )
        return self._least_s[key]

    def _query(self, skill: Skill, state: State) -> float | None:
        for back_end in self._timers:
            duration_s = query_execution_time_s(back_end, skill, state)
            if duration_s is None:
                continue
            self.computed += 1
            bits = state.bits
            least_s = bound_execution_time_s(back_end, skill, bits, self._all_bits & ~bits)
            if duration_s < least_s - _ROUNDING * max(1.0, duration_s):
                raise BackEndError(
                    f"Back end {back_end.name!r} says that {skill.name} takes {duration_s!r} s in "
                    f"{state}, and {least_s!r} s at least."
                )
            return duration_s
        return None


def refuse_inapplicable(task: Task, skill: Skill, state: State) -> Verdict:
    """Return the verdict on a skill that is not applicable in a state."""
    violated = skill.why_not(state)
    names = [*violated.requires, *(f"not {name}" for name in violated.forbids)]
    one_of = "one of " if len(violated.requires) > len(skill.condition(state).requires) else ""
    shown = names if len(names) <= _MOST_NAMED_FACTS else [*names[:_MOST_NAMED_FACTS], "..."]
    reason = f"needs {one_of}{', '.join(shown)}"
    places = [task.places[fact].name for fact in violated.forbids if fact in task.places]
    if len(places) == len(names):
        reason = f"cannot be done at {', '.join(places)}"
    return Verdict(
        VerdictStatus.INFEASIBLE,
        reason,
        PRECONDITION,
        violated.forbids,
        violated.requires,
        {"amiss": names},
    )


def _place_and_tool_bits(task: Task) -> int:
    """Return the bits of the facts that give the places of robots and the tools they hold."""
    names = {fact for robot in task.scene.robots for fact in robot.places}
    names |= {tool.fact for robot in task.scene.robots for tool in robot.tools}
    names |= set(task.places)
    bits = 0
    for name in names & set(task.facts.names):
        bits |= task.facts.bit(name)
    return bits
