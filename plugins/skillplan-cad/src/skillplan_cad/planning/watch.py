"""Progress of long stages, and requests to stop them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol, TypeVar

_Made = TypeVar("_Made")
_SLOW_S = 2.0
# Share of the time limit at which the last stage ends.
_END_SHARE = 0.97


class Attempt(Protocol):
    """Calls a function, and interrupts it at a share of the time limit; see `Watch`."""

    def __call__(self, make: Callable[[], _Made], share: float) -> _Made | None:
        """Return the value of a function, or None if the share is over before."""


def call_at_once(make: Callable[[], _Made], share: float) -> _Made | None:
    """Call a function without a limit."""
    return make()


class Watch:
    """Progress reports of a stage, and requests to stop it.

    Parameters
    ----------
    tell
        Prints a line.
    must_stop
        Returns True once a share of the time limit is over, or after Ctrl-C.
    attempt
        Calls a function and returns its value, or None if a share of the time limit is over before.
    measure_share
        Returns the share of the time limit that is over.
    stop_share
        Share after which the stage stops.
    """

    def __init__(
        self,
        tell: Callable[[str], None] = lambda line: None,
        must_stop: Callable[[float], bool] = lambda share: False,
        attempt: Attempt = call_at_once,
        measure_share: Callable[[], float] = lambda: 0.0,
        stop_share: float = 1.0,
    ) -> None:
        self.tell = tell
        self._must_stop, self._stop_share = must_stop, stop_share
        self._attempt, self._measure_share = attempt, measure_share
        self._begin_share = 0.0
        self._last_s = time.monotonic()

    def renew(self) -> None:
        """Let shares be shares of the time that is left, up to the end of the last stage."""
        self._begin_share = self._measure_share()

    def _scale(self, share: float) -> float:
        return share + self._begin_share * max(0.0, 1.0 - share / _END_SHARE)

    def must_stop(self) -> bool:
        """Return whether the time of the stage is over, or Ctrl-C was pressed."""
        return self._must_stop(self._scale(self._stop_share))

    def attempt(self, make: Callable[[], _Made], share: float) -> _Made | None:
        """Call a function and return its value, or None if a share of the time is over before."""
        return self._attempt(make, self._scale(share))

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
