"""A derived precedence relation beside the hand-made one."""

from __future__ import annotations

from collections.abc import Sequence

from skillplan.chart.conflict import conflict_lines
from skillplan.chart.partial_order import closure, reduction
from skillplan.chart.precedence_chart import DerivedChart
from skillplan.task.task import Task
from skillplan.views.text.table import Column, Table


def chart_table(chart: DerivedChart, task: Task, back_ends: Sequence[str]) -> Table:
    """Return the derived relation as a table, the comparison below."""
    direct = reduction([(r.before, r.after) for r in chart.relations])
    by_hand = set(chart.hand_made or ())
    implied = closure(by_hand)
    rows = []
    for relation in chart.relations:
        pair = (relation.before, relation.after)
        if pair not in direct and pair not in by_hand and (not by_hand or pair in implied):
            continue
        mark = "drawn" if pair in by_hand else "implied" if pair in implied else "extra"
        rows.append(
            (
                relation.before,
                relation.after,
                mark if chart.hand_made is not None else "-",
                str(relation.evidence["skill"]),
                relation.reason,
            )
        )
    rows += [(before, after, "MISSING", "-", "-") for before, after in chart.missing]
    columns = [Column(name) for name in ("before", "after", "hand-made")]
    columns += [Column("asked", short="query"), Column("reason")]
    if chart.hand_made is None:
        notes = ["The task file has no hand-made chart to compare with."]
    elif not chart.missing and not chart.extra:
        notes = ["The derived relation equals the hand-made chart."]
    else:
        notes = [f"missing {len(chart.missing)}, extra {len(chart.extra)}"]
    hidden = len(chart.relations) - sum(1 for row in rows if row[2] != "MISSING")
    if hidden:
        notes.append(f"{hidden} more derived pairs follow from these; --format json has all.")
    notes += [f"{skill} is never feasible: {why}" for skill, why in chart.impossible.items()]
    notes += chart.beyond_order(task)
    notes += _choices(chart)
    notes += [f"{skill} could not be worked out" for skill in chart.undecided]
    if chart.cycle:
        first, *others = conflict_lines(task, chart.relations)
        notes += [f"No order exists: {first}", *others]
    notes += chart.contradictions
    title = f"{task.name}: precedence relation derived by {', '.join(back_ends)}"
    return Table(title, columns, rows, notes)


def _choices(chart: DerivedChart) -> list[str]:
    """Return between what orders have to choose; of several skills with one choice at once."""
    skills: dict[str, list[str]] = {}
    for one in chart.alternatives:
        skills.setdefault(str(one), []).append(one.skill)
    return [
        f"{' and '.join(those)} leave{'s' * (len(those) == 1)} a choice: {choice}"
        for choice, those in skills.items()
    ]
