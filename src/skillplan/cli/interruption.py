"""Ctrl-C and SIGTERM as a request to stop; the second ends the program."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

# A batch system asks by SIGTERM.
_REQUESTS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def heeding(request: Callable[[], None]) -> Iterator[None]:
    """Call `request` at the first signal; at the second raise KeyboardInterrupt.

    Parameters
    ----------
    request
        Asks whoever works to stop with what there is.
    """
    asked = False

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal asked
        if asked:
            raise KeyboardInterrupt
        asked = True
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
