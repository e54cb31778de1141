"""What every executor offers: workers that each do one job at a time, somewhere else.

`LocalProcesses` is the one there is. Another, on a cluster for example, subclasses `Executor` and
`Worker`; whoever has jobs to do takes any.
"""

from __future__ import annotations

import pickle
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from skillplan.errors import SkillplanError

# Of what workers start from; returns the function that does jobs. Whatever can be pickled is a job.
Prepare = Callable[[Any], Callable[[Any], Any]]

# So often whoever waits may look whether to go on.
POLL_S = 0.1


@dataclass(frozen=True, slots=True)
class Answer:
    """What became of a job."""

    content: Any


@dataclass(frozen=True, slots=True)
class News:
    """What a worker says ahead of its answer."""

    content: Any


@dataclass(frozen=True, slots=True)
class Ended:
    """A worker is gone before it answered.

    Parameters
    ----------
    exit_code
        Of its process; below 0 the signal that ended it.
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


class Worker(ABC):
    """Does one job at a time.

    Parameters
    ----------
    what
        What it is for, as ``the runs``; for messages.
    """

    def __init__(self, what: str) -> None:
        self.what = what

    @property
    @abstractmethod
    def number(self) -> int | None:
        """The number of its process on this machine; None where it runs elsewhere."""

    @property
    @abstractmethod
    def alive(self) -> bool:
        """Whether it can be given a job."""

    @abstractmethod
    def take(self, job: Any) -> None:
        """Give it a job; it must not have one."""

    @abstractmethod
    def answer(self) -> Answer | News | Ended | None:
        """Return what became of the job, news of it, or that the worker broke down; None if none.

        Raises
        ------
        SkillplanError
            If the worker could not make itself ready, in its own words.
        """

    @abstractmethod
    def ask_to_stop(self) -> None:
        """Ask it to end its job; one that cannot hear goes on until it is ended."""

    @abstractmethod
    def end(self, *, gently: bool = True) -> None:
        """End it: once it is idle, or at once. To end it again does nothing."""

    def not_started(self) -> SkillplanError:
        """Return the error to raise where it ended before it was ready."""
        return SkillplanError(
            f"A process for {self.what} could not be started; what it said is above. A "
            "script that calls this needs `if __name__ == '__main__':`."
        )


class Executor(ABC):
    """Starts workers and waits for them.

    Parameters
    ----------
    slots
        The most workers at once, >= 1; whoever starts them keeps to it.

    Raises
    ------
    ValueError
        If `slots` is below 1.
    """

    def __init__(self, slots: int) -> None:
        if slots < 1:
            raise ValueError(f"There must be at least one process, not {slots}.")
        self.slots = slots

    @property
    def refusal(self) -> str:
        """Why none can be started from here, in words; empty where they can."""
        return ""

    @abstractmethod
    def start(self, prepare: Prepare, content: bytes, what: str) -> Worker:
        """Start a worker, which makes itself ready on its own.

        Parameters
        ----------
        prepare
            Called by the worker with what `content` holds; returns the function that does jobs.
            Must be importable.
        content
            What `packed` returned.
        what
            What it is for, as ``the runs``; for messages.

        Raises
        ------
        SkillplanError
            If it cannot be started.
        """

    @abstractmethod
    def first_ready(self, workers: Iterable[Worker], patience_s: float = POLL_S) -> list[Worker]:
        """Return the workers whose next answer is there.

        Parameters
        ----------
        workers
            Some that this executor has started.
        patience_s
            How long to wait for the first [s], >= 0.
        """

    @abstractmethod
    def close(self) -> None:
        """End all workers at once; more can be started afterwards."""


def packed(content: Any, what: str) -> bytes:
    """Return what workers are to start from, as it is sent to them.

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
