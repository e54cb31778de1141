"""While many runs are done: how many there are on stderr, and Ctrl-C as a request to stop."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from skillplan.cli.interruption import heeding
from skillplan.views.text.wording import escaped


class Count:
    """Counts finished runs, and knows whether to stop.

    Parameters
    ----------
    label
        What is counted.
    total
        How many runs there are, >= 0; None where that shows in the end.

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
        # Here and not above: only a terminal pays for importing this.
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
        self._line = self._bar.add_task(escaped(label), total=total)

    def __enter__(self) -> Count:
        if self._bar is not None:
            self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def stop(self) -> None:
        """End the work early, with what is done."""
        self.interrupted = True

    def one_more(self) -> None:
        """Count a run."""
        if self._bar is not None:
            self._bar.advance(self._line)


@contextmanager
def counting(label: str, total: int | None) -> Iterator[Count]:
    """Yield a count that shows itself on a terminal and heeds Ctrl-C and SIGTERM.

    The first ends the work with what is done; the second ends the program.
    """
    with Count(label, total) as count, heeding(count.stop):
        yield count
