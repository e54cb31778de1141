"""Tables of simulations, and of engines and detectors that are compared."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from skillplan.physics.performance import PerformedSkill
from skillplan.records.execution.comparisons import (
    Pictures,
    count_errors,
    find_decisive,
    list_wrong,
)
from skillplan.records.execution.simulation import Simulation, TimeDifference
from skillplan.task.verdict import VerdictStatus
from skillplan.trials.detector_trials import CHART, DetectorTrials
from skillplan.trials.engine_agreement import EngineAgreement
from skillplan.trials.fault_injection import Truth
from skillplan.views.tables.results import describe_unchecked
from skillplan.views.text.table import Column, Table
from skillplan.views.text.wording import format_evidence, format_yes_no


def tabulate_agreement(agreement: EngineAgreement, pictures: Pictures = ()) -> list[Table]:
    """Return all contradictions with the verdicts of each engine, and a summary.

    Parameters
    ----------
    pictures
        Picture files of every contradiction by engine; none by default.
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
        f"{agreement.states} states that can be reached"
    ]
    if not agreement.complete:
        notes.append("stopped  before all was asked")
    summary = Table(f"{task.name}: engines on the same questions", columns, rows, notes)
    if not agreement.contradictions:
        return [summary]
    drawn = pictures or [{}] * len(agreement.contradictions)
    contradictions = [
        (
            contradiction.skill.name,
            str(contradiction.states),
            name,
            verdict.status.value,
            verdict.reason or "-",
            "; ".join(
                f"{stage.stage}: {format_evidence(stage.evidence)}"
                for stage in contradiction.stages[name]
                if stage.evidence
            )
            or "-",
            " ".join(contradiction.state) or "-",
            files.get(name, "-"),
        )
        for contradiction, files in zip(agreement.contradictions, drawn, strict=True)
        for name, verdict in contradiction.verdicts.items()
    ]
    columns = [Column("skill"), Column("states", right=True), Column("engine"), Column("verdict")]
    columns += [
        Column(heading, below=True) for heading in ("reason", "evidence", "where", "picture")
    ]
    return [Table(f"{task.name}: contradictions", columns, contradictions), summary]


def tabulate_detectors(trials: DetectorTrials) -> list[Table]:
    """Return the wrong verdicts of each detector, and a summary with numbers and readings."""
    rows = []
    for name in trials.detectors:
        false_alarms, misses, undecided = count_errors(trials, name)
        rows.append(
            (
                name,
                f"{false_alarms}/{len(trials.of(Truth.LEGITIMATE))}",
                f"{misses}/{len(trials.of(Truth.COLLISION))}",
                f"{undecided}/{len(trials.checked)}",
                _share_detected(trials, name),
                _format_reading(find_decisive(trials, name, Truth.LEGITIMATE)),
                _format_reading(find_decisive(trials, name, Truth.COLLISION)),
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
    notes = [f"right is      what {_describe_reference(trials.reference)}"]
    notes += [
        f"trials        {len(trials.of(Truth.LEGITIMATE))} right, "
        f"{len(trials.of(Truth.COLLISION))} collisions, "
        f"{len(trials.of(Truth.OUTCOME))} wrong outcomes without one",
        f"physics       {trials.engine} sees {_share_detected(trials, trials.engine)} of the wrong "
        "outcomes, which are not a detector's business",
    ]
    if trials.stopped:
        notes.append("stopped       before all trials were made")
    summary = Table(f"{trials.task.name}: detectors on trial", columns, rows, notes)
    wrong = [
        (
            name,
            checked.trial.truth.value,
            checked.trial.skill.name,
            checked.trial.fault or "-",
            checked.verdicts[name].status.value,
            checked.verdicts[name].reason or "-",
            format_evidence(checked.verdicts[name].evidence) or "-",
        )
        for name in trials.detectors
        for checked in list_wrong(trials, name)
    ]
    if not wrong:
        return [summary]
    columns = [Column(heading) for heading in ("detector", "truth", "skill")]
    columns += [Column("staged", short="injected fault"), Column("verdict")]
    columns += [Column("reason", below=True), Column("evidence", below=True)]
    return [Table(f"{trials.task.name}: wrong verdicts", columns, wrong), summary]


def _share_detected(trials: DetectorTrials, name: str) -> str:
    seen = trials.count(Truth.OUTCOME, name, VerdictStatus.INFEASIBLE)
    return f"{seen}/{len(trials.of(Truth.OUTCOME))}"


def _format_reading(trial: Mapping[str, Any] | None) -> str:
    if trial is None:
        return "-"
    figures = [
        f"{key} {value:.4g} (limit {trial['limits'][key]:.4g})"
        for key, value in trial["readings"].items()
    ]
    fault = f", {trial['staged']}" if trial["staged"] else ""
    return f"{', '.join(figures)} at {trial['skill']}{fault}"


def _describe_reference(reference: str) -> str:
    return (
        f"{reference} allows, and the same with a block close by"
        if reference == CHART
        else reference
    )


# Smaller differences round to zero and are not shown [s].
_LEAST_SHOWN_S = 0.05


def tabulate_simulation(simulation: Simulation) -> list[Table]:
    """Return the final places of bodies, and the skills with a summary below."""
    title = f"{simulation.task.name}: simulated by {simulation.physics}"
    columns = [
        Column("body"),
        Column("off goal [mm]", right=True),
        Column("turned [deg]", right=True),
        Column("final x y z [m]", right=True),
    ]
    arrivals = [
        (
            arrival.body,
            f"{1000 * arrival.offset_m:.3f}",
            f"{math.degrees(arrival.tilt_rad):.3f}",
            " ".join(f"{round(value, 4) + 0.0:.4f}" for value in arrival.final.position),
        )
        for arrival in simulation.performance.arrivals
    ]
    tables = [Table(f"{title}: where bodies ended", columns, arrivals)] if arrivals else []
    columns = [
        Column("step", right=True),
        Column("action", right=True),
        Column("skill"),
        Column("verdict"),
        Column("from [s]", right=True),
        Column("to [s]", right=True),
        *([Column("planned [s]", right=True)] if simulation.planned is not None else []),
        Column("reason"),
        Column("measured", below=True),
    ]
    rows = [_make_row(simulation, *entry) for entry in enumerate(simulation.performance.skills)]
    return [*tables, Table(title, columns, rows, _write_notes(simulation))]


def _make_row(simulation: Simulation, index: int, skill: PerformedSkill) -> tuple[str, ...]:
    return (
        str(index + 1),
        str(simulation.task.action(simulation.skills[index])),
        skill.skill,
        skill.verdict.status.value,
        f"{skill.begin_s:.1f}",
        f"{skill.end_s:.1f}",
        *([] if simulation.planned is None else [f"{simulation.planned.durations_s[index]:.1f}"]),
        skill.verdict.reason or "-",
        format_evidence(skill.verdict.evidence) or "-",
    )


def _write_notes(simulation: Simulation) -> list[str]:
    performance = simulation.performance
    notes = [
        f"feasible   {format_yes_no(simulation.feasible)}",
        f"complete   {format_yes_no(simulation.complete)}",
    ]
    failed = performance.failed
    if failed is not None:
        step = performance.skills.index(failed) + 1
        notes.append(f"failure    at step {step} ({failed.skill}): {failed.verdict.reason}")
    elif simulation.obstacle is not None:
        notes.append(f"failure    {simulation.obstacle}")
    elif simulation.stopped:
        notes.append(
            f"stopped    after {len(performance.skills)} of {len(simulation.skills)} skills"
        )
    elif not simulation.complete:
        notes.append("failure    at the end: the goal is not reached")
    if performance.taken_away:
        notes.append(f"taken away {', '.join(performance.taken_away)}")
    largest_mm, largest_deg = simulation.largest_mm, simulation.largest_deg
    if largest_mm is not None and largest_deg is not None:
        notes.append(f"arrival    within {largest_mm:.3f} mm and {largest_deg:.3f} degrees")
    if simulation.times is not None:
        notes.append(f"times      {describe_difference(simulation.times, performance.pace)}")
    rate = simulation.steps_per_s
    speed = f", {rate:,.0f} steps/s" if rate is not None else ""
    speed += ", filming included" if "video" in (simulation.files or {}) else ""
    held = f"{performance.held_s:.1f} s of dwells at rest added, " if performance.held_s else ""
    stepped_s = performance.simulated_s - performance.held_s
    notes.append(
        f"effort     {stepped_s:.1f} s simulated in {performance.steps:,} steps, {held}"
        f"{simulation.wall_s:.1f} s{speed}"
    )
    if performance.figures:
        notes.append(f"measured   {format_evidence(performance.figures)}")
    notes += [f"{option:<10} {path}" for option, path in (simulation.files or {}).items()]
    notes += describe_unchecked(simulation.not_checked)
    return notes


def describe_difference(times: TimeDifference, pace: str) -> str:
    """Return the difference of simulated and planned time in words, with its reasons.

    Parameters
    ----------
    pace
        Speeds of the arm in the engine, in words; may be empty.
    """
    planner = times.timed_by or "the task's travel speed"
    words = f"{times.simulated_s:.1f} s simulated, {times.planned_s:.1f} s planned by {planner}"
    how = pace or "at speeds of the engine"
    if not times.timed_by:
        how += "; planned without strokes"
    shares = {
        "until the world is at rest": times.settling_s,
        "acting beyond the dwells": times.acting_s,
        f"travels and strokes ({how})": times.moving_s,
        "waits for parts": times.waiting_s,
    }
    reasons = [
        f"{share_s:+.1f} s {reason}"
        for reason, share_s in shares.items()
        if share_s is not None and abs(share_s) >= _LEAST_SHOWN_S
    ]
    if times.acting_s is None:
        reasons.append("the engine measures no more")
    return f"{words}: {times.difference_s:+.1f} s" + "".join(f"; {reason}" for reason in reasons)
