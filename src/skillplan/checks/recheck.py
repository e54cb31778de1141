"""Kept verdicts put to the test: checked again in the states that they were made in."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass

from skillplan.checks.audit import contradiction, contradicts
from skillplan.checks.feasibility import Feasibility
from skillplan.checks.parallel.check_workers import CheckWorkers
from skillplan.checks.single_check import Checked, CheckRequest, check
from skillplan.checks.verdict_folder import KeptVerdict
from skillplan.checks.ways import asked_by_name
from skillplan.errors import BackEndError
from skillplan.task.back_end import BackEnd
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict


@dataclass(frozen=True)
class Trial:
    """A kept verdict beside a fresh one.

    Parameters
    ----------
    kept
        The verdict on disk.
    fresh
        What the back end says now.
    differs_in
        Of status, reason, facts and evidence those that are not the same, bit for bit; where it
        was checked in another state only the status counts.
    state
        Where the fresh one is from.
    """

    kept: KeptVerdict
    fresh: Verdict
    differs_in: tuple[str, ...]
    state: State

    @property
    def same(self) -> bool:
        """Whether nothing differs."""
        return not self.differs_in


def draw(
    kept: Sequence[Sequence[KeptVerdict]], sample: int, seed: int
) -> list[tuple[int, KeptVerdict]]:
    """Return a random sample of kept verdicts, each with the index of its back end, in order.

    Parameters
    ----------
    kept
        By back end.
    sample
        How many, >= 0; all where there are fewer.
    seed
        Governs the choice.
    """
    every = [(index, one) for index, own in enumerate(kept) for one in own]
    chosen = random.Random(seed).sample(range(len(every)), min(sample, len(every)))
    return [every[position] for position in sorted(chosen)]


def put_to_the_test(
    feasibility: Feasibility,
    drawn: Sequence[tuple[int, KeptVerdict]],
    *,
    elsewhere: Sequence[State] | None = None,
    jobs: int = 1,
    stopped: Callable[[], bool] = lambda: False,
    on_trial: Callable[[], None] = lambda: None,
) -> list[Trial]:
    """Check kept verdicts again, by fresh back ends in the states that they were made in.

    Parameters
    ----------
    feasibility
        Its back ends are queried, in the order of the indices in `drawn`; none of its verdicts
        are used.
    drawn
        What to try.
    elsewhere
        For each another state to which it claims to apply; None for those that they were made in.
    jobs
        How many processes, >= 1.
    stopped
        Whether to stop; what has been tried by then is returned.
    on_trial
        Called after each.

    Raises
    ------
    BackEndError
        If a back end fails.
    ValueError
        If a kept verdict is not of this task.
    """
    task, back_ends = feasibility.task, feasibility.back_ends
    states = elsewhere or [task.facts.of(*kept.record.state) for _, kept in drawn]
    trials = [
        _Trying(task, index, kept, state, on_trial)
        for (index, kept), state in zip(drawn, states, strict=True)
    ]
    make_executor = feasibility.make_executor
    if jobs > 1 or make_executor is not None:
        executor = None if make_executor is None else make_executor(jobs)

        def poll() -> None:
            if stopped():
                raise _Stopped

        with closing(CheckWorkers(task, back_ends, jobs, executor)) as workers, suppress(_Stopped):
            workers.hold(trials, poll)
    else:
        for trial in trials:
            if stopped():
                break
            request = trial.request
            trial.go_on(check(back_ends[request.back_end], request.skill, request.state))
    for trial in trials:
        if trial.error is not None:
            raise trial.error
    return [trial.outcome for trial in trials if trial.outcome is not None]


def other_states(
    task: Task, drawn: Sequence[tuple[int, KeptVerdict]], states: Sequence[State], seed: int
) -> tuple[list[tuple[int, KeptVerdict]], list[State]]:
    """Return those verdicts that claim to apply in another state, too, and one such for each.

    Parameters
    ----------
    task
        Whose verdicts.
    drawn
        Verdicts, each with the index of its back end.
    states
        That can be reached.
    seed
        Governs the choice of the state.
    """
    draw = random.Random(seed)
    chosen, others = [], []
    for index, kept in drawn:
        record = kept.record
        verdict, made_in = record.verdict(task.facts), task.facts.of(*record.state)
        skill = asked_by_name(task)[record.skill]
        fit = [
            state
            for state in states
            if state != made_in and verdict.applies_in(state) and skill.applicable(state)
        ]
        if fit:
            chosen.append((index, kept))
            others.append(draw.choice(fit))
    return chosen, others


def first_contradiction(back_ends: Sequence[BackEnd], trials: Sequence[Trial]) -> BackEndError:
    """Return the error that tells of the first kept verdict that does not hold elsewhere.

    Parameters
    ----------
    back_ends
        Those that were asked.
    trials
        At least one of them with another status than what is kept.
    """
    trial = next(trial for trial in trials if not trial.same)
    record = trial.kept.record
    back_end = next(one for one in back_ends if one.name == record.back_end)
    task = back_end.task
    return contradiction(
        back_end,
        asked_by_name(task)[record.skill],
        record.verdict(task.facts),
        task.facts.of(*record.state),
        trial.fresh,
        trial.state,
    )


class _Stopped(Exception):
    """Raised where trying is given up."""


class _Trying:
    """One kept verdict, and the one check that is made of it."""

    def __init__(
        self,
        task: Task,
        index: int,
        kept: KeptVerdict,
        state: State,
        on_trial: Callable[[], None],
    ) -> None:
        record = kept.record
        self.kept = kept
        self.said = record.verdict(task.facts)
        self._made_here = state == task.facts.of(*record.state)
        self.request = CheckRequest(index, asked_by_name(task)[record.skill], state)
        self.outcome: Trial | None = None
        self.error: BackEndError | None = None
        self._on_trial = on_trial

    @property
    def wanted(self) -> bool:
        return True

    def go_on(self, said: Checked | None) -> CheckRequest | None:
        if said is None:
            return self.request
        fresh = said.verdict
        if self._made_here:
            differs = _differences(self.said, fresh)
        else:
            differs = ("status",) if contradicts(self.said, fresh) else ()
        self.outcome = Trial(self.kept, fresh, differs, self.request.state)
        self._on_trial()
        return None

    def fail(self, error: BackEndError) -> None:
        self.error = error


def _differences(kept: Verdict, fresh: Verdict) -> tuple[str, ...]:
    pairs = {
        "status": (kept.status, fresh.status),
        "reason": (kept.reason, fresh.reason),
        "facts": (kept.facts, fresh.facts),
    }
    found = [name for name, (one, other) in pairs.items() if one != other]
    names = sorted({*kept.evidence, *fresh.evidence})
    found += [
        f"evidence: {name}"
        for name in names
        if (name in kept.evidence, repr(kept.evidence.get(name)))
        != (name in fresh.evidence, repr(fresh.evidence.get(name)))
    ]
    return tuple(found)
