"""A simulated plan as tables: where all bodies ended, and how each skill went."""

from __future__ import annotations

import math

from skillplan.physics.performance import PerformedSkill
from skillplan.records.execution.simulation import Simulation, TimeDifference
from skillplan.views.text.evidence_text import evidence_text
from skillplan.views.text.table import Column, Table
from skillplan.views.text.wording import yes_no

# Differences below this are not shown: a tenth of a second is the last digit [s].
_LEAST_SHOWN_S = 0.05


def simulation_tables(simulation: Simulation) -> list[Table]:
    """Return where all bodies ended, and how each skill went with the whole below."""
    title = f"{simulation.task.name}: simulated by {simulation.physics}"
    columns = [
        Column("body"),
        Column("off goal [mm]", right=True),
        Column("turned [deg]", right=True),
        Column("final x y z [m]", right=True),
    ]
    arrivals = [
        (
            one.body,
            f"{1000 * one.offset_m:.3f}",
            f"{math.degrees(one.tilt_rad):.3f}",
            " ".join(f"{round(value, 4) + 0.0:.4f}" for value in one.final.position),
        )
        for one in simulation.performance.arrivals
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
    rows = [_row(simulation, index, one) for index, one in enumerate(simulation.performance.skills)]
    return [*tables, Table(title, columns, rows, _notes(simulation))]


def _row(simulation: Simulation, index: int, one: PerformedSkill) -> tuple[str, ...]:
    return (
        str(index + 1),
        str(simulation.task.action(simulation.skills[index])),
        one.skill,
        one.verdict.status.value,
        f"{one.begin_s:.1f}",
        f"{one.end_s:.1f}",
        *([] if simulation.planned is None else [f"{simulation.planned.durations_s[index]:.1f}"]),
        one.verdict.reason or "-",
        evidence_text(one.verdict.evidence) or "-",
    )


def _notes(simulation: Simulation) -> list[str]:
    made = simulation.performance
    notes = [
        f"feasible   {yes_no(simulation.feasible)}",
        f"complete   {yes_no(simulation.complete)}",
    ]
    failed = made.failed
    if failed is not None:
        step = len(made.skills)
        notes.append(f"failure    at step {step} ({failed.skill}): {failed.verdict.reason}")
    elif simulation.obstacle is not None:
        notes.append(f"failure    {simulation.obstacle}")
    elif simulation.stopped:
        notes.append(f"stopped    after {len(made.skills)} of {len(simulation.skills)} skills")
    elif not simulation.complete:
        notes.append("failure    at the end: the goal is not reached")
    largest_mm, largest_deg = simulation.largest_mm, simulation.largest_deg
    if largest_mm is not None and largest_deg is not None:
        notes.append(f"arrival    within {largest_mm:.3f} mm and {largest_deg:.3f} degrees")
    if simulation.times is not None:
        notes.append(f"times      {difference_words(simulation.times, made.pace)}")
    rate = simulation.steps_per_s
    speed = f", {rate:,.0f} steps/s" if rate is not None else ""
    speed += ", filming included" if "video" in (simulation.files or {}) else ""
    held = f"{made.held_s:.1f} s of dwells at rest added, " if made.held_s else ""
    stepped_s = made.simulated_s - made.held_s
    notes.append(
        f"effort     {stepped_s:.1f} s simulated in {made.steps:,} steps, {held}"
        f"{simulation.wall_s:.1f} s{speed}"
    )
    if made.figures:
        notes.append(f"measured   {evidence_text(made.figures)}")
    notes += [f"{option:<10} {path}" for option, path in (simulation.files or {}).items()]
    return notes


def difference_words(times: TimeDifference, pace: str) -> str:
    """Return the difference of simulated and planned time in words, with its reasons.

    Parameters
    ----------
    times
        The difference.
    pace
        Speeds of the arm in the engine; empty if the engine gives none.
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
    }
    reasons = [
        f"{share_s:+.1f} s {reason}"
        for reason, share_s in shares.items()
        if share_s is not None and abs(share_s) >= _LEAST_SHOWN_S
    ]
    if times.acting_s is None:
        reasons.append("the engine measures no more")
    return f"{words}: {times.difference_s:+.1f} s" + "".join(f"; {one}" for one in reasons)
