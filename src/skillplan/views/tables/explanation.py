"""Why a skill is feasible or not: a table of stages, and below each stage's facts and evidence."""

from __future__ import annotations

from skillplan.records.explanation import Explanation
from skillplan.task.skill import Outcome
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict
from skillplan.views.text.evidence_text import evidence_items, evidence_text
from skillplan.views.text.table import Column, ItemList, Table

_RESTS_ON = "rests on"


def explanation_tables(explanation: Explanation) -> list[Table]:
    """Return the stages as a table, the state and the skill's conditions below."""
    task = explanation.task
    rows = [
        (
            verdict.stage,
            verdict.status.value,
            verdict.reason or "-",
            _basis(verdict, task),
            evidence_text(verdict.evidence) or "-",
        )
        for verdict in explanation.stages
    ]
    columns = [Column(name) for name in ("stage", "verdict", "reason")]
    columns += [Column(name, listed=True) for name in (_RESTS_ON, "evidence")]
    lists = [
        ItemList(
            f"{verdict.stage}: {verdict.status.value}",
            [(_RESTS_ON, _basis(verdict, task)), *evidence_items(verdict.evidence)],
        )
        for verdict in explanation.stages
    ]
    outcome = "feasible" if explanation.feasible else "not feasible"
    title = f"{task.name}: {explanation.skill.name} is {outcome}"
    return [Table(title, columns, rows, _notes(explanation), lists)]


def _notes(explanation: Explanation) -> list[str]:
    return [
        f"state         {', '.join(explanation.state)}",
        f"precondition  {explanation.skill.condition(explanation.state)}",
        f"prediction    {_changes(explanation, explanation.prediction)}",
        *(
            f"otherwise     {_changes(explanation, outcome)}, "
            f"with probability {outcome.probability:g}"
            for outcome in explanation.otherwise
        ),
        *(f"{what:<13} {path}" for what, path in explanation.files.items()),
    ]


def _changes(explanation: Explanation, outcome: Outcome) -> str:
    gone = explanation.state & outcome.delete
    return ", ".join([*outcome.add, *(f"not {fact}" for fact in gone)])


def _basis(verdict: Verdict, task: Task) -> str:
    facts = verdict.facts
    return "all facts" if len(facts) == len(task.facts) else ", ".join(facts) or "no fact"
