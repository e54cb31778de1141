"""A tool from a file of its own, as a table."""

from __future__ import annotations

from typing import Any

from skillplan.domains.assembly.tool_summary import ToolSummary
from skillplan.views.text.table import Column, Table


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
