"""Workers in this process, for tests whose claim is not about processes: none is started."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from skillplan.workers import POLL_S, Answer, Executor, Prepare, Worker


class SameProcessWorker(Worker):
    """Does its job when it is asked for the answer."""

    def __init__(self, what: str, work: Callable[[Any], Any]) -> None:
        super().__init__(what)
        self.work = work
        self.job: Any = None
        self.ended = False

    @property
    def number(self) -> None:
        return None

    @property
    def alive(self) -> bool:
        return not self.ended

    def take(self, job: Any) -> None:
        self.job = pickle.dumps(job)

    def answer(self) -> Answer:
        return Answer(pickle.loads(pickle.dumps(self.work(pickle.loads(self.job)))))

    def ask_to_stop(self) -> None:
        """It has nothing to do while anybody could ask."""

    def end(self, *, gently: bool = True) -> None:
        self.ended = True


class SameProcess(Executor):
    """An executor whose workers share this process; one answers at a time."""

    def start(self, prepare: Prepare, content: bytes, what: str) -> SameProcessWorker:
        return SameProcessWorker(what, prepare(pickle.loads(content)))

    def first_ready(self, workers: Iterable[Worker], patience_s: float = POLL_S) -> list[Worker]:
        return list(workers)[:1]

    def close(self) -> None:
        """Nothing is left behind."""


@contextmanager
def studies_in_this_process() -> Iterator[None]:
    """Let the runs of parameter studies take no processes of their own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("skillplan.sweep.study_runs.LocalProcesses", SameProcess)
        yield
