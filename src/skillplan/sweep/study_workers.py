"""Processes that do the runs of a study: as many at once as wanted, and none harms another."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from skillplan.records.sweep.record import SweepRecord
from skillplan.sweep.study_run import StudyJob, do_run
from skillplan.workers.executor import Answer, Executor, News, Worker, packed
from skillplan.workers.local_processes import LocalProcesses

_WHAT = "the runs"


@dataclass(frozen=True, slots=True)
class Order:
    """A run to be done: the index of its setting, its options and its seed."""

    setting: int
    options: Mapping[str, Any]
    seed: int


def do_all(
    job: StudyJob,
    orders: Iterable[Order],
    count: int,
    stopped: Callable[[], bool],
    executor: Executor | None = None,
) -> Iterator[SweepRecord]:
    """Yield the records of runs as they end, in whatever order.

    A run whose process is ended, for want of memory for example, is recorded as failed, and the
    others go on; one whose machine is lost is done once more elsewhere. Once `stopped` is true,
    unfinished runs are given up.

    Parameters
    ----------
    job
        What all runs have in common.
    orders
        The runs; the next one is asked for once the record before it has been taken.
    count
        How many processes, >= 1.
    stopped
        Whether to stop; called several times a second.
    executor
        Where they run instead; it has the number of them, too.

    Raises
    ------
    SkillplanError
        If processes cannot be started.
    """
    executor = LocalProcesses(count) if executor is None else executor
    todo = iter(orders)
    content = packed(replace(job, setup=job.setup.in_worker), _WHAT)
    at: dict[Worker, Order] = {}
    again: list[Order] = []

    def give(worker: Worker | None, order: Order) -> None:
        if worker is None:
            worker = executor.start(_prepare, content, _WHAT)
        at[worker] = order
        worker.take((order.setting, dict(order.options), order.seed))

    try:
        for _, order in zip(range(executor.slots), todo, strict=False):
            give(None, order)
        while at and not stopped():
            for worker in executor.first_ready(at):
                answer = worker.answer()
                if answer is None or isinstance(answer, News):
                    continue
                order = at[worker]
                if isinstance(answer, Answer):
                    record = answer.content
                elif answer.exit_code is None and order not in again:
                    # A lost machine is no fault of the run's: once more, elsewhere.
                    again.append(order)
                    del at[worker]
                    worker.end()
                    give(None, order)
                    continue
                elif not answer.started and not answer.killed:
                    raise worker.not_started()
                else:
                    error = f"its process ended by {answer.how}"
                    record = SweepRecord(order.setting, order.seed, error=error)
                # First the record, by which the next run may be chosen.
                yield record
                following = next(todo, None)
                goes_on = following is not None and isinstance(answer, Answer)
                if not goes_on:
                    del at[worker]
                    worker.end()
                if following is not None:
                    # Another process goes on where this one broke down.
                    give(worker if goes_on else None, following)
    finally:
        executor.close()


def _prepare(job: StudyJob) -> Callable[[tuple[int, dict[str, Any], int]], SweepRecord]:
    """Return what does the runs of a study, in a process of its own."""
    return lambda order: do_run(job, *order)
