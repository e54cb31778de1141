"""Several trainings side by side: a row for each."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from skillplan.records.interval import Estimate
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
        Column("seeds"),
        Column("runs", right=True),
        Column("steps", right=True),
        Column("complete", right=True),
        Column("of all, 95 %", right=True),
        Column("optimal", right=True),
        Column("deviation", right=True),
        Column("cost", right=True),
        Column("success", right=True),
        Column("best seen", right=True),
    ]
    title = f"{len(results)} trainings side by side"
    notes = [
        "deviation, cost and success are interquartile means of the runs, with 95 % intervals of "
        "the bootstrap where there are several; the share that completes has Wilson's"
    ]
    notes += [f"{one.run_dir}: interrupted" for one in results if one.interrupted]
    return Table(title, columns, [_row(one) for one in results], notes)


def _row(result: TrainingResult) -> list[str]:
    optimal, decimals = result.at_most(0.0), result.task.metric.decimals
    return [
        result.run_dir,
        result.task.name,
        result.learner,
        _seeds([one.seed for one in result.outcomes]),
        str(len(result.outcomes)),
        f"{result.steps:,}",
        str(result.completed),
        _figure(result.completion, _whole),
        _ABSENT if optimal is None else str(optimal),
        _figure(result.deviation_iqm, percent),
        _figure(result.cost_iqm, lambda cost: number(cost, decimals)),
        _figure(result.success_iqm, percent),
        number(result.best_seen, decimals),
    ]


def _figure(one: Estimate | None, text: Callable[[float], str]) -> str:
    if one is None:
        return _ABSENT
    if one.low is None or one.high is None:
        return text(one.value)
    return f"{text(one.value)} [{text(one.low)}, {text(one.high)}]"


def _whole(fraction: float) -> str:
    return f"{100 * fraction:.0f} %"


def _seeds(seeds: Sequence[int]) -> str:
    """Return the seeds, neighbours as a range."""
    ranges: list[list[int]] = []
    for seed in sorted(seeds):
        if ranges and seed == ranges[-1][1] + 1:
            ranges[-1][1] = seed
        else:
            ranges.append([seed, seed])
    return ", ".join(f"{a}" if a == b else f"{a}-{b}" for a, b in ranges) or _ABSENT
