"""Processes that do jobs for this one: as many at once as wanted, and none harms another.

A process is spawned, talks through a pipe of its own, never sees Ctrl-C, writes nothing to
stdout, and ends with the process that started it, however that ends.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from typing import Any

from skillplan.errors import BackEndError, SkillplanError

# Of a job, whatever can be sent; the function that does jobs is made in the process.
Prepare = Callable[[Any], Callable[[Any], Any]]

# So often whoever waits may look whether to go on.
POLL_S = 0.1


@dataclass(frozen=True, slots=True)
class Answer:
    """What became of a job."""

    content: Any


@dataclass(frozen=True, slots=True)
class Ended:
    """A process is gone before it answered.

    Parameters
    ----------
    exit_code
        Below 0 the signal that ended it.
    started
        Whether it had come as far as to wait for jobs.
    """

    exit_code: int
    started: bool

    @property
    def killed(self) -> bool:
        """Whether a signal ended it."""
        return self.exit_code < 0

    @property
    def how(self) -> str:
        """What ended it: ``signal 9`` or ``exit code 1``."""
        return f"signal {-self.exit_code}" if self.killed else f"exit code {self.exit_code}"


class WorkerProcess:
    """A process that does one job at a time.

    Parameters
    ----------
    prepare
        Called in the process with what `content` holds; returns the function that does jobs.
        Must be importable.
    content
        What `packed` returned.
    what
        What the process is for, as ``the runs``; for messages.

    Attributes
    ----------
    line
        The near end of its pipe, to wait for.
    """

    def __init__(self, prepare: Prepare, content: bytes, what: str) -> None:
        # Not forked: threads and handlers of this process are no business of the other one's.
        context = multiprocessing.get_context("spawn")
        self.line, far = context.Pipe()
        self._what = what
        self._started = False
        self._process = context.Process(target=_serve, args=(far, prepare, content), daemon=True)
        try:
            with _deaf_to_interrupts():
                self._process.start()
        except OSError as error:
            self.line.close()
            raise SkillplanError(
                f"A process for {what} could not be started: {error.strerror or error}."
            ) from None
        finally:
            far.close()

    @property
    def number(self) -> int | None:
        """The process number that the system gave it."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether it can be given a job."""
        return self._process.is_alive()

    def take(self, job: Any) -> None:
        """Give the process a job; it must not have one."""
        # A process that broke down is noticed where its answer is read.
        with suppress(OSError):
            self.line.send(job)

    def answer(self) -> Answer | Ended | None:
        """Return what became of the job, or that the process broke down; None if neither yet.

        Raises
        ------
        SkillplanError
            If the process could not make itself ready, in its own words.
        """
        try:
            kind, content = self.line.recv()
        except (EOFError, OSError):
            self._process.join()
            return Ended(self._process.exitcode or 0, self._started)
        if kind == _READY:
            self._started = True
            return None
        if kind == _FAILED:
            error_class, words = content
            raise error_class(words)
        return Answer(content)

    def not_started(self) -> SkillplanError:
        """Return the error to raise where it ended before it was ready."""
        return SkillplanError(
            f"A process for {self._what} could not be started; what it said is above. A "
            "script that calls this needs `if __name__ == '__main__':`."
        )

    def end(self, *, gently: bool = True) -> None:
        """End the process: once it is idle, or at once."""
        self.line.close()
        if not gently:
            self._process.kill()
        self._process.join()
        self._process.close()


def packed(content: Any, what: str) -> bytes:
    """Return what processes are to start from, as it is sent to them.

    Raises
    ------
    SkillplanError
        If it cannot be sent.
    """
    try:
        return pickle.dumps(content)
    except Exception as error:
        raise SkillplanError(
            f"What processes for {what} start from cannot be sent to them: {error}"
        ) from error


def first_ready(
    workers: Iterable[WorkerProcess], patience_s: float = POLL_S
) -> list[WorkerProcess]:
    """Return the processes that have something to say, within `patience_s`."""
    by_line = {worker.line: worker for worker in workers}
    ready = wait(list(by_line), timeout=patience_s) if by_line else []
    return [worker for line, worker in by_line.items() if line in ready]


_READY, _DONE, _FAILED = "ready", "done", "failed"


@contextmanager
def _deaf_to_interrupts() -> Iterator[None]:
    """Start processes that never see Ctrl-C: this one decides what becomes of them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    # Started with the first process otherwise, when it makes this one hear again.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _serve(line: Connection, prepare: Prepare, content: bytes) -> None:
    """Do jobs until nobody asks for more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    # Libraries in C print there, too, and stdout is for one document.
    silence = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silence, 1)
    os.close(silence)
    # Whoever asked may be gone at any moment, and need not hear of it.
    with suppress(EOFError, ConnectionError):
        try:
            work = prepare(pickle.loads(content))
        except BackEndError as error:
            line.send((_FAILED, (BackEndError, str(error))))
            return
        except Exception as error:
            words = f"A process could not make itself ready: {type(error).__name__}: {error}"
            line.send((_FAILED, (SkillplanError, words)))
            return
        line.send((_READY, None))
        while True:
            line.send((_DONE, work(line.recv())))


def _end_with_parent() -> None:
    """End this process as soon as the one that started it is gone, whatever it is at."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
