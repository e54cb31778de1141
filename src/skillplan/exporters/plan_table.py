"""A plan as a table of comma-separated values, planned row for each skill."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping
from typing import ClassVar

from skillplan.exporters.exporter import (
    Exporter,
    Handover,
    PlannedSkill,
    format_decimal,
    note_arrivals,
    note_zones,
    states_torques,
)

COLUMNS = (
    "step",
    "action",
    "skill",
    "kind",
    "subject",
    "agents",
    "tool",
    "from",
    "to",
    "cost",
    "cost_unit",
    "duration_s",
    "begin_s",
    "start_x_m",
    "start_y_m",
    "start_z_m",
    "goal_x_m",
    "goal_y_m",
    "goal_z_m",
    "way",
)
TORQUE_COLUMN = "torque_nm"
"""Last column of a plan with screws whose torque is stated."""

# Spreadsheets take cells with these first characters for formulas. The last one escapes such
# texts.
_FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n", "'")


class CsvExporter(Exporter):
    """A table of the plan, a row a skill, for spreadsheets and scripts."""

    name: ClassVar[str] = "csv"
    suffix: ClassVar[str] = ".csv"

    def notes(self, handover: Handover) -> tuple[str, ...]:
        """Return that the file holds no times of arrival and no zones."""
        return (*note_arrivals(handover), *note_zones(handover))

    def files(self, handover: Handover) -> Mapping[str, str | bytes]:
        """Return the table, with escaped formulas (see `read_cell`)."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        with_torque = states_torques(handover)
        writer.writerow((*COLUMNS, *((TORQUE_COLUMN,) if with_torque else ())))
        begin_s = 0.0
        for skill in handover.skills:
            row = _build_row(skill, begin_s, handover.task.metric.unit)
            torque = "" if skill.torque_nm is None else format_decimal(skill.torque_nm)
            writer.writerow((*row, *((torque,) if with_torque else ())))
            begin_s += skill.step.duration_s
        return {"plan.csv": text.getvalue()}


def read_cell(cell: str) -> str:
    """Return the original text of a cell."""
    return cell[1:] if cell[:1] == "'" and cell[1:2] in _FORMULA else cell


def _build_row(planned: PlannedSkill, begin_s: float, unit: str) -> Iterable[str]:
    step, skill = planned.step, planned.skill
    texts = (skill.name, skill.kind, planned.subject, " ".join(skill.agents), planned.tool)
    points = [*(step.start or ("",) * 3), *(step.goal or ("",) * 3)]
    return (
        str(step.index + 1),
        str(step.action),
        *map(_escape, (*texts, planned.origin, planned.destination)),
        format_decimal(step.cost),
        _escape(unit),
        format_decimal(step.duration_s),
        format_decimal(begin_s),
        *(value if isinstance(value, str) else format_decimal(value) for value in points),
        _escape(step.way or ""),
    )


def _escape(cell: str) -> str:
    return f"'{cell}" if cell.startswith(_FORMULA) else cell
