"""Learned policies on layouts that they have not seen, as a table."""

from __future__ import annotations

import statistics
from collections.abc import Sequence

from skillplan.records.training.layouts_result import LayoutsResult
from skillplan.task.task import Task
from skillplan.views.text.table import Column, Table
from skillplan.views.text.wording import number, percent


def layouts_table(result: LayoutsResult, task: Task) -> Table:
    """Return a row for every layout.

    Parameters
    ----------
    result
        What became of all layouts.
    task
        The task of the file, whose costs are in the same metric.
    """
    unit, decimals = task.metric.unit, task.metric.decimals
    columns = [
        Column("layout"),
        Column(f"optimum [{unit}]" if unit else "optimum", right=True),
        Column("proof [s]", right=True),
        Column("complete", right=True),
        Column("least dev.", right=True),
        Column("mean dev.", right=True),
        Column("most dev.", right=True),
        Column("answer [s]", right=True),
    ]
    rows = [
        [
            row.name,
            number(row.optimum.cost, decimals),
            number(row.optimum.wall_s, 4),
            f"{row.completed} of {len(row.answers)}",
            *_spread(row.deviations),
            number(statistics.median(row.answer_s) if row.answer_s else None, 4),
        ]
        for row in result.rows
    ]
    learned = f"{result.learned_on} others" if result.learned_on else "the file's own"
    count = f"{len(result.rows)} layout" if len(result.rows) == 1 else f"{len(result.rows)} layouts"
    title = f"{task.name}: {count} that no run has seen, learned on {learned}"
    return Table(title, columns, rows, _notes(result))


def _notes(result: LayoutsResult) -> list[str]:
    notes = []
    complete, off = result.complete_share, result.deviation_iqm
    if complete is not None and complete.low is not None and complete.high is not None:
        answers = sum(len(row.answers) for row in result.rows)
        notes.append(
            f"complete   {100 * complete.value:.1f} % (95 %: {100 * complete.low:.1f} to "
            f"{100 * complete.high:.1f} %) of {answers:,} answers; {result.at_most(0.01):,} "
            "within 1 % of the optimum"
        )
    if off is not None:
        note = f"deviation  interquartile mean over the layouts {percent(off.value)}"
        if off.low is not None:
            note += f" (95 %: {percent(off.low)} to {percent(off.high)})"
        notes.append(f"{note}, of the answers that complete")
    answer_s, proof_s = result.answer_s, result.proof_s
    if answer_s is not None and proof_s is not None:
        solver = result.rows[0].optimum.solver
        notes.append(
            f"time       a policy answers in {answer_s:.4f} s, {solver} proves its optimum in "
            f"{proof_s:.4f} s (medians, with cold caches)"
        )
        if result.training_s is not None:
            useful = complete is not None and complete.value > 0
            saved_s = proof_s - answer_s if useful else 0.0
            notes.append(_pays_off(result.training_s, saved_s, useful))
    return notes


def _pays_off(training_s: float, saved_s: float, useful: bool) -> str:
    """Return after how many layouts the time of training is saved."""
    note = f"training   took {training_s:.1f} s for all runs, which"
    if not useful:
        return f"{note} does not pay off: no answer completes the task"
    if saved_s <= 0:
        return f"{note} never pays off here: a proof is no slower than a policy"
    return f"{note} pays off after {training_s / saved_s:,.0f} layouts"


def _spread(values: Sequence[float]) -> list[str]:
    if not values:
        return ["N/A"] * 3
    return [percent(min(values)), percent(statistics.fmean(values)), percent(max(values))]
