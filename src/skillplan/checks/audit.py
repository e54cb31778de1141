"""Audit of verdicts: back ends check a sample of reused or kept verdicts again.

A verdict is reused in all states in which the facts it rests on are the same. If a back end names
too few facts, its verdict is also used in states in which it is wrong. A fresh check in such a
state gives the opposite answer, which proves the fault.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from skillplan.checks.single_check import Checked, CheckRequest, check
from skillplan.checks.variants import list_queried_skills, map_queried_skills
from skillplan.errors import BackEndError
from skillplan.task.back_end import BackEnd
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict, VerdictStatus

if TYPE_CHECKING:
    from skillplan.checks.feasibility import Feasibility
    from skillplan.checks.verdict_files import KeptVerdict

DEFAULT_AUDIT = 4
"""Number of reused verdicts that a search checks again by default."""
DEFAULT_REFUSED = 2
"""Number of refusals by screens that a search executes by default."""

_ROW_SIZE = 8
_MOST_UNUSED = 1_000
_MOST_STATES = 1_000
_MOST_WALKS = 200
_MOST_NAMED_FACTS = 12
# A back end that gives the same answer so often is taken to be deterministic.
_REPETITIONS = 3


@dataclass(frozen=True, slots=True)
class Reuse:
    """A kept verdict that was used instead of a check.

    Parameters
    ----------
    back_end
        Number of the back end in the chain.
    """

    back_end: int
    skill: Skill
    state: State
    verdict: Verdict


class ReuseSample:
    """A sample of the reuses: every n-th of each skill and back end.

    n doubles whenever a row is full, so noting a reuse costs next to nothing.
    """

    def __init__(self) -> None:
        self._most = _ROW_SIZE
        self._rows: dict[tuple[int, str], _Row] = {}

    def keep(self, count: int) -> None:
        """Make room to draw a number of reuses per skill and back end."""
        self._most = max(_ROW_SIZE, 2 * count)

    def note(self, back_end: int, skill: Skill, state: State, verdict: Verdict) -> None:
        """Note a reuse; for the parameters see `Reuse`."""
        key = (back_end, skill.name)
        row = self._rows.get(key)
        if row is None:
            row = self._rows[key] = _Row()
        row.count += 1
        if row.count == row.due:
            row.entries.append(Reuse(back_end, skill, state, verdict))
            if len(row.entries) >= self._most:
                row.entries = row.entries[::2]
                row.every *= 2
            row.due = row.count + row.every

    @property
    def count(self) -> int:
        """Number of reuses."""
        return sum(row.count for row in self._rows.values())

    def by_skill(self) -> list[list[Reuse]]:
        """Return the sample, one list per skill and back end."""
        # Copied first, because a search in another thread may add rows.
        return [list(row.entries) for row in list(self._rows.values())]


class _Row:
    __slots__ = ("count", "due", "entries", "every")

    def __init__(self) -> None:
        self.count = 0
        self.due = 1
        self.every = 1
        self.entries: list[Reuse] = []


@dataclass(frozen=True, slots=True)
class DrawnVerdict:
    """A verdict that was drawn for a check; another process may have made it.

    Parameters
    ----------
    back_end
        Number of the back end in the chain.
    skill
        Name of the skill, or of its variant.
    verdict
        Names the facts it rests on.
    made_in, used_in
        The states in which it was made and reused.
    """

    back_end: int
    skill: str
    verdict: Verdict
    made_in: State
    used_in: State


@dataclass(frozen=True, slots=True)
class SampleSize:
    """Size of a sample of verdicts.

    Parameters
    ----------
    reused
        Number of reused verdicts, >= 0.
    expensive
        True if verdicts of expensive back ends are drawn, too.
    """

    seed: int = 0
    reused: int = DEFAULT_AUDIT
    expensive: bool = False
    refused: int = DEFAULT_REFUSED

    @classmethod
    def of(cls, audit: int | None, seed: int) -> SampleSize:
        """Return the sample size for ``--audit``: a number of every kind, or the default."""
        return cls(seed) if audit is None else cls(seed, audit, True, audit)


@dataclass(frozen=True, slots=True)
class VerdictSample:
    """A sample of the verdicts of a search.

    Parameters
    ----------
    refusals
        Number of all refusals by screens.
    elsewhere
        True if another process made the verdicts.
    """

    reused: tuple[DrawnVerdict, ...] = ()
    refused: tuple[DrawnVerdict, ...] = ()
    refusals: int = 0
    elsewhere: bool = False


def draw_sample(feasibility: Feasibility, size: SampleSize) -> VerdictSample:
    """Return a sample of the verdicts that a finished search reused, and of its refusals."""
    reused = draw_reused(feasibility, size.reused, size.seed, expensive=size.expensive)
    refusals = [
        DrawnVerdict(number, skill.name, verdict, state, state)
        for number, screen in enumerate(feasibility.back_ends)
        if screen.screens
        for skill in list_queried_skills(feasibility.task)
        for verdict, state in feasibility.cache.made(screen, skill)
        if verdict.status is VerdictStatus.INFEASIBLE
    ]
    refused = random.Random(size.seed).sample(refusals, min(size.refused, len(refusals)))
    return VerdictSample(tuple(reused), tuple(refused), len(refusals))


def draw_reused(
    feasibility: Feasibility, size: int, seed: int, *, expensive: bool, going_on: bool = False
) -> list[DrawnVerdict]:
    """Return a sample of the reused verdicts, filled up with verdicts that were never reused.

    Parameters
    ----------
    size
        Number of verdicts, >= 0.
    expensive
        True if verdicts of expensive back ends are drawn, too.
    going_on
        True if another thread is still searching; then only reused verdicts are drawn.
    """
    if not size:
        return []
    generator = random.Random(seed)
    rows = [
        generator.sample(row, len(row))
        for row in feasibility.reused.by_skill()
        if expensive or not feasibility.back_ends[row[0].back_end].expensive
    ]
    generator.shuffle(rows)
    depth = max(map(len, rows), default=0)
    # One of every skill and back end, then another one of each.
    reuses = [row[level] for level in range(depth) for row in rows if level < len(row)]
    drawn = []
    for reuse in reuses[:size]:
        back_end = feasibility.back_ends[reuse.back_end]
        made_in = feasibility.cache.made_in(back_end, reuse.skill, reuse.verdict)
        made_in = reuse.state if made_in is None else made_in
        drawn.append(
            DrawnVerdict(reuse.back_end, reuse.skill.name, reuse.verdict, made_in, reuse.state)
        )
    if len(drawn) < size and not going_on:
        unused = list(_list_kept(feasibility, expensive=expensive))
        drawn += generator.sample(unused, min(size - len(drawn), len(unused)))
    return drawn


def _list_kept(feasibility: Feasibility, *, expensive: bool) -> Iterator[DrawnVerdict]:
    """Yield kept verdicts, as if they had been reused in the states they were made in."""
    left = _MOST_UNUSED
    for number, back_end in enumerate(feasibility.back_ends):
        if back_end.expensive and not expensive:
            continue
        for skill in list_queried_skills(feasibility.task):
            for verdict, state in feasibility.cache.made(back_end, skill):
                if not left:
                    return
                left -= 1
                yield DrawnVerdict(number, skill.name, verdict, state, state)


def ask_again(
    back_ends: Sequence[BackEnd], drawn: Sequence[DrawnVerdict], *, times: int = 1
) -> None:
    """Check drawn verdicts again, in the states in which they were made and reused.

    Parameters
    ----------
    times
        Number of checks per state, >= 1. More than one detects a back end whose first answer in
        this process differs from its later ones.

    Raises
    ------
    BackEndError
        If a back end contradicts itself or fails.
    """
    skills = map_queried_skills(back_ends[0].task) if drawn else {}
    for sample in drawn:
        back_end, skill = back_ends[sample.back_end], skills[sample.skill]
        for state in dict.fromkeys((sample.used_in, sample.made_in)):
            for _ in range(times):
                fresh = check(back_end, skill, state).verdict
                if _contradicts(sample.verdict, fresh):
                    raise _contradiction(
                        back_end, skill, sample.verdict, sample.made_in, fresh, state
                    )


@dataclass(frozen=True)
class Trial:
    """A kept verdict and a fresh one.

    Parameters
    ----------
    kept
        The verdict on disk.
    fresh
        The verdict of the back end now.
    differs_in
        Names of what differs bit for bit: status, reason, facts, evidence. Only the status
        counts in another state than that of the kept verdict.
    state
        State of the fresh check.
    """

    kept: KeptVerdict
    fresh: Verdict
    differs_in: tuple[str, ...]
    state: State

    @property
    def same(self) -> bool:
        """True if nothing differs."""
        return not self.differs_in


def draw_kept(
    kept: Sequence[Sequence[KeptVerdict]], size: int, seed: int
) -> list[tuple[int, KeptVerdict]]:
    """Return a random sample of kept verdicts, each with the number of its back end, in order.

    Parameters
    ----------
    kept
        By back end.
    size
        Size of the sample, >= 0; all if there are fewer.
    """
    numbered = [(number, verdict) for number, own in enumerate(kept) for verdict in own]
    chosen = random.Random(seed).sample(range(len(numbered)), min(size, len(numbered)))
    return [numbered[position] for position in sorted(chosen)]


def recheck_kept(
    feasibility: Feasibility,
    drawn: Sequence[tuple[int, KeptVerdict]],
    *,
    elsewhere: Sequence[State] | None = None,
    jobs: int = 1,
    stopped: Callable[[], bool] = lambda: False,
    on_trial: Callable[[], None] = lambda: None,
) -> list[Trial]:
    """Check kept verdicts again with fresh back ends.

    Parameters
    ----------
    feasibility
        Its back ends check; its cache is not used.
    drawn
        Verdicts, each with the number of its back end.
    elsewhere
        A state for each verdict; None for the states in which they were made.
    jobs
        Number of processes, >= 1.
    stopped
        Returns True to end early; the trials so far are returned.
    on_trial
        Called after each trial.

    Raises
    ------
    BackEndError
        If a back end fails.
    ValueError
        If a kept verdict belongs to another task.
    """
    task, back_ends = feasibility.task, feasibility.back_ends
    states = elsewhere or [task.facts.of(*kept.record.state) for _, kept in drawn]
    rechecks = [
        _Recheck(task, number, kept, state, on_trial)
        for (number, kept), state in zip(drawn, states, strict=True)
    ]
    make_executor = feasibility.make_executor
    if jobs > 1 or make_executor is not None:
        _run_in_workers(feasibility, rechecks, jobs, stopped)
    else:
        for recheck in rechecks:
            if stopped():
                break
            request = recheck.request
            recheck.advance(check(back_ends[request.back_end], request.skill, request.state))
    for recheck in rechecks:
        if recheck.error is not None:
            raise recheck.error
    return [recheck.trial for recheck in rechecks if recheck.trial is not None]


class _StoppedError(Exception):
    """Ends the checks of workers early."""


def _run_in_workers(
    feasibility: Feasibility, rechecks: list[_Recheck], jobs: int, stopped: Callable[[], bool]
) -> None:
    from contextlib import closing, suppress

    from skillplan.checks.check_workers import CheckWorkers

    def poll() -> None:
        if stopped():
            raise _StoppedError

    make_executor = feasibility.make_executor
    executor = None if make_executor is None else make_executor(jobs)
    workers = CheckWorkers(feasibility.task, feasibility.back_ends, jobs, executor)
    with closing(workers), suppress(_StoppedError):
        workers.run(rechecks, poll)


class _Recheck:
    """One fresh check of a kept verdict, as a conversation with workers."""

    is_needed = True

    def __init__(
        self, task: Task, number: int, kept: KeptVerdict, state: State, on_trial: Callable[[], None]
    ) -> None:
        record = kept.record
        self.kept = kept
        self.verdict = record.verdict(task.facts)
        self._same_state = state == task.facts.of(*record.state)
        self.request = CheckRequest(number, map_queried_skills(task)[record.skill], state)
        self.trial: Trial | None = None
        self.error: BackEndError | None = None
        self._on_trial = on_trial

    def advance(self, checked: Checked | None) -> CheckRequest | None:
        if checked is None:
            return self.request
        fresh = checked.verdict
        if self._same_state:
            differs = _list_differences(self.verdict, fresh)
        else:
            differs = ("status",) if _contradicts(self.verdict, fresh) else ()
        self.trial = Trial(self.kept, fresh, differs, self.request.state)
        self._on_trial()
        return None

    def fail(self, error: BackEndError) -> None:
        self.error = error


def _list_differences(kept: Verdict, fresh: Verdict) -> tuple[str, ...]:
    differences = [
        name
        for name in ("status", "reason", "facts")
        if getattr(kept, name) != getattr(fresh, name)
    ]
    differences += [
        f"evidence: {name}"
        for name in sorted({*kept.evidence, *fresh.evidence})
        if (name in kept.evidence, repr(kept.evidence.get(name)))
        != (name in fresh.evidence, repr(fresh.evidence.get(name)))
    ]
    return tuple(differences)


def sample_reachable_states(
    feasibility: Feasibility, seed: int, stopped: Callable[[], bool] = lambda: False
) -> list[State]:
    """Return reachable states from random walks, in the order of their discovery.

    Walks take only skills whose verdicts are known or cheap.

    Parameters
    ----------
    feasibility
        The checks; its cache knows the verdicts.
    stopped
        Returns True to end early; called at every step.
    """
    task, generator = feasibility.task, random.Random(seed)
    starts = [task.initial, *task.starts]
    states = dict.fromkeys(starts)
    for walk in range(_MOST_WALKS):
        state = starts[walk % len(starts)]
        for _ in range(task.step_limit):
            if stopped() or len(states) >= _MOST_STATES:
                return list(states)[:_MOST_STATES]
            skills = [skill for skill in task.skills if skill.applicable(state)]
            generator.shuffle(skills)
            skill = next(
                (skill for skill in skills if _is_known_feasible(feasibility, skill, state)), None
            )
            if skill is None or task.goal.holds(state):
                break
            outcomes = list(skill.outcomes_in(state))
            weights = [outcome.probability for outcome in outcomes]
            state = generator.choices(outcomes, weights)[0].apply(state)
            states[state] = None
    return list(states)


def _is_known_feasible(feasibility: Feasibility, skill: Skill, state: State) -> bool:
    def is_granted(back_end: BackEnd, variant: Skill) -> bool:
        verdict = feasibility.cache.find(back_end, variant, state)
        if verdict is None and not back_end.expensive:
            checked = check(back_end, variant, state)
            feasibility.cache.keep(back_end, variant, checked, state)
            verdict = checked.verdict
        return verdict is not None and verdict.is_feasible

    variants = [variant.skill for variant in feasibility.variants.of(skill)] or [skill]
    return any(
        all(is_granted(back_end, variant) for back_end in feasibility.back_ends)
        for variant in variants
    )


def choose_other_states(
    task: Task, drawn: Sequence[tuple[int, KeptVerdict]], states: Sequence[State], seed: int
) -> tuple[list[tuple[int, KeptVerdict]], list[State]]:
    """Return the verdicts that claim to apply in another state, and such a state for each.

    Parameters
    ----------
    drawn
        Verdicts, each with the number of its back end.
    """
    generator = random.Random(seed)
    skills = map_queried_skills(task)
    chosen, others = [], []
    for number, kept in drawn:
        record = kept.record
        verdict, made_in = record.verdict(task.facts), task.facts.of(*record.state)
        skill = skills[record.skill]
        candidates = [
            state
            for state in states
            if state != made_in and verdict.applies_in(state) and skill.applicable(state)
        ]
        if candidates:
            chosen.append((number, kept))
            others.append(generator.choice(candidates))
    return chosen, others


def explain_first_difference(back_ends: Sequence[BackEnd], trials: Sequence[Trial]) -> BackEndError:
    """Return the error about the first kept verdict that does not hold in another state.

    Parameters
    ----------
    trials
        Trials, at least one of which differs.
    """
    trial = next(trial for trial in trials if not trial.same)
    record = trial.kept.record
    back_end = next(back_end for back_end in back_ends if back_end.name == record.back_end)
    task = back_end.task
    return _contradiction(
        back_end,
        map_queried_skills(task)[record.skill],
        record.verdict(task.facts),
        task.facts.of(*record.state),
        trial.fresh,
        trial.state,
    )


def _contradicts(kept: Verdict, fresh: Verdict) -> bool:
    """Return whether two verdicts cannot both be right; unknown contradicts nothing."""
    return VerdictStatus.UNKNOWN not in (kept.status, fresh.status) and kept.status != fresh.status


def _contradiction(
    back_end: BackEnd, skill: Skill, kept: Verdict, made_in: State, fresh: Verdict, state: State
) -> BackEndError:
    """Return the error that describes how a back end contradicts itself.

    Parameters
    ----------
    back_end, skill
        The back end and the skill it checked.
    kept, made_in
        The kept verdict and its state.
    fresh, state
        The fresh verdict and its state, in which the facts are the same that `kept` rests on.
    """
    name = f"Back end {back_end.name!r}"
    for checked, verdict in ((made_in, kept), (state, fresh)):
        statuses = {check(back_end, skill, checked).verdict.status for _ in range(_REPETITIONS)}
        if statuses != {verdict.status}:
            now = next(status for status in sorted(statuses) if status != verdict.status)
            return BackEndError(
                f"{name} answers differently the second time: {skill.name} was {verdict.status}, "
                f"then {now}, both in {checked}. Its verdicts cannot be reused."
            )
    facts = ", ".join(kept.facts) or "no fact"
    missing = _name_missing_fact(back_end, skill, made_in, state, kept.status)
    return BackEndError(
        f"{name} contradicts itself about {skill.name}: {_describe(kept)} in {made_in}, resting on "
        f"{facts}, and {_describe(fresh)} in {state}, where the same holds. {missing}"
    )


def _describe(verdict: Verdict) -> str:
    return f"{verdict.status} ({verdict.reason})" if verdict.reason else str(verdict.status)


def _name_missing_fact(
    back_end: BackEnd, skill: Skill, made_in: State, state: State, status: VerdictStatus
) -> str:
    """Return a sentence that names the fact on which a verdict should have rested, too."""
    current, changed = made_in.bits, 0
    facts = back_end.task.facts
    for bits in _step_bits(back_end.task, made_in, state):
        current ^= bits
        changed |= bits
        between = facts.state(current)
        if not skill.applicable(between):
            continue
        try:
            fresh = check(back_end, skill, between).verdict.status
        except BackEndError:
            # A state on the way may be unreachable.
            continue
        if fresh not in (status, VerdictStatus.UNKNOWN):
            # Facts of one exclusive group each tell which of them holds.
            names = list(facts.state(changed))
            return (
                f"The first verdict should have named {' or '.join(names[:_MOST_NAMED_FACTS])}: "
                f"with {'that' if len(names) == 1 else 'those'} alone changed the answer is the "
                "other one."
            )
        if fresh is status:
            changed = 0
    names = list(facts.state(made_in.bits ^ state.bits))
    shown = names if len(names) <= _MOST_NAMED_FACTS else [*names[:_MOST_NAMED_FACTS], "..."]
    return (
        f"The first verdict should have named one of {', '.join(shown) or 'a fact'}, in which "
        "they differ."
    )


def _step_bits(task: Task, made_in: State, state: State) -> Iterator[int]:
    """Yield the bits that change on the way from one state to another, in the smallest steps.

    Facts that exclude each other change together.
    """
    left = made_in.bits ^ state.bits
    for group in task.facts.exclusive:
        together = left & sum(task.facts.bit(name) for name in group)
        if together:
            left &= ~together
            yield together
    while left:
        lowest = left & -left
        left ^= lowest
        yield lowest
