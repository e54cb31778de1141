"""While a search runs: progress on stderr, and Ctrl-C as a request to stop."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from skillplan.cli.interruption import heeding
from skillplan.model.feasibility import CheckCount
from skillplan.solvers.stop import Progress, Stop, relative_gap


@contextmanager
def stoppable(
    time_limit_s: float | None, gap: float = 0.0, label: str = "searching"
) -> Iterator[Stop]:
    """Yield a stop that shows progress and heeds Ctrl-C and SIGTERM.

    The first asks the search for the best it has; the second ends the program.
    """
    with _display(label) as show:
        stop = Stop(time_limit_s=time_limit_s, gap=gap, on_progress=show)
        with heeding(stop.interrupt):
            yield stop


@contextmanager
def showing_checks(label: str) -> Iterator[Callable[[CheckCount], None] | None]:
    """Yield what shows on a terminal how far the asking of dear back ends has come, or None."""
    with _display(label) as show:
        if isinstance(show, _Silent):
            yield None
        else:
            yield lambda asked: show(Progress(None, None, 0, asked))


class _Silent:
    def __call__(self, progress: Progress) -> None:
        """Show nothing: stderr is no terminal."""


@contextmanager
def _display(label: str) -> Iterator[_Silent | _Bar]:
    if not sys.stderr.isatty():
        yield _Silent()
        return
    bar = _Bar(label)
    with bar.progress:
        yield bar


class _Bar:
    """A line with the time, the best cost, the bound, the gap, the nodes and the checks."""

    def __init__(self, label: str) -> None:
        # Here and not above: only a terminal pays for importing this.
        from rich.console import Console
        from rich.progress import Progress as RichProgress
        from rich.progress import SpinnerColumn, TextColumn, TimeElapsedColumn

        self.progress = RichProgress(
            SpinnerColumn(),
            TextColumn("{task.description}", markup=False),
            TimeElapsedColumn(),
            TextColumn("{task.fields[figures]}", markup=False),
            console=Console(stderr=True),
            transient=True,
        )
        self._line = self.progress.add_task(label, total=None, figures="")

    def __call__(self, progress: Progress) -> None:
        """Show the figures."""
        parts = []
        if progress.best_cost is not None:
            parts.append(f"best {progress.best_cost:.5f}")
        if progress.lower_bound is not None:
            parts.append(f"bound {progress.lower_bound:.5f}")
        gap = relative_gap(progress.best_cost, progress.lower_bound)
        if gap is not None:
            parts.append(f"gap {100 * gap:.2f} %")
        asked = progress.asked
        if progress.nodes or asked is None:
            parts.append(f"{progress.nodes:,} nodes")
        if asked is not None:
            parts.append(f"{asked.checks:,} checks, {asked.hits:,} reused, {asked.to_go:,} to go")
        self.progress.update(self._line, figures="  ".join(parts))
