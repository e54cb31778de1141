"""Processes that do the runs of a study: as many at once as wanted, and none harms another."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from typing import Any

from skillplan.errors import SkillplanError
from skillplan.report.sweep_record import SweepRecord
from skillplan.sweep.study_run import StudyJob, do_run

# So often it is seen whether to stop.
_POLL_S = 0.1
_READY = "ready"


@dataclass(frozen=True, slots=True)
class Order:
    """A run to be done: the index of its setting, its options and its seed."""

    setting: int
    options: Mapping[str, Any]
    seed: int


def do_all(
    job: StudyJob, orders: Iterable[Order], count: int, stopped: Callable[[], bool]
) -> Iterator[SweepRecord]:
    """Yield the records of runs as they end, in whatever order.

    A run whose process is ended, for want of memory for example, is recorded as failed, and the
    others go on. Once `stopped` is true, runs on the way are given up.

    Parameters
    ----------
    job
        What all runs have in common.
    orders
        The runs.
    count
        How many processes, >= 1.
    stopped
        Whether to stop; asked several times a second.

    Raises
    ------
    SkillplanError
        If processes cannot be started.
    """
    todo = iter(orders)
    workers: list[_Worker] = []
    try:
        for _, order in zip(range(count), todo, strict=False):
            workers.append(_Worker(job))
            workers[-1].take(order)
        while workers and not stopped():
            for ready in wait([worker.line for worker in workers], timeout=_POLL_S):
                worker = next(one for one in workers if one.line is ready)
                record = worker.answer()
                if record is None:
                    continue
                if worker.alive:
                    following = next(todo, None)
                    if following is not None:
                        worker.take(following)
                else:
                    # Another process goes on where this one broke down.
                    following = next(todo, None)
                    if following is not None:
                        workers.append(_Worker(job))
                        workers[-1].take(following)
                if following is None or not worker.alive:
                    workers.remove(worker)
                    worker.end()
                yield record
    finally:
        for worker in workers:
            worker.end(gently=False)


class _Worker:
    """A process and the run that it is at."""

    def __init__(self, job: StudyJob) -> None:
        # Not forked: threads and handlers of this process are no business of the other one's.
        context = multiprocessing.get_context("spawn")
        self.line, far = context.Pipe()
        self.process = context.Process(target=_serve, args=(far, job), daemon=True)
        self.order: Order | None = None
        self.alive = True
        self._ready = False
        with _deaf_to_interrupts():
            self.process.start()
        far.close()

    def take(self, order: Order) -> None:
        """Give the process a run to do."""
        self.order = order
        # A process that broke down is noticed where its answer is read.
        with suppress(OSError):
            self.line.send((order.setting, dict(order.options), order.seed))

    def answer(self) -> SweepRecord | None:
        """Return the record of the run, failed if the process broke down; None if not yet."""
        assert self.order is not None
        try:
            answer = self.line.recv()
        except (EOFError, OSError):
            self.process.join()
            self.alive = False
            if not self._ready:
                raise SkillplanError(
                    "A process for the runs could not be started; what it said is above. A "
                    "script that calls this needs `if __name__ == '__main__':`."
                ) from None
            code = self.process.exitcode or 0
            how = f"signal {-code}" if code < 0 else f"exit code {code}"
            error = f"its process ended by {how}"
            return SweepRecord(self.order.setting, self.order.seed, error=error)
        if answer == _READY:
            self._ready = True
            return None
        assert isinstance(answer, SweepRecord)
        return answer

    def end(self, *, gently: bool = True) -> None:
        """End the process: once it is idle, or at once."""
        self.line.close()
        if not gently:
            self.process.kill()
        self.process.join()
        self.process.close()


@contextmanager
def _deaf_to_interrupts() -> Iterator[None]:
    """Start processes that never see Ctrl-C: this one decides what becomes of them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _serve(line: Connection, job: StudyJob) -> None:
    """Do runs until nobody asks for more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, BrokenPipeError):
        line.send(_READY)
        while True:
            setting, options, seed = line.recv()
            line.send(do_run(job, setting, options, seed))


def _end_with_parent() -> None:
    """End this process as soon as the one that started it is gone, whatever it is at."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
