"""Executors: workers elsewhere that each do one job at a time.

`LocalProcesses` is the default. Others, such as for a cluster, subclass `Executor` and `Worker`,
and are registered in the group ``skillplan.executor``.
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

# Makes a worker ready, from the content it starts with; returns the function that does jobs. Jobs
# can be any values that pickle.
Prepare = Callable[[Any], Callable[[Any], Any]]

# Interval at which waiting callers may check for a stop [s].
POLL_S = 0.1


@dataclass(frozen=True, slots=True)
class Answer:
    """Answer to a job."""

    content: Any


@dataclass(frozen=True, slots=True)
class News:
    """News of a worker before its answer."""

    content: Any


@dataclass(frozen=True, slots=True)
class Ended:
    """A worker ended before its answer.

    Parameters
    ----------
    exit_code
        Exit code of its process, or minus the signal; None if the process, or its machine, was
        lost.
    started
        True if it was ready for jobs.
    cause
        Description of the cause, if the exit code is unknown.
    """

    exit_code: int | None
    started: bool
    cause: str = ""

    @property
    def killed(self) -> bool:
        """True if a signal or the loss of its machine ended it, not its own code."""
        return self.exit_code is None or self.exit_code < 0

    @property
    def how(self) -> str:
        """Cause of the end: ``signal 9``, ``exit code 1``, or its description."""
        if self.exit_code is None:
            return self.cause or "the loss of its machine"
        return f"signal {-self.exit_code}" if self.killed else f"exit code {self.exit_code}"


class Worker(ABC):
    """A worker, which does one job at a time.

    Parameters
    ----------
    what
        Purpose, such as ``the runs``; for messages.
    """

    def __init__(self, what: str) -> None:
        self.what = what

    @property
    @abstractmethod
    def number(self) -> int | None:
        """Process id on this machine; None elsewhere."""

    @property
    @abstractmethod
    def alive(self) -> bool:
        """True if it can take a job."""

    @abstractmethod
    def take(self, job: Any) -> None:
        """Start a job; the worker must be idle."""

    @abstractmethod
    def answer(self) -> Answer | News | Ended | None:
        """Return the answer, news, or the end of the worker; None if there is nothing yet.

        Raises
        ------
        SkillplanError
            If the worker could not become ready; with its message.
        """

    @abstractmethod
    def ask_to_stop(self) -> None:
        """Request the end of the job; a worker that does not listen goes on."""

    @abstractmethod
    def end(self, *, gently: bool = True) -> None:
        """End the worker, once it is idle or at once; no effect if it has ended."""

    def not_started(self) -> SkillplanError:
        """Return the error for a worker that ended before it was ready."""
        return SkillplanError(
            f"A process for {self.what} could not be started; what it said is above. A "
            "script that calls this needs `if __name__ == '__main__':`."
        )


class Executor(ABC):
    """An executor, which starts workers and waits for them.

    The constructor starts and connects nothing; the first worker does.

    Parameters
    ----------
    slots
        Greatest number of workers, >= 1; callers must respect it.
    options
        Options; None for the defaults.
    address
        Address to connect to; may be empty.

    Attributes
    ----------
    name
        Kebab-case, as in the entry point.
    Options
        Pydantic model; its fields have ranges and descriptions.
    takes_address
        True if ``--executor NAME:ADDRESS`` is allowed.
    shares_files
        True if workers see the files of this machine under the same paths. If not, they send their
        results instead of writing them.

    Raises
    ------
    ValueError
        If `slots` is below 1.
    OptionError
        If there is an unexpected address.
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
        """Reason why workers cannot be started here; else empty."""
        return ""

    @property
    def start_up_s(self) -> float:
        """Expected delay of the next worker [s], without its own preparation."""
        return 0.0

    @abstractmethod
    def start(self, prepare: Prepare, content: bytes, what: str) -> Worker:
        """Start a worker, which makes itself ready.

        Parameters
        ----------
        prepare
            Called by the worker with the content; returns the function that does jobs. Must be
            importable.
        what
            Purpose, such as ``the runs``; for messages.

        Raises
        ------
        SkillplanError
            If the worker cannot be started.
        """

    @abstractmethod
    def first_ready(self, workers: Iterable[Worker], patience_s: float = POLL_S) -> list[Worker]:
        """Return the workers with an answer or news.

        Parameters
        ----------
        patience_s
            Time to wait for the first one [s], >= 0.
        """

    @abstractmethod
    def close(self) -> None:
        """End all workers at once; new ones can be started."""


MakeExecutor = Callable[[int], Executor]
"""Returns an executor with a number of slots. None instead stands for this machine."""


def pack_content(content: Any, what: str) -> bytes:
    """Return the content that workers start with, pickled.

    Raises
    ------
    SkillplanError
        If it cannot be pickled.
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
    """A choice of an executor, before it is imported, started or connected.

    Parameters
    ----------
    address
        Address to connect to; may be empty.
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
            Options by name of the plugin.

        Raises
        ------
        OptionError
            If the address is missing after a colon.
        """
        name, colon, address = text.partition(":")
        if colon and not address:
            raise OptionError(f"--executor {text}: no address follows the colon; leave both away.")
        return cls(name, address, dict(options.get(name, {})))

    @property
    def is_default(self) -> bool:
        """True if jobs run on this machine with default options."""
        return self == ExecutorChoice()


class _Surroundings:
    """Connections of this process, if it is a worker."""

    tell: Callable[[Any], None] | None = None
    on_request: Callable[[], None] | None = None
    shares_files: bool = True


_here = _Surroundings()


def tell(content: Any) -> None:
    """Send news to the client of the job; no effect outside of workers."""
    if _here.tell is not None:
        _here.tell(content)


def set_stop_handler(request: Callable[[], None] | None) -> None:
    """Set the function that is called when the client requests a stop; None removes it."""
    _here.on_request = request


def handle_stop_request() -> None:
    """Call the function of `set_stop_handler`; the executor calls this in the worker."""
    if _here.on_request is not None:
        _here.on_request()


def connect(speak: Callable[[Any], None], *, shares_files: bool = True) -> None:
    """Connect `tell`, and set whether files are shared; the executor calls this in the worker.

    Parameters
    ----------
    speak
        Sends news to the client of the job.
    shares_files
        As `Executor.shares_files`.
    """
    _here.tell = speak
    _here.shares_files = shares_files


def is_worker() -> bool:
    """Return whether this process is a worker."""
    return _here.tell is not None


def shares_files() -> bool:
    """Return whether the client of the job sees files written here."""
    return _here.shares_files
