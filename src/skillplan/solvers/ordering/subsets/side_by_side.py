"""Work in threads of this process: kernels that leave the interpreter alone run side by side."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Generic, TypeVar

R = TypeVar("R")

_EVERY_S = 0.01

Stop = Callable[[], bool]


class _Strand(Generic[R]):
    """A task in a thread of its own, which does not outlive the program."""

    def __init__(self, task: Callable[[Stop], R], stop: Stop) -> None:
        self._task, self._stop = task, stop
        self.results: list[R] = []
        self.error: BaseException | None = None
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()

    def _run(self) -> None:
        try:
            self.results.append(self._task(self._stop))
        except BaseException as error:
            self.error = error


def side_by_side(tasks: Sequence[Callable[[Stop], R]], stop: Stop) -> list[R]:
    """Do tasks at once, each in a thread; return their results in the order of the tasks.

    Parameters
    ----------
    tasks
        Each is called with what says whether to stop now.
    stop
        Polled in this thread alone, so that it may do anything.

    Raises
    ------
    BaseException
        What the first task that failed has raised.
    """
    if len(tasks) == 1:
        return [tasks[0](stop)]
    stopped = threading.Event()
    strands = [_Strand(task, stopped.is_set) for task in tasks]
    try:
        for strand in strands:
            while strand.thread.is_alive():
                strand.thread.join(_EVERY_S)
                if strand.thread.is_alive() and not stopped.is_set() and stop():
                    stopped.set()
    finally:
        # Whatever `stop` raises: no thread goes on with work that nobody waits for.
        stopped.set()
    for strand in strands:
        if strand.error is not None:
            raise strand.error
    return [strand.results[0] for strand in strands]
