"""Trajectories between their forms: keys of a task file, elements, and back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from skillplan.domains.swarmitfix.trajectory.path import TrajectoryPath
from skillplan.domains.swarmitfix.trajectory.path_elements import Arc, Element, Line, Spline
from skillplan.domains.swarmitfix.trajectory.plane_point import Point2
from skillplan.domains.swarmitfix.trajectory.schema import PathElementConfig, TrajectoryConfig


def elements_of(config: TrajectoryConfig) -> tuple[Point2, tuple[Element, ...]]:
    """Return where a trajectory starts [m] and its elements.

    Raises
    ------
    ValueError
        If an arc or spline is none, such as one whose points coincide.
    """
    if config.vertices_m is not None:
        first, *rest = config.vertices_m
        return point(first), tuple(Line(point(end)) for end in rest)
    assert config.start_m is not None
    assert config.path is not None
    return point(config.start_m), tuple(_element(entry) for entry in config.path)


def _element(entry: PathElementConfig) -> Element:
    if entry.line_to_m is not None:
        return Line(point(entry.line_to_m))
    if entry.arc_to_m is not None and entry.through_m is not None:
        return Arc(point(entry.arc_to_m), point(entry.through_m))
    return Spline(tuple(point(value) for value in entry.spline_through_m or ()))


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


def point(values: Sequence[float]) -> Point2:
    """Return two coordinates as a point."""
    return values[0], values[1]


def element_key(config: TrajectoryConfig, path: tuple[str | int, ...]) -> tuple[str | int, ...]:
    """Return the key path, under ``trajectory``, of a fault that names an element."""
    if config.file is not None:
        return ("file",)
    if path and path[0] == "chord_tolerance_m":
        return path
    if config.vertices_m is not None:
        # Element i leads to vertex i + 1.
        if path == ("start",):
            return ("vertices_m", 0)
        return ("vertices_m", path[0] + 1) if path and isinstance(path[0], int) else ("vertices_m",)
    if path == ("start",):
        return ("start_m",)
    return ("path", *path)
