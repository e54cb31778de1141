"""A drawing placed on the bench, turned about its own origin and then moved, and as keys."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from skillplan_swarmitfix.trajectory.contours import FileContours
from skillplan_swarmitfix.trajectory.path import TrajectoryPath
from skillplan_swarmitfix.trajectory.path_elements import Arc, Element, Line, Spline
from skillplan_swarmitfix.trajectory.plane_point import Point2

# Cosine and sine of quarter turns, which are exact.
_QUARTERS = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))


FAR_M = 1000.0
"""A drawing that is farther from its origin has coordinates of a map [m]; `offset_m` ends here."""


def placed(contours: FileContours, offset_m: Point2, rotate_deg: float) -> FileContours:
    """Return contours turned anticlockwise about the origin [deg] and then moved [m].

    The origin of a drawing that lies beyond `FAR_M` from its own is its lower left corner, with a
    note.
    """
    cosine, sine = _turn(rotate_deg)
    x0_m, y0_m, x1_m, y1_m = contours.box_m
    if max(x0_m, -x1_m, y0_m, -y1_m) > FAR_M:
        note = (
            f"the origin lies over {FAR_M:.0f} m away; instead the lower left corner is taken, "
            f"[{x0_m:.3f}, {y0_m:.3f}] m"
        )
        contours = replace(contours, notes=(*contours.notes, note))
    else:
        x0_m = y0_m = 0.0

    def on_bench(point: Point2) -> Point2:
        x_m, y_m = point[0] - x0_m, point[1] - y0_m
        return (
            cosine * x_m - sine * y_m + offset_m[0],
            sine * x_m + cosine * y_m + offset_m[1],
        )

    def element_on_bench(element: Element) -> Element:
        match element:
            case Line():
                return Line(on_bench(element.end))
            case Arc():
                return Arc(on_bench(element.end), on_bench(element.through))
            case Spline():
                return Spline(tuple(on_bench(point) for point in element.through))

    def path_on_bench(path: TrajectoryPath) -> TrajectoryPath:
        return replace(
            path,
            start=on_bench(path.start),
            elements=tuple(element_on_bench(element) for element in path.elements),
        )

    return contours.moved(path_on_bench, on_bench)


def _turn(angle_deg: float) -> tuple[float, float]:
    quarters, rest_deg = divmod(angle_deg, 90.0)
    if rest_deg == 0.0:
        return _QUARTERS[int(quarters) % 4]
    return math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))


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
