"""The precedence relation that geometry alone gives, for who shows it."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace

from skillplan.chart.precedence_chart import DerivedChart, derive_chart
from skillplan.checks.verdict_cache import VerdictCache
from skillplan.errors import OptionError
from skillplan.pipeline.setup import BOXES, DEFAULT_PHYSICS, SCREEN, Setup
from skillplan.pipeline.solving import make_feasibility
from skillplan.task.task import Task


def geometric_chart(
    task: Task, setup: Setup, cache: VerdictCache | None = None
) -> tuple[DerivedChart, tuple[str, ...]]:
    """Return the relation that detectors of collisions give, and the names of the back ends.

    Parameters
    ----------
    task
        With bodies.
    setup
        Its detectors are queried where it names any; else the swept motions, or boxes where those
        are not installed or do not serve the task. No engine executes anything unless it is named.
    cache
        Where verdicts are kept; a fresh one in memory by default.

    Raises
    ------
    OptionError
        If a detector that was named refuses the task.
    BackEndError
        If a back end fails.
    """
    chosen = replace(
        setup, physics=setup.physics or DEFAULT_PHYSICS, screening=False, with_chart=False
    )
    tried = [chosen.collision] if chosen.collision else [(SCREEN,), (BOXES,)]
    if not chosen.collision and not chosen.has_screen(task):
        tried = [(BOXES,)]
    for names in tried:
        try:
            made = replace(chosen, collision=names).back_ends(task)
            break
        except OptionError:
            if names == tried[-1]:
                raise
    kept = VerdictCache() if cache is None else cache
    with closing(make_feasibility(task, chosen, kept, back_ends=made)) as feasibility:
        chart = derive_chart(feasibility)
        return chart, tuple(back_end.name for back_end in feasibility.back_ends)
