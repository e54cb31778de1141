"""Who drives the groups of runs: this process one after another, or processes side by side.

What is learned depends on neither. A process that is ended is started once more from its
group's checkpoint; if that one is ended, too, the group's runs have failed, and the others go on.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from skillplan.checks.verdict_cache import VerdictCache
from skillplan.errors import (
    BackEndError,
    OptionError,
    PluginError,
    SearchStopped,
    SkillplanError,
)
from skillplan.pipeline.registry import load
from skillplan.plugins.blame import debugging, ends_program, raised_by
from skillplan.records.training.run_folder import CHECKPOINT, group_path
from skillplan.training.group_job import GroupJob, GroupOutcome, GroupReport
from skillplan.training.group_training import GroupTraining, kept_verdicts
from skillplan.training.sent_group import SentAnswer, SentGroup, put_in_place, serving_sent
from skillplan.workers.executor import Answer, Ended, Executor, Worker, packed
from skillplan.workers.local_processes import LocalProcesses

_WHAT = "the training"
_STARTS = 2
# A stride that takes longer than this after a stop is given up: the checkpoint before counts.
GRACE_S = 3.0

Order = Literal["advance", "conclude"]


@dataclass(frozen=True, slots=True)
class GroupFailure:
    """Why the runs of a group cannot go on.

    Parameters
    ----------
    group
        Number of the group.
    reason
        In words.
    fatal
        Whether no other group can go on either: something cannot be written, or is damaged.
    back_end
        Whether a back end has failed.
    stopped
        Whether it was merely stopped, and lost the work in progress.
    """

    group: int
    reason: str
    fatal: bool = False
    back_end: bool = False
    stopped: bool = False


GroupAnswer = GroupReport | GroupOutcome | GroupFailure
Ending = tuple[int, GroupOutcome | GroupFailure]


def serve(
    job: GroupJob,
    cache: VerdictCache | None = None,
    overdue: Callable[[], bool] | None = None,
) -> Callable[[Order], GroupAnswer]:
    """Return what does strides of a group, and in the end hands over what was learned.

    Nothing that goes wrong in the group is raised: it is returned. Files are opened by the first
    order and closed by the last.

    Parameters
    ----------
    job, cache, overdue
        As for `GroupTraining`.
    """
    training: GroupTraining | None = None

    def work(order: Order) -> GroupAnswer:
        nonlocal training
        try:
            if training is None:
                training = GroupTraining(job, cache, overdue)
            if order == "advance":
                if not training.finished:
                    training.advance()
                return training.report
            outcome = training.conclude()
            training.close()
            return outcome
        except BaseException as error:
            if training is not None:
                training.close()
            if ends_program(error) and not isinstance(error, SearchStopped):
                raise
            return _failure(job, error)

    return work


def serve_sent(sent: SentGroup) -> Callable[[Order], SentAnswer[GroupAnswer]]:
    """Return what does strides of a group where the folder of the training is not at hand."""
    return serving_sent(sent, serve)


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
        if stopped() and not _begun(job):
            continue
        own = kept_verdicts(job)
        work = serve(job, own, overdue)
        outcome: GroupAnswer | None = None
        while not stopped() and not _over(outcome, job):
            outcome = work("advance")
            if isinstance(outcome, GroupReport):
                on_report(outcome)
        if not isinstance(outcome, GroupFailure):
            outcome = overdue.spared(work)
        elif outcome.stopped and _begun(job):
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
        self._stop_s: float | None = None

    def endings(self) -> Iterator[Ending]:
        """Yield what became of every group as it ends."""
        try:
            while self._busy or self._waiting:
                if self._stop_s is None and self._stopped():
                    self._stop_s = time.monotonic()
                    self._waiting = [job for job in self._waiting if _begun(job)]
                while self._waiting and len(self._busy) < self._executor.slots:
                    order: Order = "advance" if self._stop_s is None else "conclude"
                    self._start(self._waiting.pop(0), order)
                for worker in self._executor.first_ready(self._busy):
                    ending = self._attend(worker)
                    if ending is not None:
                        yield ending
                if self._stop_s is not None and time.monotonic() > self._stop_s + GRACE_S:
                    self._give_up_strides()
        finally:
            self._executor.close()

    def _start(self, job: GroupJob, order: Order, starts: int = 1) -> None:
        sent = replace(job, plan=replace(job.plan, setup=job.plan.setup.in_worker))
        if self._executor.shares_files:
            worker = self._executor.start(serve, packed(sent, _WHAT), _WHAT)
        else:
            content = packed(SentGroup.of(sent), _WHAT)
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
            over = self._stop_s is not None or _over(outcome, assigned.job)
            assigned.order = "conclude" if over else "advance"
            worker.take(assigned.order)
            return None
        del self._busy[worker]
        worker.end()
        group = assigned.job.group
        if isinstance(answer, Ended):
            if not answer.started and not answer.killed:
                raise worker.not_started()
            if assigned.starts < _STARTS:
                self._start(assigned.job, assigned.order, assigned.starts + 1)
                return None
            outcome = GroupFailure(group, f"its process was ended twice, by {answer.how}")
        assert isinstance(outcome, GroupOutcome | GroupFailure)
        return group, outcome

    def _give_up_strides(self) -> None:
        """End what takes too long after a stop: its checkpoint is as good."""
        late = [(worker, one) for worker, one in self._busy.items() if one.order == "advance"]
        for worker, assigned in late:
            del self._busy[worker]
            worker.end(gently=False)
            if _begun(assigned.job):
                self._start(assigned.job, "conclude", _STARTS)


def _over(outcome: GroupAnswer | None, job: GroupJob) -> bool:
    if isinstance(outcome, GroupReport):
        return outcome.steps >= job.plan.steps
    return outcome is not None


def _begun(job: GroupJob) -> bool:
    return (group_path(job.folder, job.group) / CHECKPOINT).exists()


def _failure(job: GroupJob, error: BaseException) -> GroupFailure:
    if isinstance(error, SearchStopped):
        return GroupFailure(job.group, str(error), stopped=True)
    if isinstance(error, OptionError | PluginError):
        return GroupFailure(job.group, str(error), fatal=True)
    if isinstance(error, SkillplanError):
        return GroupFailure(job.group, str(error), back_end=isinstance(error, BackEndError))
    if debugging():
        raise error
    name = job.plan.solver
    words = f"The solver {name!r} failed: {raised_by(load('solver', name), error)}"
    return GroupFailure(job.group, words)
