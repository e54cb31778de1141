"""The executor of this machine: isolated worker processes.

A process is spawned, communicates through a pipe of its own, ignores Ctrl-C, prints nothing to
stdout, and ends with its parent process.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection, wait
from typing import Any

from pydantic import BaseModel

from skillplan.errors import BackEndError, SkillplanError
from skillplan.plugins.installed import shield_libraries, unreadable
from skillplan.workers.executor import (
    POLL_S,
    Answer,
    Ended,
    Executor,
    News,
    Prepare,
    Worker,
    connect,
    handle_stop_request,
    is_worker,
)


class LocalProcesses(Executor):
    """Runs jobs in processes of this machine.

    Raises
    ------
    ValueError
        If `slots` is below 1.
    OptionError
        If an address is given.
    """

    name = "local"

    def __init__(self, slots: int, options: BaseModel | None = None, address: str = "") -> None:
        super().__init__(slots, options, address)
        self._workers: list[WorkerProcess] = []

    @property
    def refusal(self) -> str:
        """Reason why processes cannot be started here; else empty."""
        inside = multiprocessing.current_process().daemon or is_worker()
        return "a process for jobs may not start others" if inside else ""

    def start(self, prepare: Prepare, content: bytes, what: str) -> WorkerProcess:
        """Start a process; parameters and errors as for `Executor.start`."""
        self._workers = [worker for worker in self._workers if not worker.ended]
        worker = WorkerProcess(prepare, content, what)
        self._workers.append(worker)
        return worker

    def first_ready(self, workers: Iterable[Worker], patience_s: float = POLL_S) -> list[Worker]:
        """Return the processes with an answer or news, within `patience_s` [s]."""
        by_line = {worker.line: worker for worker in workers if isinstance(worker, WorkerProcess)}
        ready = wait(list(by_line), timeout=patience_s) if by_line else []
        return [worker for line, worker in by_line.items() if line in ready]

    def close(self) -> None:
        """End all processes at once; new ones can be started."""
        for worker in self._workers:
            worker.end(gently=False)
        self._workers.clear()


class WorkerProcess(Worker):
    """A worker process.

    Attributes
    ----------
    line
        This end of its pipe, to wait for.

    Raises
    ------
    SkillplanError
        If the process cannot be started.
    """

    def __init__(self, prepare: Prepare, content: bytes, what: str) -> None:
        super().__init__(what)
        # Spawned, because a fork would copy threads and handlers.
        context = multiprocessing.get_context("spawn")
        self.line, far = context.Pipe()
        self.ended = False
        self._started = False
        arguments = (far, bool(unreadable()))
        self._process = context.Process(target=_serve, args=arguments, daemon=True)
        try:
            with _interrupts_blocked():
                self._process.start()
                # Not among the arguments: if this process is killed while it writes many bytes of
                # them, the new one prints a traceback.
                self.take((prepare, content))
        except OSError as error:
            self.line.close()
            raise SkillplanError(
                f"A process for {what} could not be started: {error.strerror or error}."
            ) from None
        finally:
            far.close()

    @property
    def number(self) -> int | None:
        """Process id."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """True if it can take a job."""
        return not self.ended and self._process.is_alive()

    def take(self, job: Any) -> None:
        """Start a job; the process must be idle."""
        # `answer` detects a process that has ended.
        with suppress(OSError):
            self.line.send(job)

    def answer(self) -> Answer | News | Ended | None:
        """Return the answer, news, or the end of the process; None if there is nothing yet.

        Raises
        ------
        SkillplanError
            If the process could not become ready; with its message.
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
        return News(content) if kind == _NEWS else Answer(content)

    def ask_to_stop(self) -> None:
        """Send the signal that requests a stop, if the system has one."""
        if self._started and self.alive and _REQUEST is not None and self.number is not None:
            with suppress(OSError):
                os.kill(self.number, _REQUEST)

    def end(self, *, gently: bool = True) -> None:
        """End the process, once it is idle or at once; no effect if it has ended."""
        if self.ended:
            return
        self.ended = True
        self.line.close()
        if not gently:
            self._process.kill()
        self._process.join()
        self._process.close()


_READY, _NEWS, _DONE, _FAILED = "ready", "news", "done", "failed"
# Python handles signals between two lines; C code delays them.
_REQUEST = getattr(signal, "SIGUSR1", None)


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Start processes that ignore Ctrl-C: this process decides about them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    # Otherwise started with the first process, when it unblocks signals here.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _serve(line: Connection, shielded: bool) -> None:
    """Prepare, then do jobs until the pipe is closed."""
    if shielded:
        shield_libraries()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if _REQUEST is not None:
        signal.signal(_REQUEST, lambda *_: handle_stop_request())
    threading.Thread(target=_end_with_parent, daemon=True).start()
    # C libraries print there, too, and stdout is reserved for a document.
    silence = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silence, 1)
    os.close(silence)
    # The client may be gone at any time.
    with suppress(ConnectionError):
        prepare, content = _receive(line)
        try:
            work = prepare(pickle.loads(content))
        except BackEndError as error:
            line.send((_FAILED, (BackEndError, str(error))))
            return
        except BaseException as error:
            words = f"A process could not make itself ready: {type(error).__name__}: {error}"
            line.send((_FAILED, (SkillplanError, words)))
            return
        # Another thread than that of the job may send news.
        speaking = threading.Lock()

        def say(kind: str, content: Any) -> None:
            with speaking:
                line.send((kind, content))

        connect(lambda news: say(_NEWS, news))
        say(_READY, None)
        while True:
            say(_DONE, work(_receive(line)))


def _receive(line: Connection) -> Any:
    try:
        message = line.recv_bytes()
    except (EOFError, OSError):
        raise ConnectionError("the client is gone") from None
    return pickle.loads(message)


def _end_with_parent() -> None:
    """End this process as soon as its parent has ended, in any state."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
