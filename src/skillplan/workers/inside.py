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


def connect(speak: Callable[[Any], None]) -> None:
    """Set by what `tell` speaks; the executor does, from the worker's side."""
    _here.tell = speak
