"""An arm from a file of its own, as a table."""

from __future__ import annotations

from collections.abc import Sequence

from skillplan.domains.assembly.arm_summary import ArmSummary, format_angle
from skillplan.views.text.table import Column, Table

_MOST_TIPS = 4


def tabulate_arm(summary: ArmSummary) -> list[Table]:
    """Return a row for every moving joint, with tip, reach, masses and assumptions below."""
    rows = []
    for joint in summary.joints:
        is_prismatic = joint["type"] == "prismatic"
        low, high, home, speed = (
            format_angle(value, is_prismatic=is_prismatic)
            for value in (*joint["range"], joint["home"], joint["speed"])
        )
        effort = "-" if joint["effort"] is None else f"{joint['effort']:g}"
        rows.append(
            (
                joint["name"],
                joint["type"],
                f"{low} to {high}",
                home,
                f"{speed}/s",
                f"{effort} {'N' if is_prismatic else 'Nm'}" if joint["effort"] else "-",
                "-" if joint["mass_kg"] is None else f"{joint['mass_kg']:.3g} kg",
                str(joint["pieces"]),
            )
        )
    columns = [Column("joint"), Column("type"), Column("range"), Column("home", right=True)]
    columns += [Column(name, right=True) for name in ("speed", "effort", "mass", "pieces")]
    notes = [
        f"tip         {summary.tip}, at zero {_format_point(summary.tip_at_zero_m)} m, at home "
        f"{_format_point(summary.tip_at_home_m)} m",
        f"freedom     {summary.freedom}",
        f"reach       {summary.reach_m:.3f} m from the first joint, of sampled postures",
        f"masses      {'unknown' if summary.mass_kg is None else f'{summary.mass_kg:.4g} kg'}",
        "payload     "
        + (
            "unknown: robot.payload_kg"
            if summary.payload_kg is None
            else f"{summary.payload_kg:g} kg"
        ),
    ]
    if not summary.points_down:
        notes.append(f"warning     no sampled posture points z of {summary.tip} down: another tip?")
    if summary.other_tips:
        notes.append(f"other tips  {', '.join(summary.other_tips[:_MOST_TIPS])}")
    notes += [f"assumed     {sentence}" for sentence in summary.arm.assumptions]
    notes += [f"unchecked   {sentence}" for sentence in summary.arm.not_checked]
    title = f"{summary.arm.name}: an arm of {len(rows)} joints"
    return [Table(title, columns, rows, notes)]


def _format_point(point: Sequence[float]) -> str:
    return "(" + ", ".join(f"{value:.5g}" for value in point) + ")"
