"""Kept verdicts put to the test: queried anew in the states that they were made in."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass

from skillplan.checks.check_workers import CheckWorkers
from skillplan.checks.feasibility import Feasibility
from skillplan.checks.single_check import Checked, CheckRequest, check
from skillplan.checks.verdict_folder import KeptVerdict
from skillplan.errors import BackEndError
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
        Of status, reason, facts and evidence those that are not the same, bit for bit.
    """

    kept: KeptVerdict
    fresh: Verdict
    differs_in: tuple[str, ...]

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
    jobs: int = 1,
    stopped: Callable[[], bool] = lambda: False,
    on_trial: Callable[[], None] = lambda: None,
) -> list[Trial]:
    """Query fresh back ends in the states that kept verdicts were made in.

    Parameters
    ----------
    feasibility
        Its back ends are queried, in the order of the indices in `drawn`; none of its verdicts
        are used.
    drawn
        What to try.
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
    trials = [_Trying(task, index, kept, on_trial) for index, kept in drawn]
    if jobs > 1:

        def poll() -> None:
            if stopped():
                raise _Stopped

        with closing(CheckWorkers(task, back_ends, jobs)) as workers, suppress(_Stopped):
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


class _Stopped(Exception):
    """Raised where trying is given up."""


class _Trying:
    """One kept verdict, and the one check that is made of it."""

    def __init__(
        self, task: Task, index: int, kept: KeptVerdict, on_trial: Callable[[], None]
    ) -> None:
        record = kept.record
        self.kept = kept
        self.said = record.verdict(task.facts)
        state = task.facts.of(*record.state)
        self.request = CheckRequest(index, task.skills[task.action(record.skill)], state)
        self.outcome: Trial | None = None
        self.error: BackEndError | None = None
        self._on_trial = on_trial

    @property
    def wanted(self) -> bool:
        return True

    def go_on(self, said: Checked | None) -> CheckRequest | None:
        if said is None:
            return self.request
        self.outcome = Trial(self.kept, said.verdict, _differences(self.said, said.verdict))
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
