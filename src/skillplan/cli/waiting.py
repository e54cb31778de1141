"""Progress of a search on stderr, and Ctrl-C as a request to stop it."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from skillplan.checks.feasibility import CheckCount
from skillplan.cli.interruption import handle_signals
from skillplan.errors import OptionError
from skillplan.solvers.solution import relative_gap
from skillplan.solvers.stop import Progress, Stop
from skillplan.views.text.wording import escape
from skillplan.workers.processes import measure_resident_bytes


@contextmanager
def stoppable(
    time_limit_s: float | None,
    gap: float = 0.0,
    label: str = "searching",
    *,
    stall_s: float | None = None,
    memory_limit_bytes: int | None = None,
) -> Iterator[Stop]:
    """Yield a stop that shows progress and stops at Ctrl-C and SIGTERM.

    The first signal ends the search with its best plan; the second ends the program. The limits are
    documented at `Stop`.

    Raises
    ------
    OptionError
        If memory is limited, and the system does not report the size of a process.
    """
    if memory_limit_bytes is not None and measure_resident_bytes() is None:
        raise OptionError(
            "--memory-limit cannot be kept: this system does not report the size of a process."
        )
    with _display(label) as show:
        stop = Stop(
            time_limit_s=time_limit_s,
            gap=gap,
            stall_s=stall_s,
            memory_limit_bytes=memory_limit_bytes,
            on_progress=show,
        )
        with handle_signals(stop.interrupt):
            yield stop


@contextmanager
def show_checks(label: str) -> Iterator[Callable[[CheckCount], None] | None]:
    """Yield a function that shows the number of expensive checks; None without a terminal."""
    with _display(label) as show:
        if isinstance(show, _Silent):
            yield None
        else:
            yield lambda count: show(Progress(None, None, 0, count))


class _Silent:
    def __call__(self, progress: Progress) -> None:
        """Show nothing: stderr is not a terminal."""


@contextmanager
def _display(label: str) -> Iterator[_Silent | _Bar]:
    if not sys.stderr.isatty():
        yield _Silent()
        return
    bar = _Bar(label)
    with bar.progress:
        yield bar


def format_progress(progress: Progress) -> str:
    """Return the figures of a search: cost, bound, gap, nodes and their speed, checks."""
    decimals = 5 if progress.decimals is None else progress.decimals
    parts = []
    if progress.best_cost is not None:
        parts.append(f"best {progress.best_cost:.{decimals}f}")
    if progress.lower_bound is not None and math.isfinite(progress.lower_bound):
        # A bound may lie between two integer costs; it is not rounded up.
        shown = math.floor(progress.lower_bound * 10**decimals + 1e-6) / 10**decimals
        parts.append(f"bound {shown:.{decimals}f}")
    gap = relative_gap(progress.best_cost, progress.lower_bound)
    if gap is not None:
        parts.append(f"gap {100 * gap:.2f} %")
    count = progress.queries
    if progress.nodes or count is None:
        parts.append(f"{progress.nodes:,} nodes")
        if progress.nodes_per_s is not None:
            parts.append(f"{progress.nodes_per_s:,.0f} nodes/s")
    if count is not None:
        parts.append(f"{count.checks:,} checks, {count.hits:,} reused, {count.to_go:,} to go")
    return "  ".join(parts)


class _Bar:
    """A line with the time and the figures of a search.

    A search may report thousands of times a second. The last report is formatted only when the
    line is drawn again.
    """

    def __init__(self, label: str) -> None:
        # Imported here because only a terminal needs it.
        from rich.console import Console
        from rich.progress import Progress as RichProgress
        from rich.progress import ProgressColumn, SpinnerColumn, TextColumn, TimeElapsedColumn
        from rich.text import Text

        bar = self

        class Figures(ProgressColumn):
            def render(self, task: object) -> Text:
                return Text("" if bar.latest is None else format_progress(bar.latest))

        self.latest: Progress | None = None
        self.progress = RichProgress(
            SpinnerColumn(),
            TextColumn("{task.description}", markup=False),
            TimeElapsedColumn(),
            Figures(),
            console=Console(stderr=True),
            transient=True,
        )
        self.progress.add_task(escape(label), total=None)

    def __call__(self, progress: Progress) -> None:
        """Show the figures, as soon as the line is drawn again."""
        self.latest = progress
