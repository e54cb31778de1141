"""Collision detectors on trial: the document ``skillplan.detectors/1``, and what it counts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from skillplan.records import schemas
from skillplan.task.verdict import Verdict, VerdictStatus
from skillplan.trials.detector_trial import Truth
from skillplan.trials.detector_trials import DetectorTrials, Ruling


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


def wrong_verdicts(trials: DetectorTrials, name: str) -> list[Ruling]:
    """Return the false alarms, misses and undecided of a detector, in the order of the trials."""
    return [
        ruling
        for ruling in trials.rulings
        if ruling.trial.truth is not Truth.OUTCOME
        and ruling.verdicts[name].status is not _right(ruling.trial.truth)
    ]


def decisive(trials: DetectorTrials, name: str, truth: Truth) -> Mapping[str, Any] | None:
    """Return the readings and limits nearest to a wrong verdict; None where it gives none.

    That is the largest on right executions and the smallest on collisions, as a fraction of
    the limit; of several readings of one execution the largest counts.
    """
    found = [
        (strength, ruling)
        for ruling in trials.of(truth)
        if (strength := _strength(ruling.verdicts[name])) is not None
    ]
    if not found:
        return None
    pick = min if truth is Truth.COLLISION else max
    _, ruling = pick(found, key=lambda one: one[0])
    evidence = ruling.verdicts[name].evidence
    return {
        "skill": ruling.trial.skill.name,
        "staged": ruling.trial.staged or None,
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
                "truth": ruling.trial.truth.value,
                "skill": ruling.trial.skill.name,
                "state": list(ruling.trial.state),
                "staged": ruling.trial.staged or None,
                "verdict": ruling.verdicts[name].status.value,
                "reason": ruling.verdicts[name].reason or None,
                "evidence": dict(ruling.verdicts[name].evidence),
            }
            for ruling in wrong_verdicts(trials, name)
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
