"""Pictures made and handed on beside a simulation, in the order in which they were taken."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from types import TracebackType
from typing import Generic, TypeVar

from skillplan.physics.performance import Image

T = TypeVar("T")
Shot = Callable[[], Image]

# So much may wait for its turn; then the simulation does.
_MOST_WAITING = 8


class Film:
    """Makes pictures on one thread and shows them on another; to be used as a context manager.

    What goes wrong there is raised at the next picture, or at the end.

    Parameters
    ----------
    show
        Is given every picture.
    """

    def __init__(self, show: Callable[[Image], None]) -> None:
        self._shown = _Stage(show)
        self._made: _Stage[Shot] = _Stage(lambda shot: self._shown.add(shot()))

    def __enter__(self) -> Film:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Wait for the last picture."""
        self._made.end()
        self._shown.end()
        if error is None:
            self._made.complain()
            self._shown.complain()

    def add(self, shot: Shot) -> None:
        """Have a picture made after those before."""
        self._made.add(shot)


class _Stage(Generic[T]):
    """Does one thing after another on a thread of its own."""

    def __init__(self, work: Callable[[T], None]) -> None:
        self._work = work
        self._waiting: queue.Queue[T | None] = queue.Queue(_MOST_WAITING)
        self._wrong: BaseException | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def add(self, item: T) -> None:
        """Have something done after what was before; raise what went wrong so far."""
        self.complain()
        self._waiting.put(item)

    def end(self) -> None:
        """Wait until all is done."""
        self._waiting.put(None)
        self._thread.join()

    def complain(self) -> None:
        """Raise what went wrong, once."""
        if self._wrong is not None:
            wrong, self._wrong = self._wrong, None
            raise wrong

    def _run(self) -> None:
        is_failed = False
        while (item := self._waiting.get()) is not None:
            if not is_failed:
                try:
                    self._work(item)
                except BaseException as error:  # raised where the simulation is
                    self._wrong, is_failed = error, True
