"""Who drives the groups of runs: this process one after another, or processes side by side.

What is learned depends on neither. A process that is ended is started once more from its
group's checkpoint; if that one is ended, too, the group's runs have failed, and the others go on.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

from skillplan.checks.verdict_cache import VerdictCache
from skillplan.errors import OptionError
from skillplan.training.group_job import GroupJob, GroupOutcome, GroupReport
from skillplan.training.group_service import (
    Ending,
    GroupAnswer,
    GroupFailure,
    Order,
    begun,
    over,
    serve,
    serve_sent,
)
from skillplan.training.group_training import kept_verdicts
from skillplan.training.sent_group import SentAnswer, SentGroup, put_in_place
from skillplan.workers.executor import Answer, Ended, Executor, Worker, packed
from skillplan.workers.local_processes import LocalProcesses

_WHAT = "the training"
_STARTS = 2
# What takes longer than this after a stop is given up: the checkpoint before counts.
GRACE_S = 1.5


def drive(
    jobs: Sequence[GroupJob],
    processes: int,
    stopped: Callable[[], bool],
    on_report: Callable[[GroupReport], None],
    cache: VerdictCache | None = None,
    executor: Executor | None = None,
) -> Iterator[Ending]:
    """Yield what became of every group as it ends.

    Once `stopped` is true every group that has a checkpoint hands over what it has learned until
    then; one that has not yet begun is passed over.

    Parameters
    ----------
    jobs
        The groups.
    processes
        How many processes, >= 1; with 1 this one does it all.
    stopped
        Whether to stop; called after every stride.
    on_report
        Called after every stride.
    cache
        Is given the verdicts of the groups that this process drives. Each of them keeps its own,
        as elsewhere, so that what is counted does not depend on where that is.
    executor
        Where the groups are driven instead; it has the number of processes, too.

    Raises
    ------
    OptionError
        If something cannot be written, or is damaged.
    SkillplanError
        If processes cannot be started.
    """
    if executor is None and processes > 1:
        executor = LocalProcesses(processes)
    endings = (
        _here(jobs, stopped, on_report, cache)
        if executor is None
        else _Elsewhere(jobs, executor, stopped, on_report).endings()
    )
    for group, ending in endings:
        if isinstance(ending, GroupFailure) and ending.fatal:
            raise OptionError(ending.reason)
        yield group, ending


def _here(
    jobs: Sequence[GroupJob],
    stopped: Callable[[], bool],
    on_report: Callable[[GroupReport], None],
    cache: VerdictCache | None,
) -> Iterator[Ending]:
    overdue = _Overdue(stopped)
    for job in jobs:
        if stopped() and not begun(job):
            continue
        own = kept_verdicts(job)
        work = serve(job, own, overdue)
        outcome: GroupAnswer | None = None
        while not stopped() and not over(outcome, job):
            outcome = work("advance")
            if isinstance(outcome, GroupReport):
                on_report(outcome)
        if not isinstance(outcome, GroupFailure):
            outcome = overdue.spared(work)
        elif outcome.stopped and begun(job):
            outcome = overdue.spared(serve(job, own))
        elif outcome.stopped:
            continue
        assert not isinstance(outcome, GroupReport)
        if cache is not None:
            cache.take_over(own)
        yield job.group, outcome


class _Overdue:
    """Whether a stop was requested long ago, but for what is spared."""

    def __init__(self, stopped: Callable[[], bool]) -> None:
        self._stopped = stopped
        self._requested_s: float | None = None
        self._spared = False

    def __call__(self) -> bool:
        if self._spared or not self._stopped():
            return False
        now_s = time.monotonic()
        if self._requested_s is None:
            self._requested_s = now_s
        return now_s > self._requested_s + GRACE_S

    def spared(self, work: Callable[[Order], GroupAnswer]) -> GroupAnswer:
        """Have a group conclude, however late it is."""
        self._spared = True
        try:
            return work("conclude")
        finally:
            self._spared = False


@dataclass
class _Assignment:
    """What a worker is at, and how often it was started for that."""

    job: GroupJob
    order: Order
    starts: int = 1


class _Elsewhere:
    """Drives groups in workers, one group a worker.

    Parameters
    ----------
    jobs
        The groups.
    executor
        Where the workers run.
    stopped, on_report
        As for `drive`.
    """

    def __init__(
        self,
        jobs: Sequence[GroupJob],
        executor: Executor,
        stopped: Callable[[], bool],
        on_report: Callable[[GroupReport], None],
    ) -> None:
        self._waiting = list(jobs)
        self._executor = executor
        self._stopped = stopped
        self._on_report = on_report
        self._busy: dict[Worker, _Assignment] = {}
        # What has a checkpoint, and after a stop no worker any more.
        self._left: list[GroupJob] = []
        self._stop_s: float | None = None

    def endings(self) -> Iterator[Ending]:
        """Yield what became of every group as it ends.

        After a stop no worker is started, and soon none is left; groups that have a checkpoint then
        hand over here what they have learned.
        """
        try:
            while self._busy or self._waiting:
                if self._stop_s is None and self._stopped():
                    self._stop_s = time.monotonic()
                    self._leave(self._waiting)
                    self._waiting = []
                while self._waiting and len(self._busy) < self._executor.slots:
                    self._start(self._waiting.pop(0), "advance")
                for worker in self._executor.first_ready(self._busy):
                    ending = self._attend(worker)
                    if ending is not None:
                        yield ending
                if self._stop_s is not None and time.monotonic() > self._stop_s + GRACE_S:
                    self._give_up()
        finally:
            self._executor.close()
        for job in self._left:
            outcome = serve(_alone(job))("conclude")
            assert not isinstance(outcome, GroupReport)
            yield job.group, outcome

    def _start(self, job: GroupJob, order: Order, starts: int = 1) -> None:
        if self._executor.shares_files:
            worker = self._executor.start(serve, packed(_alone(job), _WHAT), _WHAT)
        else:
            content = packed(SentGroup.of(_alone(job)), _WHAT)
            worker = self._executor.start(serve_sent, content, _WHAT)
        self._busy[worker] = _Assignment(job, order, starts)
        worker.take(order)

    def _attend(self, worker: Worker) -> Ending | None:
        """Take a worker's answer, and give it its next order; return what ended its group."""
        answer = worker.answer()
        if answer is None:
            return None
        assigned = self._busy[worker]
        outcome = answer.content if isinstance(answer, Answer) else None
        if isinstance(outcome, SentAnswer):
            put_in_place(assigned.job.folder, outcome.changes)
            outcome = outcome.outcome
        if isinstance(outcome, GroupReport):
            self._on_report(outcome)
            done = self._stop_s is not None or over(outcome, assigned.job)
            assigned.order = "conclude" if done else "advance"
            worker.take(assigned.order)
            return None
        del self._busy[worker]
        worker.end()
        group = assigned.job.group
        if isinstance(answer, Ended):
            if not answer.started and not answer.killed:
                raise worker.not_started()
            if self._stop_s is not None and begun(assigned.job):
                self._leave([assigned.job])
                return None
            if assigned.starts < _STARTS:
                self._start(assigned.job, assigned.order, assigned.starts + 1)
                return None
            outcome = GroupFailure(group, f"its process was ended twice, by {answer.how}")
        assert isinstance(outcome, GroupOutcome | GroupFailure)
        return group, outcome

    def _give_up(self) -> None:
        """End what takes too long after a stop: its checkpoint is as good."""
        for worker in self._busy:
            worker.end(gently=False)
        self._leave([assigned.job for assigned in self._busy.values()])
        self._busy.clear()

    def _leave(self, jobs: Sequence[GroupJob]) -> None:
        """Note which of some groups have something to hand over."""
        self._left += [job for job in jobs if begun(job)]


def _alone(job: GroupJob) -> GroupJob:
    """Return a group that is driven without further workers."""
    return replace(job, plan=replace(job.plan, setup=job.plan.setup.in_worker))
