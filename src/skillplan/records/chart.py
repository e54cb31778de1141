"""A derived precedence relation: the document ``skillplan.chart/1``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from skillplan.chart.precedence_chart import DerivedChart
from skillplan.records import schemas
from skillplan.task.task import Task


def chart_document(chart: DerivedChart, task: Task, back_ends: Sequence[str]) -> dict[str, Any]:
    """Return the JSON document ``skillplan.chart/1``."""
    hand_made = chart.hand_made or ()
    return {
        "schema": schemas.CHART,
        "task": {"name": task.name, "kind": task.kind, "sha256": task.sha256},
        "back_ends": list(back_ends),
        "relations": [
            {"before": r.before, "after": r.after, "reason": r.reason, "evidence": dict(r.evidence)}
            for r in chart.relations
        ],
        "hand_made": [{"before": before, "after": after} for before, after in hand_made],
        "missing": [{"before": before, "after": after} for before, after in chart.missing],
        "extra": [{"before": r.before, "after": r.after, "reason": r.reason} for r in chart.extra],
        "impossible": dict(chart.impossible),
        "undecided": list(chart.undecided),
        "circle": list(chart.cycle),
        "contradiction": list(chart.contradiction),
        "conditional": {skill: list(facts) for skill, facts in chart.conditional.items()},
        "alternatives": [
            {
                "component": one.component,
                "skill": one.skill,
                "any_of": [
                    [{"before": before, "after": after} for before, after in pairs]
                    for pairs in one.any_of
                ],
            }
            for one in chart.alternatives
        ],
    }
