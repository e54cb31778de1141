"""The deadline of a whole command: what is optional is left out, and the command ends in time.

A supervisor ends a command that goes on (`skillplan.workers.supervised`). A command that can stop
with a result does so at its deadline; until it is ended, it has a fifth of its time and a second.
"""

from __future__ import annotations

import math
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn, TypeVar

from skillplan.cli.writing import tell
from skillplan.errors import OptionError
from skillplan.plugins.blame import Interrupted
from skillplan.workers.processes import resident_bytes
from skillplan.workers.supervised import command_age_s, limit_command

_Made = TypeVar("_Made")
# Between a deadline and the end of the command: a share of the limit, and a constant [s].
_GRACE_SHARE, _GRACE_S = 0.2, 1.0


class _TimeIsUp(Interrupted):
    """The deadline passed during something optional."""


class Deadline:
    """When a command has to be over.

    Parameters
    ----------
    time_limit_s
        Time from the start of the command [s], > 0; None for no limit.
    memory_limit_bytes
        Memory of the command and its processes together [B], > 0; None for no limit.
    graceful
        Whether the command stops at the deadline itself. One that does not is ended then, with a
        message and exit code 2.

    Attributes
    ----------
    time_limit_s
        As given.

    Raises
    ------
    OptionError
        If memory is limited, and the system does not report how much a process holds.
    """

    def __init__(
        self,
        time_limit_s: float | None,
        memory_limit_bytes: int | None = None,
        *,
        graceful: bool,
    ) -> None:
        if memory_limit_bytes is not None and resident_bytes() is None:
            raise OptionError(
                "--memory-limit cannot be kept: this system does not report the size of a process."
            )
        self.time_limit_s = time_limit_s
        begun_s = time.monotonic() - command_age_s()
        self._end_s = math.inf if time_limit_s is None else begun_s + time_limit_s
        grace_s = _GRACE_SHARE * (time_limit_s or 0.0) + _GRACE_S if graceful else 0.0
        limit_command(time_limit_s, memory_limit_bytes, grace_s)

    def is_over(self) -> bool:
        """Return whether the deadline has passed."""
        return time.monotonic() >= self._end_s

    def tell_if_over(self) -> bool:
        """Return whether the deadline has passed; if so, tell that it ended the command."""
        if not self.is_over():
            return False
        tell(f"skillplan: note: ended by --time-limit {self.time_limit_s:g}")
        return True

    def share_s(self, share: float = 1.0, most_s: float = math.inf) -> float | None:
        """Return a share of the time that is left [s], > 0; None for no limit.

        Parameters
        ----------
        share
            From 0 to 1.
        most_s
            Limit of its own [s]; infinite for none.
        """
        left_s = min(share * (self._end_s - time.monotonic()), most_s)
        return max(1e-3, left_s) if math.isfinite(left_s) else None

    def attempt(self, make: Callable[[], _Made]) -> _Made | None:
        """Return what a function returns, or None if the deadline comes first.

        The function is interrupted as by Ctrl-C, on systems that have timers; elsewhere the
        deadline is looked at before it is called.
        """
        if self.is_over():
            return None
        try:
            with self._alarm():
                return make()
        except _TimeIsUp:
            return None

    @contextmanager
    def calling(self, request: Callable[[], None]) -> Iterator[None]:
        """Call a function at the deadline, in another thread."""
        if not math.isfinite(self._end_s):
            yield
            return
        timer = threading.Timer(max(0.0, self._end_s - time.monotonic()), request)
        timer.daemon = True
        timer.start()
        try:
            yield
        finally:
            timer.cancel()

    @contextmanager
    def _alarm(self) -> Iterator[None]:
        if not math.isfinite(self._end_s) or not hasattr(signal, "setitimer"):
            yield
            return
        before = signal.signal(signal.SIGALRM, _raise_time_is_up)
        try:
            signal.setitimer(signal.ITIMER_REAL, max(1e-3, self._end_s - time.monotonic()))
            yield
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, before)


def _raise_time_is_up(number: int, frame: FrameType | None) -> NoReturn:
    raise _TimeIsUp
