"""Ctrl-C and SIGTERM as a request to stop; the second ends the program."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from skillplan.plugins.blame import Interrupted

# A batch system interrupts by SIGTERM.
_REQUESTS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def heeding(request: Callable[[], None]) -> Iterator[None]:
    """Call `request` at the first signal; at the second raise `Interrupted`.

    Parameters
    ----------
    request
        Makes whoever works stop with what there is.
    """
    interrupted = False

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal interrupted
        if interrupted:
            raise Interrupted
        interrupted = True
        request()
        if sys.stderr.isatty():
            # Not print: a handler may interrupt a print.
            os.write(sys.stderr.fileno(), b"\nstopping; once more ends the program\n")

    before = {number: signal.signal(number, interrupt) for number in _REQUESTS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
