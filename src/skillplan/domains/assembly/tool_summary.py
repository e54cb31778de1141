"""Description of a tool alone, without a task: of the catalogue, or from a file."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from skillplan.domains.assembly.gripping import find_tool_issues
from skillplan.domains.assembly.tool_models import TOOLS, ToolFileError, ToolModel, read_tool_model
from skillplan.domains.assembly.tool_schema import ToolConfig, list_shape_corners
from skillplan.errors import Issue, TaskError
from skillplan.files.schema_errors import list_schema_issues
from skillplan.physics.linear_motions import build_tool_shapes
from skillplan.robots.catalogue import STANDARD_HAND
from skillplan.task.pose import Point
from skillplan.task.scene import STANDARD_CUP_M, Tool, ToolKind

# Keys that are facts of their own in a table, with their units, in order.
_FACTS: Final = (
    ("opening_m", "m"),
    ("clearance_m", "m"),
    ("outer_grip_m", "m"),
    ("inner_grip_m", "m"),
    ("cup_diameter_m", "m"),
    ("socket_m", "m"),
    ("socket_depth_m", "m"),
    ("bit_length_m", "m"),
    ("bit_diameter_m", "m"),
    ("force_n", "N"),
    ("torque_nm", "Nm"),
    ("speed_rpm", "1/min"),
    ("safety_factor", ""),
    ("acceleration_m_per_s2", "m/s2"),
    ("mass_kg", "kg"),
)


@dataclass(frozen=True)
class ToolSummary:
    """A tool as its file describes it, on an arm of the catalogue.

    Parameters
    ----------
    source
        Name or file.
    """

    source: str
    model: ToolModel
    config: ToolConfig

    @property
    def kind(self) -> ToolKind:
        """Type of the tool."""
        assert self.config.type is not None
        return ToolKind(self.config.type)

    @property
    def length_m(self) -> float:
        """Distance from the flange to its tip [m]."""
        return self.config.measure_length_m(self.kind, STANDARD_HAND)

    @property
    def pieces(self) -> list[tuple[bool, tuple[Point, ...]]]:
        """Corners of its convex pieces with open jaws [m], and whether they belong to its end.

        From the tip: x along the closing axis, z towards the flange.
        """
        if self.kind is not ToolKind.GRIPPER:
            shapes = build_tool_shapes(self._tool, STANDARD_HAND)
            ends = len(shapes) - max(1, len(self._tool.shapes))
            return [(n < ends, list_shape_corners(shape)) for n, shape in enumerate(shapes)]
        hand = self.config.hand_on(STANDARD_HAND) or STANDARD_HAND
        face_m = (self.config.opening_m or hand.opening_m) / 2
        jaws = [
            tuple((side * (face_m + behind), side * across, up) for behind, across, up in piece)
            for side in (-1, 1)
            for piece in hand.jaw
        ]
        bodies = [
            tuple((along, across, hand.tip_m - depth) for along, across, depth in piece)
            for piece in hand.body_as_described
        ]
        return [*((True, jaw) for jaw in jaws), *((False, body) for body in bodies)]

    @property
    def size_m(self) -> tuple[float, float, float]:
        """Extents with open jaws: along the closing axis, across it, and up to the flange [m]."""
        corners = [corner for _, piece in self.pieces for corner in piece]
        x_m, y_m = (2 * max(abs(corner[axis]) for corner in corners) for axis in (0, 1))
        return (x_m, y_m, self.length_m)

    @property
    def facts(self) -> list[tuple[str, Any, str]]:
        """Key, value and unit of its facts."""
        values = [("type", self.kind.value, ""), ("length_m", round(self.length_m, 6), "m")]
        if self.kind is ToolKind.SUCTION:
            values.append(("cups", len(self.config.cups), ""))
        values += [
            (key, getattr(self.config, key), unit)
            for key, unit in _FACTS
            if getattr(self.config, key, None) is not None
        ]
        return values

    def document(self) -> dict[str, Any]:
        """Return the document ``skillplan.tool/1`` without its first key."""
        return {
            "file": self.source,
            "name": self.model.name,
            "facts": {key: value for key, value, _ in self.facts},
            "size_m": [round(value, 6) for value in self.size_m],
            "sources": list(self.model.sources),
            "notes": list(self.model.notes),
        }

    @property
    def _tool(self) -> Tool:
        config, hand = self.config, STANDARD_HAND
        return Tool(
            "tool",
            "tool(tool)",
            (0.0, 0.0, 0.0),
            kind=self.kind,
            cup_m=config.cup_diameter_m or STANDARD_CUP_M,
            beyond_m=config.measure_beyond_m(self.kind, hand),
            bit_m=config.bit_m,
            shapes=config.list_shapes(self.kind, hand),
            cups=config.cups,
            is_socket=config.socket_m is not None,
        )


def summarize_tool(path: str) -> ToolSummary:
    """Return the description of a tool.

    Parameters
    ----------
    path
        Name of a tool of the catalogue, or a file.

    Raises
    ------
    TaskError
        If the file describes no tool, or a key is at fault.
    """
    file = Path(os.path.abspath(path))
    folder, name = (Path(), path) if path in TOOLS else (file.parent, file.name)
    try:
        model = read_tool_model(folder, name)
    except ToolFileError as error:
        raise TaskError(path, [Issue(str(error))]) from None
    try:
        config = ToolConfig.model_validate(
            {**model.keys, "holder_m": [0.0, 0.0]}, context={"folder": folder}
        )
    except ValidationError as error:
        raise TaskError(path, list_schema_issues(error, ToolConfig)) from None
    summary = ToolSummary(path, model, config)
    issues = list(find_tool_issues(config, summary.kind, STANDARD_HAND))
    if issues:
        raise TaskError(path, issues)
    return summary
