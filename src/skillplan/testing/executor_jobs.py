"""What workers do for the suite of executors, by name. They import no more than that takes."""

from __future__ import annotations

import os
import platform
import signal
import threading
import time
from collections.abc import Callable
from typing import Any

from skillplan.workers.inside import tell, when_asked_to_stop
from skillplan.workers.local_processes import LocalProcesses


def here() -> tuple[str, int]:
    """Return machine and number of this process."""
    return platform.node(), os.getpid()


def prepare(function: str) -> Callable[[Any], Any]:
    """Return the function of a name; called by a worker."""
    return _FUNCTIONS[function]


def _echo(job: Any) -> tuple[Any, tuple[str, int]]:
    return job, here()


def _count(job: int) -> int:
    for number in range(job):
        tell(number)
    return job


def _wait(job: float) -> str:
    asked = threading.Event()
    when_asked_to_stop(asked.set)
    tell("listening")
    end_s = time.monotonic() + job
    while not asked.is_set() and time.monotonic() < end_s:
        time.sleep(0.01)
    when_asked_to_stop(None)
    return "asked to stop" if asked.is_set() else "heard nothing"


def _busy(job: float) -> None:
    tell(here())
    end_s = time.monotonic() + job
    while time.monotonic() < end_s:
        sum(range(10_000))


def _kill(job: int) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def _refusal(job: None) -> str:
    return LocalProcesses(1).refusal


_FUNCTIONS: dict[str, Callable[[Any], Any]] = {
    "echo": _echo,
    "sleep": time.sleep,
    "count": _count,
    "wait": _wait,
    "busy": _busy,
    "exit": os._exit,
    "kill": _kill,
    "refusal": _refusal,
}
