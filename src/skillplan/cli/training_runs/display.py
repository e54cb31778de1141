"""While runs learn: how they stand on stderr, and Ctrl-C as a request to stop."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from skillplan.cli.interruption import heeding
from skillplan.records.optimum import Optimum
from skillplan.solvers.gap import deviation
from skillplan.training.groups import GroupReport
from skillplan.training.training_plan import TrainingPlan
from skillplan.views.text.wording import escaped


class TrainingDisplay:
    """Time left, and episodes, success rate, best cost, gap and speed; on a terminal only.

    Parameters
    ----------
    plan
        What is trained.
    """

    def __init__(self, plan: TrainingPlan) -> None:
        self._sizes = [len(group) for group in plan.groups]
        self._reports: dict[int, GroupReport] = {}
        self._first: dict[int, int] = {}
        self._begun_s = time.monotonic()
        self._optimum: float | None = None
        self._bar: Any = None
        self._live: Any = None
        if sys.stderr.isatty():
            self._show(f"{plan.solver}, {len(plan.seeds)} runs", plan.steps * len(plan.seeds))

    def _show(self, label: str, total: int) -> None:
        # Here and not above: only a terminal pays for importing this.
        from rich.console import Console, Group
        from rich.live import Live
        from rich.progress import (
            BarColumn,
            Progress,
            TaskProgressColumn,
            TextColumn,
            TimeElapsedColumn,
            TimeRemainingColumn,
        )
        from rich.text import Text

        self._bar = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(bar_width=20),
            TaskProgressColumn(),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
        )
        self._line = self._bar.add_task(escaped(label), total=total)
        # The figures stand below: beside the bar they would not fit a narrow terminal.
        self._live = Live(
            get_renderable=lambda: Group(self._bar, Text(self.figures())),
            console=Console(stderr=True),
            transient=True,
        )

    def __enter__(self) -> TrainingDisplay:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            self._live.stop()

    def proved(self, optimum: Optimum) -> None:
        """Take note of what the task costs at least."""
        self._optimum = optimum.cost

    def report(self, report: GroupReport) -> None:
        """Take note of how a group stands, and show it."""
        if report.group not in self._reports:
            self._first[report.group] = report.steps
        self._reports[report.group] = report
        if self._bar is not None:
            sizes = self._sizes
            done = sum(one.steps * sizes[one.group] for one in self._reports.values())
            self._bar.update(self._line, completed=done)

    def figures(self) -> str:
        """Return how all groups stand together, in a line."""
        # Another thread shows this while reports come in.
        reports = list(self._reports.values())
        successes, recent = (sum(one.recent[i] for one in reports) for i in (0, 1))
        parts = [f"{sum(one.episodes for one in reports):,} episodes"]
        if recent:
            parts.append(f"{100 * successes / recent:.0f} % success")
        costs = [one.best_cost for one in reports if one.best_cost is not None]
        if costs:
            parts.append(f"best {min(costs):.5f}")
            gap = deviation(min(costs), self._optimum)
            parts += [] if gap is None else [f"gap {100 * gap:.2f} %"]
        here = sum((one.steps - self._first[one.group]) * self._sizes[one.group] for one in reports)
        passed_s = time.monotonic() - self._begun_s
        if here and passed_s > 0:
            parts.append(f"{here / passed_s:,.0f} steps/s")
        executions = sum(one.executions for one in reports)
        return "  ".join([*parts, *([f"{executions:,} checks"] if executions else [])])


def derived_words(plan: TrainingPlan) -> str:
    """Return the values that were derived from the task, in one line."""
    values = ", ".join(f"{name} {_word(value)}" for name, value in plan.derived.items())
    return f"derived from the task: {values}"


def _word(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:,.6g}" if isinstance(value, int | float) else str(value)


@contextmanager
def displaying(plan: TrainingPlan, interrupt: Callable[[], None]) -> Iterator[TrainingDisplay]:
    """Yield a display that heeds Ctrl-C and SIGTERM.

    The first ends the training early through `interrupt`; the second ends the program.
    """
    with TrainingDisplay(plan) as display, heeding(interrupt):
        yield display
