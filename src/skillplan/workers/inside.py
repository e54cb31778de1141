"""What code in a worker may do besides its job: tell something, and hear that it shall stop.

In a process that is no worker nobody listens, and nobody asks.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


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
