"""Progress of long stages, and requests to stop them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_SLOW_S = 2.0


class Watch:
    """Progress reports of a stage, and requests to stop it.

    Parameters
    ----------
    tell
        Prints a line.
    must_stop
        Returns True once the time is over, or after Ctrl-C.
    """

    def __init__(
        self,
        tell: Callable[[str], None] = lambda line: None,
        must_stop: Callable[[], bool] = lambda: False,
    ) -> None:
        self.tell, self.must_stop = tell, must_stop
        self._last_s = time.monotonic()

    def report(self, text: str) -> None:
        """Print a line, at most one in two seconds."""
        if time.monotonic() - self._last_s > _SLOW_S:
            self._last_s = time.monotonic()
            self.tell(text)

    @contextmanager
    def examine(self, text: str) -> Iterator[None]:
        """Print a line about work that took over two seconds."""
        start_s = time.monotonic()
        yield
        seconds = time.monotonic() - start_s
        if seconds > _SLOW_S:
            self.tell(f"{text}: {seconds:.0f} s")
