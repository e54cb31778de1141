"""Results as tables: the plan of one solver, and several solvers side by side."""

from __future__ import annotations

from collections.abc import Sequence

from skillplan.model.replay import Step
from skillplan.report.result import Result, Status
from skillplan.report.table import Column, Table
from skillplan.task.motion import Point
from skillplan.task.task import Metric, Task

PROOF = {
    Status.OPTIMAL: "optimal, proved",
    Status.SOLVED: "solved, not proved to be the best",
    Status.INFEASIBLE: "infeasible: proved that there is no plan",
    Status.UNSOLVED: "unsolved",
    Status.REFUSED: "refused",
    Status.WRONG: "WRONG: the solver's claim does not hold",
}


def plan_table(result: Result, task: Task) -> Table:
    """Return the steps of a result's plan, and its figures below."""
    title = f"{result.task}: {result.solver}, physics {result.physics}, collision "
    title += result.collision or "none"
    notes = [f"status     {PROOF[result.status]}" + _because(result)]
    if result.cost is not None:
        actions = ",".join(str(step.action) for step in result.steps)
        notes += [
            f"cost       {task.cost_text(result.cost)}  (lower bound "
            f"{task.cost_text(result.lower_bound)}, gap {percent(result.gap)})",
            f"sequence   {actions}",
            f"makespan   {result.makespan} skills, {number(result.makespan_s, 1)} s",
        ]
    elif result.lower_bound is not None:
        notes.append(f"bound      no plan costs less than {task.cost_text(result.lower_bound)}")
    notes += _trace_notes(result)
    notes.append(
        f"effort     {result.checks} checks, {result.cache_hits} verdicts reused, "
        f"{result.expanded if result.expanded is not None else '-'} nodes, {result.wall_s:.2f} s"
    )
    return Table(title, *step_rows(result.steps, task.metric), notes)


def step_rows(
    steps: Sequence[Step], metric: Metric
) -> tuple[tuple[Column, ...], list[tuple[str, ...]]]:
    """Return columns and rows of the steps of a plan."""
    walks = any(step.place is not None for step in steps)
    columns = (
        Column("step", right=True),
        Column("action", right=True),
        Column("skill"),
        *([Column("to")] if walks else []),
        Column("to x y z [m]", right=True),
        Column(_headed(metric), right=True),
        Column("time [s]", right=True),
    )
    rows: list[tuple[str, ...]] = [
        (
            str(step.index + 1),
            str(step.action),
            step.skill,
            *([step.place or "-"] if walks else []),
            _point(step.goal),
            f"{step.cost:.{metric.decimals}f}",
            f"{step.duration_s:.1f}",
        )
        for step in steps
    ]
    return columns, rows


def _headed(metric: Metric) -> str:
    """Return a metric as a heading, with its unit where that is another word."""
    return metric.name if metric.name == metric.unit else f"{metric.name} [{metric.unit}]"


def comparison_table(results: Sequence[Result], title: str) -> Table:
    """Return several solvers' results side by side."""
    unit = results[0].cost_unit if results else ""
    columns = (
        Column("solver"),
        Column("status"),
        Column(f"cost [{unit}]", right=True),
        Column("gap", right=True),
        Column("makespan", right=True),
        Column("makespan [s]", right=True, below=True),
        Column("checks", right=True),
        Column("iterations", right=True),
        Column("seconds", right=True),
        Column("sequence", below=True),
    )
    rows = [
        (
            result.solver,
            result.status.value,
            number(result.cost, 5),
            percent(result.gap),
            "-" if result.makespan is None else str(result.makespan),
            number(result.makespan_s, 1),
            str(result.checks),
            "-" if result.expanded is None else str(result.expanded),
            f"{result.wall_s:.3f}",
            ",".join(str(step.action) for step in result.steps) or "-",
        )
        for result in results
    ]
    notes = [f"{result.solver}: {result.reason}" for result in results if result.reason]
    for result in results:
        notes += [f"{result.solver}: {note}" for note in _trace_notes(result)]
    return Table(title, columns, rows, notes)


def percent(fraction: float | None) -> str:
    """Return a fraction in per cent with two decimals, or a dash."""
    return "-" if fraction is None else f"{100 * fraction:.2f} %"


def number(value: float | None, decimals: int) -> str:
    """Return a number, or a dash."""
    return "-" if value is None else f"{value:.{decimals}f}"


def _trace_notes(result: Result) -> list[str]:
    by_length = result.trace.get("sequences_by_length")
    if not isinstance(by_length, dict):
        return []
    parts = ", ".join(f"{count:,} of {length}" for length, count in by_length.items())
    worst = result.trace.get("worst_cost_by_length", {})
    ended = result.status in (Status.OPTIMAL, Status.INFEASIBLE)
    so_far = "" if ended else " so far"
    if not parts:
        return [f"sequences  no complete one{so_far}"]
    total = sum(by_length.values())
    notes = [f"sequences  {total:,} complete ones{so_far}: {parts} skills"]
    if worst:
        shortest = min(worst)
        notes.append(
            f"worst      {worst[shortest]:.5f} {result.cost_unit} among those of {shortest} skills"
        )
    return notes


def _because(result: Result) -> str:
    return f" ({result.reason})" if result.reason else ""


def _point(point: Point | None) -> str:
    return "-" if point is None else " ".join(f"{value:.3f}" for value in point)
