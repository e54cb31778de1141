"""Engines side by side: the document ``skillplan.agreement/1``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from skillplan.records import schemas
from skillplan.task.verdict import Verdict, VerdictStatus
from skillplan.trials.detector_trials import CheckedTrial, DetectorTrials
from skillplan.trials.engine_agreement import Contradiction, EngineAgreement
from skillplan.trials.fault_injection import Truth

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
            _contradiction(contradiction, files)
            for contradiction, files in zip(agreement.contradictions, drawn, strict=True)
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


def detectors_document(trials: DetectorTrials, wall_s: float) -> dict[str, Any]:
    """Return the JSON document ``skillplan.detectors/1``."""
    task = trials.task
    return {
        "schema": schemas.DETECTORS,
        "task": {"name": task.name, "kind": task.kind, "sha256": task.sha256},
        "physics": trials.engine,
        "reference": trials.reference,
        "trials": {truth.value: len(trials.of(truth)) for truth in Truth},
        "stopped": trials.stopped,
        "wall_s": wall_s,
        "detectors": [_detector(trials, name) for name in trials.detectors],
    }


def wrong_verdicts(trials: DetectorTrials, name: str) -> list[CheckedTrial]:
    """Return the false alarms, misses and undecided of a detector, in the order of the trials."""
    return [
        checked
        for checked in trials.checked
        if checked.trial.truth is not Truth.OUTCOME
        and checked.verdicts[name].status is not _right(checked.trial.truth)
    ]


def decisive(trials: DetectorTrials, name: str, truth: Truth) -> Mapping[str, Any] | None:
    """Return the readings and limits nearest to a wrong verdict; None if it gives no readings.

    That is the largest on right executions and the smallest on collisions, as a fraction of
    the limit; of several readings of one execution the largest counts.
    """
    found = [
        (strength, checked)
        for checked in trials.of(truth)
        if (strength := _strength(checked.verdicts[name])) is not None
    ]
    if not found:
        return None
    pick = min if truth is Truth.COLLISION else max
    _, checked = pick(found, key=lambda one: one[0])
    evidence = checked.verdicts[name].evidence
    return {
        "skill": checked.trial.skill.name,
        "staged": checked.trial.fault or None,
        "readings": evidence["readings"],
        "limits": evidence["limits"],
    }


def _detector(trials: DetectorTrials, name: str) -> dict[str, Any]:
    false_alarms, misses, undecided = counts(trials, name)
    outcomes = trials.count(Truth.OUTCOME, name, VerdictStatus.INFEASIBLE)
    return {
        "name": name,
        "false_alarms": false_alarms,
        "misses": misses,
        "undecided": undecided,
        "outcomes_seen": outcomes,
        "largest_where_right": decisive(trials, name, Truth.LEGITIMATE),
        "smallest_where_wrong": decisive(trials, name, Truth.COLLISION),
        "wrong_rulings": [
            {
                "truth": checked.trial.truth.value,
                "skill": checked.trial.skill.name,
                "state": list(checked.trial.state),
                "staged": checked.trial.fault or None,
                "verdict": checked.verdicts[name].status.value,
                "reason": checked.verdicts[name].reason or None,
                "evidence": dict(checked.verdicts[name].evidence),
            }
            for checked in wrong_verdicts(trials, name)
        ],
    }


def counts(trials: DetectorTrials, name: str) -> tuple[int, int, int]:
    """Return false alarms, misses and how often the detector could not decide."""
    undecided = sum(trials.count(truth, name, VerdictStatus.UNKNOWN) for truth in Truth)
    false_alarms = trials.count(Truth.LEGITIMATE, name, VerdictStatus.INFEASIBLE)
    misses = trials.count(Truth.COLLISION, name, VerdictStatus.FEASIBLE)
    return false_alarms, misses, undecided


def _right(truth: Truth) -> VerdictStatus:
    legitimate = truth is Truth.LEGITIMATE
    return VerdictStatus.FEASIBLE if legitimate else VerdictStatus.INFEASIBLE


def _strength(verdict: Verdict) -> float | None:
    """Return the largest reading as a fraction of its limit; None where there is none."""
    readings, limits = verdict.evidence.get("readings"), verdict.evidence.get("limits")
    if not isinstance(readings, Mapping) or not isinstance(limits, Mapping):
        return None
    fractions = [value / limits[key] for key, value in readings.items() if limits.get(key)]
    return max(fractions, default=None)
