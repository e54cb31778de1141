"""Points of the bench's plane: when two are one, how far out they may lie, how they are shown."""

from __future__ import annotations

Point2 = tuple[float, float]

SAME_POINT_M = 1e-6
"""Distance below which points are equal [m], far below the accuracy of a bench."""

MAX_COORDINATE_M = 1e6
"""Greatest absolute value of a coordinate [m]; up to it rounding stays below 1e-9 m."""

MOST_READ_M = 1e8
"""Greatest absolute value of a coordinate in a file [m], which may be one of a map."""


def on_any_bench(point: Point2) -> bool:
    """Return whether both coordinates are finite and within `MAX_COORDINATE_M`."""
    return all(abs(coordinate) <= MAX_COORDINATE_M for coordinate in point)


def shown(point: Point2) -> str:
    """Return a point [m] as messages show it: ``(0.34, -1.2) m``."""
    return f"({point[0]:.9g}, {point[1]:.9g}) m"
