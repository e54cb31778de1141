"""Detectors side by side: what ``skillplan compare --detectors`` does."""

from __future__ import annotations

import time

from skillplan.cli.counting import counting
from skillplan.cli.load import load_file, make_setup
from skillplan.cli.options.shared import BackEnds, Reading
from skillplan.cli.options.values import split_names
from skillplan.cli.output import emit
from skillplan.errors import OptionError, exit_code
from skillplan.records.execution.comparisons import detectors_document
from skillplan.trials.detector_trials import try_detectors
from skillplan.views.tables.trials import detectors_tables


def compare_detectors(
    path: str,
    back_ends: BackEnds,
    reading: Reading,
    *,
    staged: int,
    time_limit_s: float | None,
    style: str,
) -> int:
    """Try detectors on executions of a task and print their verdicts; return the exit code.

    Parameters
    ----------
    path
        Of the task file.
    back_ends
        With the names of the detectors.
    reading
        How the task file is read.
    staged
        How many collisions are injected at most, >= 0.
    time_limit_s
        After how long to be content with what is known [s].
    style
        How to print.

    Raises
    ------
    OptionError
        If no detector is named, or the task has no bodies.
    """
    if not split_names(back_ends.collision or ""):
        raise OptionError("--detectors names no detector.")
    task = load_file(path, reading, back_ends).tasks[-1]
    setup = make_setup(back_ends, task, with_chart=False)
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
    return exit_code(interrupted=count.interrupted)
