"""Comparisons of back ends: ``skillplan.agreement/1`` and ``skillplan.detectors/1``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from skillplan.records import schemas
from skillplan.task.verdict import Verdict, VerdictStatus
from skillplan.trials.detector_trials import CheckedTrial, DetectorTrials
from skillplan.trials.engine_agreement import Contradiction, EngineAgreement
from skillplan.trials.fault_injection import Truth

Pictures = Sequence[Mapping[str, str]]


def make_agreement_document(agreement: EngineAgreement, pictures: Pictures = ()) -> dict[str, Any]:
    """Return the document ``skillplan.agreement/1``.

    Parameters
    ----------
    pictures
        For every contradiction the picture files by engine. Default: none.
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


def _contradiction(contradiction: Contradiction, files: Mapping[str, str]) -> dict[str, Any]:
    return {
        "skill": contradiction.skill.name,
        "facts": list(contradiction.state),
        "states": contradiction.states,
        "verdicts": {
            name: {
                **_verdict(verdict),
                "stages": [_verdict(stage) for stage in contradiction.stages[name]],
            }
            for name, verdict in contradiction.verdicts.items()
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


def make_detectors_document(trials: DetectorTrials, wall_s: float) -> dict[str, Any]:
    """Return the document ``skillplan.detectors/1``."""
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


def list_wrong(trials: DetectorTrials, name: str) -> list[CheckedTrial]:
    """Return the false alarms, misses and undecided trials of a detector, in order."""
    return [
        checked
        for checked in trials.checked
        if checked.trial.truth is not Truth.OUTCOME
        and checked.verdicts[name].status is not _get_right_status(checked.trial.truth)
    ]


def find_decisive(trials: DetectorTrials, name: str, truth: Truth) -> Mapping[str, Any] | None:
    """Return the readings and limits closest to a wrong verdict; None without readings.

    These are the largest readings on right executions and the smallest on collisions, relative to
    the limit. Of several readings on one execution the largest counts.
    """
    readings = [
        (strength, checked)
        for checked in trials.of(truth)
        if (strength := _measure(checked.verdicts[name])) is not None
    ]
    if not readings:
        return None
    pick = min if truth is Truth.COLLISION else max
    _, checked = pick(readings, key=lambda reading: reading[0])
    evidence = checked.verdicts[name].evidence
    return {
        "skill": checked.trial.skill.name,
        "staged": checked.trial.fault or None,
        "readings": evidence["readings"],
        "limits": evidence["limits"],
    }


def _detector(trials: DetectorTrials, name: str) -> dict[str, Any]:
    false_alarms, misses, undecided = count_errors(trials, name)
    outcomes = trials.count(Truth.OUTCOME, name, VerdictStatus.INFEASIBLE)
    return {
        "name": name,
        "false_alarms": false_alarms,
        "misses": misses,
        "undecided": undecided,
        "outcomes_seen": outcomes,
        "largest_where_right": find_decisive(trials, name, Truth.LEGITIMATE),
        "smallest_where_wrong": find_decisive(trials, name, Truth.COLLISION),
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
            for checked in list_wrong(trials, name)
        ],
    }


def count_errors(trials: DetectorTrials, name: str) -> tuple[int, int, int]:
    """Return the numbers of false alarms, misses and undecided trials."""
    undecided = sum(trials.count(truth, name, VerdictStatus.UNKNOWN) for truth in Truth)
    false_alarms = trials.count(Truth.LEGITIMATE, name, VerdictStatus.INFEASIBLE)
    misses = trials.count(Truth.COLLISION, name, VerdictStatus.FEASIBLE)
    return false_alarms, misses, undecided


def _get_right_status(truth: Truth) -> VerdictStatus:
    legitimate = truth is Truth.LEGITIMATE
    return VerdictStatus.FEASIBLE if legitimate else VerdictStatus.INFEASIBLE


def _measure(verdict: Verdict) -> float | None:
    """Return the largest reading relative to its limit; None without one."""
    readings, limits = verdict.evidence.get("readings"), verdict.evidence.get("limits")
    if not isinstance(readings, Mapping) or not isinstance(limits, Mapping):
        return None
    fractions = [value / limits[key] for key, value in readings.items() if limits.get(key)]
    return max(fractions, default=None)
