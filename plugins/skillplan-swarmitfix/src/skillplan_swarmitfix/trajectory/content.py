"""From the keys of a task file to its trajectory, and back to a key at fault or in doubt."""

from __future__ import annotations

from collections.abc import Sequence

from skillplan.errors import Issue
from skillplan_swarmitfix.trajectory.path_elements import Arc, Element, Line, Spline
from skillplan_swarmitfix.trajectory.plane_point import Point2
from skillplan_swarmitfix.trajectory.schema import PathElementConfig, TrajectoryConfig, in_file
from skillplan_swarmitfix.trajectory.units import DEFAULT_UNIT, is_doubtful


def elements_of(config: TrajectoryConfig) -> tuple[Point2, tuple[Element, ...]]:
    """Return the start of a trajectory [m] and its elements.

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


def unit_doubt(config: TrajectoryConfig) -> Issue | None:
    """Return why the unit that was guessed for a file is hardly meant, by its key; or None."""
    extent_m = config.guessed_unit_extent_m
    if config.file is None or extent_m is None or not is_doubtful(extent_m):
        return None
    message = (
        f"Its unit is not given, and read in {DEFAULT_UNIT} it is {extent_m:.3g} m long. Give "
        "trajectory.unit, such as m or in."
    )
    return Issue(in_file(config.file, "", message), ("file",))
