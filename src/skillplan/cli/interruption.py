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


@contextmanager
def heeding(request: Callable[[], None]) -> Iterator[None]:
    """Call `request` at the first signal; at the second raise `Interrupted`.

    If a search or a plugin goes on for two seconds, the supervisor has `SearchStopped` raised,
    which leaves the best plan so far, and then ends the process.

    Parameters
    ----------
    request
        Makes the work stop and return its result so far.
    """
    interrupted = False

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal interrupted
        if number == supervised.LAST_REQUEST:
            request()
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

    before = {
        number: signal.signal(number, interrupt)
        for number in supervised.requests()
        if signal.getsignal(number) != signal.SIG_IGN
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
