"""Engines side by side: how many answers are the same, what it took, and where they differ."""

from __future__ import annotations

from skillplan.records.execution.agreement import Pictures
from skillplan.task.verdict import Verdict
from skillplan.trials.engine_agreement import EngineAgreement
from skillplan.views.text.evidence_text import evidence_text
from skillplan.views.text.table import Column, Table


def agreement_tables(agreement: EngineAgreement, pictures: Pictures = ()) -> list[Table]:
    """Return every contradiction with what each engine says, and below that the summary.

    Parameters
    ----------
    agreement
        What engines said.
    pictures
        By the engine's name, what was drawn of every contradiction, and where; none by default.
    """
    task = agreement.task
    rows = [
        (
            engine,
            ", ".join(name for name in names if name != engine) or "-",
            str(agreement.executions[engine]),
            f"{agreement.seconds[engine]:.3f}",
        )
        for engine, names in agreement.back_ends.items()
    ]
    columns = [Column("engine"), Column("collision")]
    columns += [Column("executions", right=True), Column("seconds", right=True)]
    share = 100 * agreement.agree / max(1, agreement.questions)
    notes = [
        f"agree    on {agreement.agree} of {agreement.questions} questions ({share:.2f} %), of "
        f"{agreement.states} states that can be reached",
    ]
    if not agreement.complete:
        notes.append("stopped  before all was asked")
    summary = Table(f"{task.name}: engines on the same questions", columns, rows, notes)
    if not agreement.contradictions:
        return [summary]
    drawn = pictures or [{}] * len(agreement.contradictions)
    said = [
        (
            one.skill.name,
            str(one.states),
            name,
            verdict.status.value,
            verdict.reason or "-",
            "; ".join(_measured(stage) for stage in one.stages[name] if stage.evidence) or "-",
            " ".join(one.state) or "-",
            files.get(name, "-"),
        )
        for one, files in zip(agreement.contradictions, drawn, strict=True)
        for name, verdict in one.verdicts.items()
    ]
    columns = [Column("skill"), Column("states", right=True), Column("engine"), Column("verdict")]
    columns += [
        Column(heading, below=True) for heading in ("reason", "evidence", "where", "picture")
    ]
    return [Table(f"{task.name}: contradictions", columns, said), summary]


def _measured(verdict: Verdict) -> str:
    """Return what a back end measured, and which."""
    return f"{verdict.stage}: {evidence_text(verdict.evidence)}"
