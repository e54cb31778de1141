"""A replayed sequence as a table: its steps, what they cost, and what fails where."""

from __future__ import annotations

from skillplan.records.evaluation import Evaluation
from skillplan.records.result import tolerance
from skillplan.views.tables.results import step_rows, times_note
from skillplan.views.text.table import Table
from skillplan.views.text.wording import percent, yes_no


def evaluation_table(evaluation: Evaluation) -> Table:
    """Return the steps, what they cost, and what fails where."""
    task, walked = evaluation.task, evaluation.walked
    notes = [f"feasible   {yes_no(walked.feasible)}", f"complete   {yes_no(walked.complete)}"]
    if walked.steps:
        what = "cost" if walked.complete else "so far"
        apart = walked.duration_s and not task.metric.is_duration
        lasts = f", {walked.duration_s:.1f} s" if apart else ""
        notes.append(f"{what:<10} {task.cost_text(walked.cost)}{lasts}")
    if evaluation.deviation is not None:
        notes.append(
            f"deviation  {percent(evaluation.deviation)} of the proved optimum "
            f"{task.cost_text(evaluation.optimum)}"
        )
    elif walked.complete and evaluation.optimum is None:
        if task.deterministic:
            notes.append("deviation  unknown: the optimum was not proved in time")
            notes += _bound_notes(evaluation)
        else:
            notes.append(
                "deviation  none: under chance a sequence is one run that a policy may take, "
                "here with every nominal outcome"
            )
    if evaluation.best is not None:
        notes += times_note(evaluation.best, task.metric)
    if walked.total_reward is not None:
        notes.append(f"reward     {walked.total_reward:.5f}")
    for fault in walked.violations:
        where = f"step {fault.step + 1} ({fault.skill})" if fault.skill else "the end"
        notes.append(f"violation  at {where}: {fault.stage}: {fault.reason}")
        if fault.facts and fault.skill:
            notes.append(f"           rests on {', '.join(fault.facts)}")
    start = [place.name for place in task.places_in(task.initial)]
    if start:
        notes.insert(0, f"from       {', '.join(start)}")
    columns, rows = step_rows(walked.steps, task.metric)
    return Table(f"{task.name}: evaluation", columns, rows, notes)


def _bound_notes(evaluation: Evaluation) -> list[str]:
    """Return what is known of an optimum that was not proved."""
    best, task = evaluation.best, evaluation.task
    if best is None or best.lower_bound is None:
        return []
    least = task.cost_text(best.lower_bound)
    notes = [f"bound      {least} by {best.bound_method}, gap {percent(evaluation.gap)}"]
    if best.cost is not None and best.cost < evaluation.walked.cost - tolerance(best.cost):
        notes.append(f"found      a plan of {task.cost_text(best.cost)}")
    return notes
