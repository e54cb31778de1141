"""Why a skill is feasible or not, as a table of stages with their evidence."""

from __future__ import annotations

from skillplan.records.explanation import Explanation
from skillplan.task.skill import Outcome
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict
from skillplan.views.tables.evidence_text import evidence_text
from skillplan.views.tables.table import Column, Table


def explanation_tables(explanation: Explanation) -> list[Table]:
    """Return the stages as a table, the state and the skill's conditions below."""
    rows = [
        (
            verdict.stage,
            verdict.status.value,
            verdict.reason or "-",
            _basis(verdict, explanation.task),
            evidence_text(verdict.evidence) or "-",
        )
        for verdict in explanation.stages
    ]
    columns = [Column(name) for name in ("stage", "verdict", "reason")]
    columns += [Column(name, below=True) for name in ("rests on", "evidence")]
    notes = [
        f"state         {', '.join(explanation.state)}",
        f"precondition  {explanation.skill.condition(explanation.state)}",
        f"prediction    {_changes(explanation, explanation.prediction)}",
    ]
    notes += [
        f"otherwise     {_changes(explanation, outcome)}, with probability {outcome.probability:g}"
        for outcome in explanation.otherwise
    ]
    notes += [f"{what:<13} {path}" for what, path in explanation.files.items()]
    outcome = "feasible" if explanation.feasible else "not feasible"
    title = f"{explanation.task.name}: {explanation.skill.name} is {outcome}"
    return [Table(title, columns, rows, notes)]


def _changes(explanation: Explanation, outcome: Outcome) -> str:
    gone = explanation.state & outcome.delete
    return ", ".join([*outcome.add, *(f"not {fact}" for fact in gone)])


def _basis(verdict: Verdict, task: Task) -> str:
    facts = verdict.facts
    return "all facts" if len(facts) == len(task.facts) else ", ".join(facts) or "no fact"
