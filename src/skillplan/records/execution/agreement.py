"""Engines side by side: the document ``skillplan.agreement/1``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from skillplan.records import schemas
from skillplan.task.verdict import Verdict
from skillplan.trials.engine_agreement import Contradiction, EngineAgreement

Pictures = Sequence[Mapping[str, str]]


def agreement_document(agreement: EngineAgreement, pictures: Pictures = ()) -> dict[str, Any]:
    """Return the JSON document ``skillplan.agreement/1``.

    Parameters
    ----------
    agreement
        What engines said.
    pictures
        By the engine's name, what was drawn of every contradiction, and where; none by default.
    """
    task = agreement.task
    drawn = pictures or [{}] * len(agreement.contradictions)
    return {
        "schema": schemas.AGREEMENT,
        "task": {"name": task.name, "kind": task.kind, "sha256": task.sha256},
        "engines": list(agreement.back_ends),
        "back_ends": {name: list(names) for name, names in agreement.back_ends.items()},
        "states": agreement.states,
        "questions": agreement.questions,
        "agree": agreement.agree,
        "contradictions": [
            _contradiction(one, files)
            for one, files in zip(agreement.contradictions, drawn, strict=True)
        ],
        "executions": dict(agreement.executions),
        "seconds": dict(agreement.seconds),
        "complete": agreement.complete,
    }


def _contradiction(found: Contradiction, files: Mapping[str, str]) -> dict[str, Any]:
    return {
        "skill": found.skill.name,
        "facts": list(found.state),
        "states": found.states,
        "verdicts": {
            name: {**_verdict(verdict), "stages": [_verdict(one) for one in found.stages[name]]}
            for name, verdict in found.verdicts.items()
        },
        "pictures": dict(files),
    }


def _verdict(verdict: Verdict) -> dict[str, Any]:
    return {
        "status": verdict.status.value,
        "stage": verdict.stage or None,
        "reason": verdict.reason or None,
        "present": None if verdict.present is None else list(verdict.present),
        "absent": None if verdict.absent is None else list(verdict.absent),
        "evidence": dict(verdict.evidence),
    }
