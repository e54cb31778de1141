"""The first signal as a request to stop; the second ends the program."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from skillplan.errors import SearchStopped
from skillplan.plugins.blame import Interrupted
from skillplan.workers import supervised

# A compiler is given this much CPU time before it is interrupted again [s].
_RETRY_S = 0.02


def _is_llvm_calling(frame: FrameType | None) -> bool:
    """Whether LLVM is calling llvmlite back: an exception there is lost, and with it the code."""
    while frame is not None:
        if frame.f_code.co_name.startswith("_raw_object_cache"):
            return True
        frame = frame.f_back
    return False


@contextmanager
def heeding(request: Callable[[], None]) -> Iterator[None]:
    """Call `request` at the first signal; at the second raise `Interrupted`.

    If a search or a plugin goes on for two seconds, or past its time limit, the supervisor has
    `SearchStopped` raised, which leaves the best plan so far, and then ends the process. A time
    limit is no interruption, so `request` is not called for it.

    Parameters
    ----------
    request
        Makes the work stop and return its result so far.
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
