"""Collision detectors side by side: false alarms, misses, and the figures that decide."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from skillplan.records.execution.detectors import counts, decisive, wrong_verdicts
from skillplan.task.verdict import VerdictStatus
from skillplan.trials.detector_trial import Truth
from skillplan.trials.detector_trials import CHART, DetectorTrials
from skillplan.views.text.evidence_text import evidence_text
from skillplan.views.text.table import Column, Table


def detectors_tables(trials: DetectorTrials) -> list[Table]:
    """Return what each detector rules wrong, and below it how many, with the figures."""
    rows = []
    for name in trials.detectors:
        false_alarms, misses, undecided = counts(trials, name)
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
        for ruling in wrong_verdicts(trials, name)
    ]
    if not wrong:
        return [summary]
    columns = [Column(heading) for heading in ("detector", "truth", "skill")]
    columns += [Column("staged", short="injected fault"), Column("verdict")]
    columns += [Column("reason", below=True), Column("evidence", below=True)]
    return [Table(f"{trials.task.name}: wrong verdicts", columns, wrong), summary]


def _ruled_out(trials: DetectorTrials, name: str) -> str:
    seen = trials.count(Truth.OUTCOME, name, VerdictStatus.INFEASIBLE)
    return f"{seen}/{len(trials.of(Truth.OUTCOME))}"


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
