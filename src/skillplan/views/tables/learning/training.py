"""The table of several training runs: Table III of Moller et al., and what it amounts to."""

from __future__ import annotations

from collections.abc import Callable

from skillplan.records.interval import Estimate
from skillplan.records.training.outcome import RECENT_STEPS, RunOutcome, Tally
from skillplan.records.training.published_runs import SUCCESS_RATE
from skillplan.records.training.result import TrainingResult
from skillplan.solvers.gap import deviation
from skillplan.views.tables.learning.layouts import layouts_table
from skillplan.views.tables.learning.shortfall import shortfall_notes
from skillplan.views.tables.results import not_checked_notes
from skillplan.views.text.table import Column, Table
from skillplan.views.text.wording import count, number, percent

NONE = "N/A"
"""Stands for the sequence of a run that does not complete the task, as in the paper."""
_MOST_NAMED = 10


def training_tables(result: TrainingResult) -> list[Table]:
    """Return a row for every run, beside the paper's where the task is the paper's."""
    metric = result.task.metric
    cost = metric.heading
    chance = result.chance
    seen = f"best seen [{metric.unit}]" if metric.unit else "best seen"
    columns = [Column("run", right=True), Column("seed", right=True)]
    columns += [Column("sequence", below=True)]
    columns += [Column(f"expected {cost}" if chance else cost, right=True)]
    columns += [Column("deviation", right=True), Column("success", right=True)]
    if result.sampling is not None:
        columns.append(Column("in training", right=True))
    columns += [Column(seen, right=True), Column("first at step", right=True)]
    if result.published:
        columns += [Column("paper [m]", right=True), Column("paper dev.", right=True)]
    rows = [_row(result, index, one) for index, one in enumerate(result.outcomes)]
    runs = count(len(result.outcomes), "run")
    title = f"{result.task.name}: {runs} of {result.learner}, {result.steps:,} steps each"
    for key in ("observation", "mask"):
        if key in result.options:
            title += f", {key} {result.options[key]}"
    title += f"; physics {result.physics}, collision {result.collision or 'none'}"
    table = Table(title, columns, rows, _notes(result))
    # The most particular table comes last: it is what CSV holds.
    return (
        [table] if result.layouts is None else [layouts_table(result.layouts, result.task), table]
    )


def _row(result: TrainingResult, index: int, one: RunOutcome) -> list[str]:
    decimals, greedy = result.task.metric.decimals, one.greedy
    shown = greedy is not None and greedy.complete
    sequence = NONE if greedy is None or not shown else ",".join(map(str, greedy.actions))
    off = deviation(one.cost, result.optimum.cost)
    cells = [str(one.run), str(one.seed), sequence]
    cells += [number(one.cost, decimals) if shown else NONE]
    cells += [percent(off) if shown else NONE, _rate(one.tally)]
    if result.sampling is not None:
        cells.append("-" if one.training is None else _rate(one.training.recent))
    first = None if one.training is None else one.training.first_success_step
    cells += [number(one.best_cost_seen, decimals), "-" if first is None else f"{first:,}"]
    if result.published:
        theirs = result.published[index] if index < len(result.published) else None
        if theirs is None:
            cells += ["-", "-"]
        elif theirs.cost is None:
            cells += [NONE, NONE]
        else:
            cells += [number(theirs.cost, 3), percent(theirs.deviation)]
    return cells


def _notes(result: TrainingResult) -> list[str]:
    task = result.task
    notes = [_optimum_note(result), *not_checked_notes(result.optimum.not_checked)]
    notes.append(_runs_note(result))
    off, cost = result.deviation_iqm, result.cost_iqm
    if off is not None:
        notes.append(f"deviation  interquartile mean {_interval(off, percent)}")
    elif cost is not None:
        notes.append(f"cost       interquartile mean {_interval(cost, task.cost_text)}")
    if off is not None or cost is not None:
        notes[-1] += f", of the {count(result.completed, 'run')} that complete"
    notes += _success_notes(result)
    if result.best_seen is not None:
        note = f"best seen  {task.cost_text(result.best_seen)} while learning"
        seen_off = deviation(result.best_seen, result.seen_optimum)
        notes.append(note if seen_off is None else f"{note}, deviation {percent(seen_off)}")
    notes += _baseline_notes(result) + _paper_notes(result)
    faults = [one for one in result.outcomes if one.reason]
    for one in faults[:_MOST_NAMED]:
        notes.append(f"run {one.run:<7}{one.status.value}: {one.reason}")
    if len(faults) > _MOST_NAMED:
        notes.append(f"runs       {len(faults) - _MOST_NAMED} more do not complete")
    if result.warm_start is not None:
        notes.append(f"begun      {result.warm_start.text}")
    notes += shortfall_notes(result)
    if result.interrupted:
        notes.append("stopped    before all steps were done; train --resume goes on")
    notes += result.notes
    effort = f"{count(result.checks, 'check')}, {count(result.executions, 'execution')}"
    notes.append(f"effort     {effort}, {result.wall_s:.1f} s")
    if result.steps_per_s is not None:
        notes[-1] += f", {result.steps_per_s:,.0f} steps/s"
    return notes


def _optimum_note(result: TrainingResult) -> str:
    best = result.optimum
    if best.cost is None:
        return f"optimum    not proved: {best.reason}"
    what = "expected, " if result.chance else ""
    note = f"optimum    {result.task.cost_text(best.cost)}, {what}proved by {best.solver}"
    return note if best.wall_s is None else f"{note} in {best.wall_s:.2f} s"


def _runs_note(result: TrainingResult) -> str:
    total = len(result.outcomes)
    note = f"runs       {result.completed} of {total} complete"
    if result.optimum.cost is not None:
        note += f", {result.at_most(0.5e-4)} at 0.00 % ({result.at_most(0.0)} at the optimum "
        note += f"itself), {result.at_most(0.01)} within 1 %"
    return f"{note}, {len(result.failed)} failed" if result.failed else note


def _success_notes(result: TrainingResult) -> list[str]:
    notes = []
    if result.sampling is not None and result.success.estimate is not None:
        drawn = result.sampling
        notes.append(
            f"success    {_interval(result.success.estimate, _one_decimal)} of "
            f"{count(result.success.episodes, 'sampled roll-out')}, temperature "
            f"{drawn.temperature:g}, seed {drawn.seed}"
        )
        spread = result.success_iqm
        if spread is not None and len(result.outcomes) > 1:
            notes[-1] += f"; interquartile mean of the runs {_interval(spread, _one_decimal)}"
    trained = result.training_success
    if trained.estimate is not None:
        notes.append(
            f"training   {_interval(trained.estimate, _one_decimal)} of the "
            f"{count(trained.episodes, 'episode')} that ended in the last {RECENT_STEPS:,} steps "
            "of a run completed the task"
        )
    return notes


def _baseline_notes(result: TrainingResult) -> list[str]:
    base = result.baseline
    if base is None or base.tally.estimate is None:
        return []
    rate = _interval(base.tally.estimate, _one_decimal)
    note = f"random     {rate} of {count(base.tally.episodes, 'episode')} of even chance, mask "
    note += base.mask
    if base.best_cost is not None:
        off = deviation(base.best_cost, result.episode_optimum)
        note += f"; the best costs {result.task.cost_text(base.best_cost)}"
        note += "" if off is None else f", deviation {percent(off)}"
    return [note]


def _paper_notes(result: TrainingResult) -> list[str]:
    theirs = result.published
    if not theirs:
        return []
    complete = [one for one in theirs if one.cost is not None]
    at_optimum = sum(one.deviation == 0 for one in complete)
    return [
        f"paper      Moller et al., Table III: {len(complete)} of {len(theirs)} complete, "
        f"{at_optimum} at 0.00 %; success about {100 * SUCCESS_RATE:.0f} %"
    ]


def _interval(one: Estimate, text: Callable[[float], str]) -> str:
    if one.low is None or one.high is None:
        return text(one.value)
    return f"{text(one.value)} (95 %: {text(one.low)} to {text(one.high)})"


def _one_decimal(fraction: float) -> str:
    return f"{100 * fraction:.1f} %"


def _rate(tally: Tally) -> str:
    return "-" if tally.rate is None else _one_decimal(tally.rate)
