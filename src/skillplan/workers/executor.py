"""What every executor offers: workers that each do one job at a time, somewhere else.

`LocalProcesses` is the default. Another, on a cluster for example, subclasses `Executor` and
`Worker` and is registered in the group ``skillplan.executor``; whoever has jobs to do takes any.
"""

from __future__ import annotations

import pickle
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from pydantic import BaseModel

from skillplan.errors import OptionError, SkillplanError
from skillplan.task import back_end

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
        Of its process; below 0 the signal that ended it. None where nobody can say: the process
        is lost, and maybe its machine.
    started
        Whether it had come as far as to wait for jobs.
    cause
        What ended it, in words, where there is no exit code.
    """

    exit_code: int | None
    started: bool
    cause: str = ""

    @property
    def killed(self) -> bool:
        """Whether a signal ended it, or the loss of its machine: nothing that it did itself."""
        return self.exit_code is None or self.exit_code < 0

    @property
    def how(self) -> str:
        """What ended it: ``signal 9``, ``exit code 1``, or the cause in words."""
        if self.exit_code is None:
            return self.cause or "the loss of its machine"
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

    To construct one starts nothing and connects to nothing; the first worker does.

    Parameters
    ----------
    slots
        The most workers at once, >= 1; whoever starts them keeps to it.
    options
        An instance of `Options`; None for the defaults.
    address
        Of what it connects to; empty for none.

    Attributes
    ----------
    name
        Kebab-case, as in the entry point.
    Options
        A pydantic model whose fields carry range and description.
    takes_address
        Whether ``--executor NAME:ADDRESS`` may give it an address.
    shares_files
        Whether its workers see the files of this machine under the same paths. Where they do not,
        they write none that anybody is to find, and what they make is sent back.

    Raises
    ------
    ValueError
        If `slots` is below 1.
    OptionError
        If there is an address and it takes none.
    """

    name: ClassVar[str]
    Options: ClassVar[type[BaseModel]] = back_end.Options
    takes_address: ClassVar[bool] = False
    shares_files: ClassVar[bool] = True

    def __init__(self, slots: int, options: BaseModel | None = None, address: str = "") -> None:
        if slots < 1:
            raise ValueError(f"There must be at least one process, not {slots}.")
        if address and not self.takes_address:
            raise OptionError(f"The executor {self.name!r} takes no address, but got {address!r}.")
        self.slots = slots
        self.options = self.Options() if options is None else options
        self.address = address

    @property
    def refusal(self) -> str:
        """Why none can be started from here, in words; empty where they can."""
        return ""

    @property
    def start_up_s(self) -> float:
        """About so long whoever starts the next worker has to wait [s], beside what that makes."""
        return 0.0

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


MakeExecutor = Callable[[int], Executor]
"""Returns an executor of so many slots; None in its place stands for processes of this machine."""


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


DEFAULT_EXECUTOR = "local"


@dataclass(frozen=True)
class ExecutorChoice:
    """An executor that was chosen; nothing is imported, started or connected to.

    Parameters
    ----------
    name
        Of the plugin.
    address
        What it connects to; empty for none.
    options
        Its options, as given.
    """

    name: str = DEFAULT_EXECUTOR
    address: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def read(cls, text: str, options: Mapping[str, Mapping[str, Any]]) -> ExecutorChoice:
        """Return the choice of ``NAME`` or ``NAME:ADDRESS``.

        Parameters
        ----------
        text
            Such as ``local`` or ``ray:10.0.0.1:6379``.
        options
            Plugin name to options; those of others are left alone.

        Raises
        ------
        OptionError
            If an address is announced and none given.
        """
        name, colon, address = text.partition(":")
        if colon and not address:
            raise OptionError(f"--executor {text}: no address follows the colon; leave both away.")
        return cls(name, address, dict(options.get(name, {})))

    @property
    def is_default(self) -> bool:
        """Whether jobs are done in processes of this machine, as without a choice."""
        return self == ExecutorChoice()


class _Surroundings:
    """What the process offers to the code that does its jobs."""

    tell: Callable[[Any], None] | None = None
    on_request: Callable[[], None] | None = None
    shares_files: bool = True


_here = _Surroundings()


def tell(content: Any) -> None:
    """Say something to whoever gave the job, ahead of its answer."""
    if _here.tell is not None:
        _here.tell(content)


def when_asked_to_stop(request: Callable[[], None] | None) -> None:
    """Have a function called where whoever gave the job wants it to end; None for none any more."""
    _here.on_request = request


def asked_to_stop() -> None:
    """Call the function of `when_asked_to_stop`; the executor does, from the worker's side."""
    if _here.on_request is not None:
        _here.on_request()


def connect(speak: Callable[[Any], None], *, shares_files: bool = True) -> None:
    """Say by what `tell` speaks, and whose files these are; the executor does, from inside.

    Parameters
    ----------
    speak
        Sends news to whoever gave the job.
    shares_files
        As `Executor.shares_files`.
    """
    _here.tell = speak
    _here.shares_files = shares_files


def is_worker() -> bool:
    """Whether this process does jobs for another one."""
    return _here.tell is not None


def shares_files() -> bool:
    """Whether files that are written here are those of whoever gave the job."""
    return _here.shares_files
