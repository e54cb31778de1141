"""Collision detectors side by side: false alarms, misses, and the figures that decide."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from skillplan.task.verdict import Verdict, VerdictStatus
from skillplan.trials.detector_trial import Truth
from skillplan.trials.detector_trials import CHART, DetectorTrials, Ruling
from skillplan.views.tables.evidence_text import evidence_text
from skillplan.views.tables.table import Column, Table


def detectors_document(trials: DetectorTrials, wall_s: float) -> dict[str, Any]:
    """Return the JSON document ``skillplan.detectors/1``."""
    task = trials.task
    return {
        "schema": "skillplan.detectors/1",
        "task": {"name": task.name, "kind": task.kind, "sha256": task.sha256},
        "physics": trials.engine,
        "reference": trials.reference,
        "trials": {truth.value: len(trials.of(truth)) for truth in Truth},
        "stopped": trials.stopped,
        "wall_s": wall_s,
        "detectors": [_detector(trials, name) for name in trials.detectors],
    }


def detectors_tables(trials: DetectorTrials) -> list[Table]:
    """Return what each detector rules wrong, and below it how many, with the figures."""
    rows = []
    for name in trials.detectors:
        false_alarms, misses, undecided = _counts(trials, name)
        rows.append(
            (
                name,
                f"{false_alarms}/{len(trials.of(Truth.LEGITIMATE))}",
                f"{misses}/{len(trials.of(Truth.COLLISION))}",
                f"{undecided}/{len(trials.rulings)}",
                _ruled_out(trials, name),
                _reading_text(decisive(trials, name, Truth.LEGITIMATE)),
                _reading_text(decisive(trials, name, Truth.COLLISION)),
            )
        )
    columns = [
        Column("detector"),
        Column("false alarms", right=True),
        Column("misses", right=True),
        Column("undecided", right=True),
        Column("wrong outcomes seen", right=True),
        Column("largest reading where right", below=True),
        Column("smallest reading where wrong", below=True),
    ]
    notes = [f"right is      what {_reference(trials.reference)}"]
    notes += [
        f"trials        {len(trials.of(Truth.LEGITIMATE))} right, "
        f"{len(trials.of(Truth.COLLISION))} collisions, "
        f"{len(trials.of(Truth.OUTCOME))} wrong outcomes without one",
        f"physics       {trials.engine} sees {_ruled_out(trials, trials.engine)} of the wrong "
        "outcomes, which are not a detector's business",
    ]
    if trials.stopped:
        notes.append("stopped       before all trials were made")
    summary = Table(f"{trials.task.name}: detectors on trial", columns, rows, notes)
    wrong = [
        (
            name,
            ruling.trial.truth.value,
            ruling.trial.skill.name,
            ruling.trial.staged or "-",
            ruling.verdicts[name].status.value,
            ruling.verdicts[name].reason or "-",
            evidence_text(ruling.verdicts[name].evidence) or "-",
        )
        for name in trials.detectors
        for ruling in wrong_rulings(trials, name)
    ]
    if not wrong:
        return [summary]
    headings = ["detector", "truth", "skill", "staged", "verdict"]
    columns = [Column(heading) for heading in headings]
    columns += [Column("reason", below=True), Column("evidence", below=True)]
    return [Table(f"{trials.task.name}: wrong rulings", columns, wrong), summary]


def wrong_rulings(trials: DetectorTrials, name: str) -> list[Ruling]:
    """Return the false alarms, misses and undecided of a detector, in the order of asking."""
    return [
        ruling
        for ruling in trials.rulings
        if ruling.trial.truth is not Truth.OUTCOME
        and ruling.verdicts[name].status is not _right(ruling.trial.truth)
    ]


def decisive(trials: DetectorTrials, name: str, truth: Truth) -> Mapping[str, Any] | None:
    """Return the readings and limits nearest to a wrong ruling; None where it gives none.

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
    false_alarms, misses, undecided = _counts(trials, name)
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
            for ruling in wrong_rulings(trials, name)
        ],
    }


def _counts(trials: DetectorTrials, name: str) -> tuple[int, int, int]:
    """Return false alarms, misses and how often the detector could not decide."""
    undecided = sum(trials.count(truth, name, VerdictStatus.UNKNOWN) for truth in Truth)
    false_alarms = trials.count(Truth.LEGITIMATE, name, VerdictStatus.INFEASIBLE)
    misses = trials.count(Truth.COLLISION, name, VerdictStatus.FEASIBLE)
    return false_alarms, misses, undecided


def _right(truth: Truth) -> VerdictStatus:
    legitimate = truth is Truth.LEGITIMATE
    return VerdictStatus.FEASIBLE if legitimate else VerdictStatus.INFEASIBLE


def _ruled_out(trials: DetectorTrials, name: str) -> str:
    seen = trials.count(Truth.OUTCOME, name, VerdictStatus.INFEASIBLE)
    return f"{seen}/{len(trials.of(Truth.OUTCOME))}"


def _strength(verdict: Verdict) -> float | None:
    """Return the largest reading as a fraction of its limit; None where there is none."""
    readings, limits = verdict.evidence.get("readings"), verdict.evidence.get("limits")
    if not isinstance(readings, Mapping) or not isinstance(limits, Mapping):
        return None
    fractions = [value / limits[key] for key, value in readings.items() if limits.get(key)]
    return max(fractions, default=None)


def _reading_text(found: Mapping[str, Any] | None) -> str:
    if found is None:
        return "-"
    figures = [
        f"{key} {value:.4g} (limit {found['limits'][key]:.4g})"
        for key, value in found["readings"].items()
    ]
    staged = f", {found['staged']}" if found["staged"] else ""
    return f"{', '.join(figures)} at {found['skill']}{staged}"


def _reference(reference: str) -> str:
    return (
        f"{reference} allows, and the same with a block close by"
        if reference == CHART
        else reference
    )
