"""Ctrl-C and deadlines: requests to stop a command, and the count of finished runs meanwhile.

The first signal requests a stop, the second ends the program. A supervisor ends a command that
goes on past its time limit (`skillplan.workers.supervised`). A command that can stop with a result
does so at its deadline; a fifth of its time and a second later it is ended.
"""

from __future__ import annotations

import math
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, NoReturn, TypeVar

from skillplan.cli.writing import tell
from skillplan.errors import OptionError, SearchStopped
from skillplan.plugins.blame import Interrupted
from skillplan.views.text.wording import escape
from skillplan.workers import supervised
from skillplan.workers.processes import measure_resident_bytes
from skillplan.workers.supervised import get_command_age_s, limit_command

# CPU time of a compiler until it is interrupted again [s].
_RETRY_S = 0.02


def _is_llvm_calling(frame: FrameType | None) -> bool:
    """Return whether LLVM calls llvmlite back: an exception there is lost, and the code with it."""
    while frame is not None:
        if frame.f_code.co_name.startswith("_raw_object_cache"):
            return True
        frame = frame.f_back
    return False


@contextmanager
def handle_signals(request: Callable[[], None]) -> Iterator[None]:
    """Call `request` at the first signal, and raise `Interrupted` at the second.

    If a search or a plugin goes on for two seconds, or past its time limit, the supervisor makes it
    raise `SearchStopped`, which leaves the best plan so far, and then ends the process. A time
    limit does not call `request`.

    Parameters
    ----------
    request
        Requests that the work stop and return its result so far.
    """
    interrupted = False

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal interrupted
        if number in (supervised.LAST_REQUEST, signal.SIGVTALRM):
            if _is_llvm_calling(frame):
                signal.setitimer(signal.ITIMER_VIRTUAL, _RETRY_S)
                return
            if interrupted:
                supervised.note_interrupt()
            raise SearchStopped
        if interrupted:
            supervised.note_interrupt()
            raise Interrupted
        interrupted = True
        request()
        supervised.report_stopping()
        if sys.stderr.isatty():
            # Not print: a handler may interrupt a print.
            os.write(sys.stderr.fileno(), b"\nstopping; once more ends the program\n")

    numbers = list(supervised.requests())
    if supervised.LAST_REQUEST in numbers:
        numbers.append(signal.SIGVTALRM)
    before = {
        number: signal.signal(number, interrupt)
        for number in numbers
        if signal.getsignal(number) != signal.SIG_IGN
    }
    try:
        yield
    finally:
        if signal.SIGVTALRM in before:
            signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        for number, handler in before.items():
            signal.signal(number, handler)


class Count:
    """Counts finished runs, and shows the count on a terminal.

    Parameters
    ----------
    label
        Name of the runs.
    total
        Number of runs, >= 0; None if unknown.

    Raises
    ------
    ValueError
        If the total is negative.
    """

    def __init__(self, label: str, total: int | None) -> None:
        if total is not None and total < 0:
            raise ValueError(f"There cannot be {total} runs.")
        self.interrupted = False
        self._bar: Any = None
        self._line: Any = None
        if sys.stderr.isatty():
            self._show(label, total)

    def _show(self, label: str, total: int | None) -> None:
        # Imported here because only a terminal needs it.
        from rich.console import Console
        from rich.progress import (
            BarColumn,
            MofNCompleteColumn,
            Progress,
            TextColumn,
            TimeElapsedColumn,
            TimeRemainingColumn,
        )

        self._bar = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            console=Console(stderr=True),
            transient=True,
        )
        self._line = self._bar.add_task(escape(label), total=total)

    def __enter__(self) -> Count:
        if self._bar is not None:
            self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def stop(self) -> None:
        """Request that the work end early, with its results so far."""
        self.interrupted = True

    def one_more(self) -> None:
        """Count a run."""
        if self._bar is not None:
            self._bar.advance(self._line)


@contextmanager
def counting(label: str, total: int | None) -> Iterator[Count]:
    """Yield a count that is shown on a terminal and stops at Ctrl-C and SIGTERM.

    The first signal ends the work with its results so far; the second ends the program.
    """
    with Count(label, total) as count, handle_signals(count.stop):
        yield count


_Made = TypeVar("_Made")
# Between a deadline and the end of the command: a share of the limit, and a constant [s].
_GRACE_SHARE, _GRACE_S = 0.2, 1.0


class _TimeIsUp(Interrupted):
    """The deadline passed during something optional."""


class Deadline:
    """The time and memory limits of a whole command.

    Parameters
    ----------
    time_limit_s
        Time from the start of the command [s], > 0; None for no limit.
    memory_limit_bytes
        Memory of the command and its processes together [B], > 0; None for no limit.
    graceful
        True if the command stops at the deadline by itself. A command that does not is ended,
        with a message and exit code 2.

    Raises
    ------
    OptionError
        If memory is limited, and the system does not report the size of a process.
    """

    def __init__(
        self, time_limit_s: float | None, memory_limit_bytes: int | None = None, *, graceful: bool
    ) -> None:
        if memory_limit_bytes is not None and measure_resident_bytes() is None:
            raise OptionError(
                "--memory-limit cannot be kept: this system does not report the size of a process."
            )
        self.time_limit_s = time_limit_s
        begun_s = time.monotonic() - get_command_age_s()
        self._end_s = math.inf if time_limit_s is None else begun_s + time_limit_s
        grace_s = _GRACE_SHARE * (time_limit_s or 0.0) + _GRACE_S if graceful else 0.0
        limit_command(time_limit_s, memory_limit_bytes, grace_s)

    def is_over(self, share: float = 1.0) -> bool:
        """Return whether the deadline has passed, or a share of the time until it."""
        return time.monotonic() >= self._find_end_s(share)

    def measure_share(self) -> float:
        """Return the share of the time limit that is over; 0 without one."""
        if self.time_limit_s is None:
            return 0.0
        return max(0.0, 1.0 - (self._end_s - time.monotonic()) / self.time_limit_s)

    def _find_end_s(self, share: float) -> float:
        return self._end_s - (1.0 - share) * (self.time_limit_s or 0.0)

    def tell_if_over(self) -> bool:
        """Return whether the deadline has passed; if so, print that it ended the command."""
        if not self.is_over():
            return False
        tell(f"skillplan: note: ended by --time-limit {self.time_limit_s:g}")
        return True

    def share_s(self, share: float = 1.0, most_s: float = math.inf) -> float | None:
        """Return a share of the remaining time [s], > 0; None for no limit.

        Parameters
        ----------
        share
            Share from 0 to 1.
        most_s
            Upper limit of the share [s]; infinite for none.
        """
        left_s = min(share * (self._end_s - time.monotonic()), most_s)
        return max(1e-3, left_s) if math.isfinite(left_s) else None

    def attempt(self, make: Callable[[], _Made], share: float = 1.0) -> _Made | None:
        """Call a function and return its value, or None if the deadline comes first.

        The function is interrupted as by Ctrl-C, on systems that have timers; elsewhere the
        deadline is checked before the call.

        Parameters
        ----------
        share
            Share of the time limit at which the function is interrupted; above 1 within the time
            in which a command may stop by itself.
        """
        if self.is_over(share):
            return None
        try:
            with self._alarm(share):
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
    def _alarm(self, share: float) -> Iterator[None]:
        if not math.isfinite(self._end_s) or not hasattr(signal, "setitimer"):
            yield
            return
        before = signal.signal(signal.SIGALRM, _raise_time_is_up)
        begin_s, outer_s = time.monotonic(), signal.getitimer(signal.ITIMER_REAL)[0]
        try:
            signal.setitimer(
                signal.ITIMER_REAL, max(1e-3, self._find_end_s(share) - time.monotonic())
            )
            yield
        finally:
            # The alarm of an attempt about this one goes on.
            left_s = max(1e-3, outer_s - (time.monotonic() - begin_s)) if outer_s else 0.0
            signal.signal(signal.SIGALRM, before)
            signal.setitimer(signal.ITIMER_REAL, left_s)


def _raise_time_is_up(number: int, frame: FrameType | None) -> NoReturn:
    raise _TimeIsUp
