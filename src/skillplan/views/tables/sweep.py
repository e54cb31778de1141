"""Tables of a parameter study: a row for every setting, or for every setting and start."""

from __future__ import annotations

from collections.abc import Sequence

from skillplan.records.interval import Estimate
from skillplan.records.sweep.plan import (
    AIMS,
    ONE_AT_A_TIME,
    SampledPlan,
    format_setting,
    format_value,
)
from skillplan.records.sweep.result import StartSummary, SweepResult
from skillplan.views.text.table import Column, ItemList, Table

_MOST_NAMED = 10
# Number of shown settings that a sampler chose, best first.
_MOST_SAMPLED = 20
# Longest name of a start in a heading.
_SHORT = 12


def tabulate_settings(result: SweepResult) -> Table:
    """Return a row for every setting: mean steps from each start, and share of complete runs.

    If a sampler chose the settings, only the best are shown.
    """
    plan = result.plan
    sampled = isinstance(plan, SampledPlan)
    starts = [start.name for start in plan.starts]
    shorts = _shorten_names(starts)
    columns = [Column("trial", right=True)] if sampled else []
    columns += [Column(axis.option, right=axis.numeric) for axis in plan.axes]
    columns += [Column("runs", right=True)]
    columns += [
        Column(name, right=True, short=short) for name, short in zip(starts, shorts, strict=True)
    ]
    columns += [Column("all arrive", right=True), Column("95 % of runs", right=True)]
    columns += [Column("all at optimum", right=True), Column("95 % of runs", right=True)]
    columns += [Column("excess", right=True), Column("learning [s]", right=True)]
    rows = []
    # Costs in steps need fewer decimals than metres and seconds.
    decimals = 2 if plan.cost_unit in ("", "steps") else 5
    shown = plan.settings[:_MOST_SAMPLED] if sampled else plan.settings
    for index, setting in enumerate(shown):
        every = result.summary([index])
        sampled_runs = result.sampled([index])
        rows.append(
            [
                *([str(plan.about(index)["trial"])] if sampled else []),
                *(format_value(setting[axis.option]) for axis in plan.axes),
                str(every.runs),
                *(_format_steps(result.summary([index], name)) for name in starts),
                str(every.arrived),
                _format_percent(every.arrived_share, sampled=sampled_runs),
                "-" if every.best is None else str(every.best),
                _format_percent(every.best_share, sampled=sampled_runs),
                _format_plus_minus(every.excess, decimals, every.arrived if sampled_runs else 1),
                _format_plus_minus(every.learning_s, 3, every.runs),
            ]
        )
    title = f"{plan.name}: {plan.solver}, {_describe_shape(result)}"
    named = (
        [] if shorts == starts else [ItemList("starts:", list(zip(shorts, starts, strict=True)))]
    )
    return Table(title, columns, rows, _write_notes(result), named)


def _shorten_names(starts: Sequence[str]) -> list[str]:
    """Return names for headings: places, or numbers instead of whole states."""
    if all(len(name) <= _SHORT for name in starts):
        return list(starts)
    if len(starts) == 1:
        return ["start"]
    return [f"start {number}" for number, _ in enumerate(starts, 1)]


def tabulate_starts(result: SweepResult) -> Table:
    """Return a row for every setting and start, with the ends of all intervals."""
    plan = result.plan
    columns = [Column(axis.option, right=axis.numeric) for axis in plan.axes]
    excess = f"excess [{plan.cost_unit}]" if plan.cost_unit else "excess"
    figures = ("steps", excess, "learning [s]")
    headings = ["runs", "arrived", "share", "share low", "share high", "at optimum"]
    for figure in figures:
        headings += [figure, f"{figure} low", f"{figure} high"]
    columns += [Column("start"), Column("optimum", right=True)]
    columns += [Column(heading, right=True) for heading in headings]
    rows = []
    for index, setting in enumerate(plan.settings):
        for start in plan.starts:
            summary = result.summary([index], start.name)
            cells = [format_value(setting[axis.option]) for axis in plan.axes]
            cells += [
                start.name,
                _format_number(start.optimum),
                str(summary.runs),
                str(summary.arrived),
            ]
            cells += _format_ends(summary.arrived_share)
            cells.append("" if summary.best is None else str(summary.best))
            for estimate in (summary.steps, summary.excess, summary.learning_s):
                cells += _format_ends(estimate)
            rows.append(cells)
    return Table(f"{plan.name}: {plan.solver}, by start", columns, rows)


def _describe_shape(result: SweepResult) -> str:
    plan = result.plan
    if isinstance(plan, SampledPlan):
        return f"{len(plan.settings)} trials of {len(plan.seeds)} runs, chosen by {plan.sampler}"
    runs = f"{len(plan.settings)} settings of {len(plan.seeds)} runs"
    return f"{runs}, {plan.design}" if plan.axes else runs


def _write_notes(result: SweepResult) -> list[str]:
    plan = result.plan
    optima = [f"{start.name} {_format_number(start.optimum) or '?'}" for start in plan.starts]
    unit = f" {plan.cost_unit}" if plan.cost_unit else ""
    notes = [
        "starts     mean steps of the runs that arrive; in brackets how many, where not all do; "
        f"a run that takes more than {plan.step_limit:,} steps has not arrived",
        f"optimum    {', '.join(optima)}{unit}, proved by exact search",
        "excess     mean cost above the optimum, summed over the starts, of the runs that arrive "
        "from all",
        "intervals  95 %: Wilson for shares, Student's t for means of 3 runs or more; of fewer the "
        "table gives their number n",
    ]
    if not plan.seeded:
        notes[-1] = f"intervals  of times only: {plan.solver} does not depend on the seed"
    elif not result.sampled(range(len(plan.settings))):
        notes[-1] += "; deterministic: seeds of a planner do not form a sample"
    if plan.design == ONE_AT_A_TIME and plan.axes:
        notes.append(f"centre     {format_setting(plan.centre)}")
    if isinstance(plan, SampledPlan):
        notes += _describe_sampled(plan)
    fixed = [
        f"{plugin}.{key} = {value}"
        for plugin, kv in plan.fixed.items()
        for key, value in kv.items()
    ]
    if fixed:
        notes.append(f"fixed      {', '.join(fixed)}")
    if result.shared:
        notes.append(
            "learning   once for each setting and seed: one policy answers from all starts"
        )
    if result.missing:
        notes.append(f"missing    {result.missing} of the runs have not been done")
    failed = result.failed
    for record in failed[:_MOST_NAMED]:
        setting = format_setting(plan.settings[record.setting])
        notes.append(f"failed     {setting}, seed {record.seed}: {record.error}")
    if len(failed) > _MOST_NAMED:
        notes.append(f"failed     {len(failed) - _MOST_NAMED} more runs; --format json names all")
    return notes


def _describe_sampled(plan: SampledPlan) -> list[str]:
    """Return notes on settings that a sampler chose."""
    notes = [
        f"minimised  {AIMS[plan.minimise]}; the share of runs that do not arrive counts first",
        "chosen     by the order in which runs end: not to be repeated or resumed bit for bit",
    ]
    if len(plan.tried) > _MOST_SAMPLED:
        notes.append(f"shown      the best {_MOST_SAMPLED}; --format json has all")
    if plan.tried and plan.tried[0].value is not None:
        best = " ".join(f"-O {key}={format_value(kv)}" for key, kv in plan.settings[0].items())
        notes.insert(0, f"best       trial {plan.tried[0].trial.number}: {best}")
    return notes


def _format_steps(summary: StartSummary) -> str:
    if summary.steps is None:
        return "-" if not summary.runs else f"- (0/{summary.runs})"
    text = f"{summary.steps.value:.2f}"
    if summary.arrived == summary.runs:
        return text
    return f"{text} ({summary.arrived}/{summary.runs})"


def _format_percent(estimate: Estimate | None, *, sampled: bool) -> str:
    if estimate is not None and not sampled:
        return "deterministic"
    if estimate is None or estimate.low is None or estimate.high is None:
        return "-"
    return f"{100 * estimate.low:.0f} to {100 * estimate.high:.0f} %"


def _format_plus_minus(estimate: Estimate | None, decimals: int, runs: int) -> str:
    if estimate is None:
        return "-"
    text = f"{estimate.value:.{decimals}f}"
    if estimate.high is None:
        return text if runs == 1 else f"{text} (n = {runs})"
    return f"{text} ± {estimate.high - estimate.value:.{decimals}f}"


def _format_ends(estimate: Estimate | None) -> list[str]:
    if estimate is None:
        return ["", "", ""]
    return [
        _format_number(estimate.value),
        _format_number(estimate.low),
        _format_number(estimate.high),
    ]


def _format_number(value: float | None) -> str:
    return "" if value is None else f"{value:.6g}"
