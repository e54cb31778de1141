"""An arm or a tool from a file of its own, as a table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from skillplan.domains.assembly.arm_summary import ArmSummary, format_angle
from skillplan.domains.assembly.tool_summary import ToolSummary
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


def tabulate_tool(summary: ToolSummary) -> list[Table]:
    """Return a row for every fact, with extents, sources and notes below."""
    rows = [(key, _format(value), unit or "-") for key, value, unit in summary.facts]
    columns = [Column("key"), Column("value", right=True), Column("unit")]
    x_m, y_m, z_m = summary.size_m
    open_ = " open" if summary.kind == "gripper" else ""
    notes = [f"size        {x_m:.3f} x {y_m:.3f} x {z_m:.3f} m{open_}, from the flange to its tip"]
    notes += [f"source      {sentence}" for sentence in summary.model.sources]
    notes += [f"note        {sentence}" for sentence in summary.model.notes]
    return [Table(f"{summary.model.name}: a tool", columns, rows, notes)]


def _format(value: Any) -> str:
    if isinstance(value, list):
        return " to ".join(f"{item:g}" for item in value)
    return f"{value:g}" if isinstance(value, float) else str(value)
