"""Several trainings side by side: a row for each."""

from __future__ import annotations

from collections.abc import Sequence

from skillplan.records.training.result import TrainingResult
from skillplan.views.text.table import Column, Table
from skillplan.views.text.wording import number, percent

_ABSENT = "-"


def trainings_table(results: Sequence[TrainingResult]) -> Table:
    """Return a row for every training.

    Parameters
    ----------
    results
        At least one; what each is of stands in its row.
    """
    columns = [
        Column("runs in"),
        Column("task"),
        Column("solver"),
        Column("runs", right=True),
        Column("steps", right=True),
        Column("complete", right=True),
        Column("optimal", right=True),
        Column("deviation", right=True),
        Column("success", right=True),
        Column("best seen", right=True),
    ]
    title = f"{len(results)} trainings side by side"
    notes = ["deviation and success are interquartile means of the runs"]
    notes += [f"{one.run_dir}: interrupted" for one in results if one.interrupted]
    return Table(title, columns, [_row(one) for one in results], notes)


def _row(result: TrainingResult) -> list[str]:
    off, success, optimal = result.deviation_iqm, result.success_iqm, result.at_most(0.0)
    return [
        result.run_dir,
        result.task.name,
        result.solver,
        str(len(result.outcomes)),
        f"{result.steps:,}",
        str(result.completed),
        _ABSENT if optimal is None else str(optimal),
        percent(None if off is None else off.value),
        percent(None if success is None else success.value),
        number(result.best_seen, result.task.metric.decimals),
    ]
