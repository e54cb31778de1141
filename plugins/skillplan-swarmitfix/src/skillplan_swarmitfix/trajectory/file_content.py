"""Content of a trajectory file as the equivalent keys of a task file."""

from __future__ import annotations

from typing import Any

from skillplan_swarmitfix.trajectory.path import TrajectoryPath
from skillplan_swarmitfix.trajectory.path_elements import Arc, Element, Line


def content_of(path: TrajectoryPath) -> dict[str, Any]:
    """Return a trajectory read from a file as the keys that would describe it."""
    return {
        "closed": path.closed,
        "start_m": list(path.start),
        "path": [_entry(element) for element in path.elements],
    }


def _entry(element: Element) -> dict[str, Any]:
    if isinstance(element, Line):
        return {"line_to_m": list(element.end)}
    if isinstance(element, Arc):
        return {"arc_to_m": list(element.end), "through_m": list(element.through)}
    return {"spline_through_m": [list(value) for value in element.through]}
