"""Detectors side by side: what ``skillplan compare --detectors`` does."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection
from typing import Any

from skillplan.cli.counting import counting
from skillplan.cli.options import split_names
from skillplan.cli.output import emit
from skillplan.errors import EXIT_INTERRUPTED, EXIT_SOLVED, OptionError
from skillplan.pipeline.setup import load_problem
from skillplan.records.detectors import detectors_document
from skillplan.trials.detector_trials import try_detectors
from skillplan.views.tables.detectors import detectors_tables


def compare_detectors(
    path: str,
    detectors: str,
    asked: dict[str, Collection[str]],
    changes: dict[str, str],
    make_setup: Callable[[str], Callable[[Any], Any]],
    *,
    staged: int,
    time_limit_s: float | None,
    style: str,
) -> int:
    """Try detectors on executions of a task and print what they rule; returns the exit code.

    Parameters
    ----------
    path
        Of the task file.
    detectors
        Names, separated by commas.
    asked
        What the command line chooses besides, by kind.
    changes
        Of the task file.
    make_setup
        Returns, for names of detectors, what makes the setup of a task.
    staged
        How many collisions are staged at most, >= 0.
    time_limit_s
        After how long to be content with what is known [s].
    style
        How to print.

    Raises
    ------
    OptionError
        If no detector is named, or the task has no bodies.
    """
    names = split_names(detectors)
    if not names:
        raise OptionError("--detectors names no detector.")
    task = load_problem(path, {**asked, "collision": names}, changes).tasks[-1]
    setup = make_setup(",".join(names))(task)
    if not task.scene.bodies:
        raise OptionError(f"{task.name!r} has no bodies: there is nothing to collide.")
    begin_s = time.monotonic()
    with counting("trials", None) as count:

        def stopped() -> bool:
            late = time_limit_s is not None and time.monotonic() - begin_s > time_limit_s
            return count.interrupted or late

        trials = try_detectors(task, setup.back_ends, staged, note=count.one_more, stopped=stopped)
    document = detectors_document(trials, time.monotonic() - begin_s)
    emit(style, document, detectors_tables(trials))
    return EXIT_INTERRUPTED if count.interrupted else EXIT_SOLVED
