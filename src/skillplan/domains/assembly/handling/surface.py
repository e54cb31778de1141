"""Where a straight line meets the surface of a shape: what a suction cup lands on."""

from __future__ import annotations

import math
from collections.abc import Iterable

from skillplan.task.pose import Point, cross, dot, plus
from skillplan.task.shape import Box, Cylinder, Mesh, Shape

# A line along an edge meets the shape; rounding may put it so far out [m].
_RIM_M = 1e-9


def surface_m(shapes: Iterable[Shape], start: Point, direction: Point) -> float | None:
    """Return how far along a line from a point the first surface is [m], or None without one.

    Parameters
    ----------
    shapes
        In the frame of their body.
    start
        A point outside all of them [m].
    direction
        Of length 1.
    """
    spans = (_span(shape, start, direction) for shape in shapes)
    return min((span[0] for span in spans if span is not None), default=None)


def _span(shape: Shape, start: Point, direction: Point) -> tuple[float, float] | None:
    """Return from where to where a line is inside a convex shape [m], or None."""
    if isinstance(shape, Box):
        return _meeting(
            _between(start[axis] - shape.centre[axis], direction[axis], shape.size[axis] / 2)
            for axis in range(3)
        )
    if isinstance(shape, Cylinder):
        z = _between(start[2] - shape.centre[2], direction[2], shape.height_m / 2)
        return _meeting((z, _round(shape, start, direction)))
    return _through(shape, start, direction)


def _between(offset: float, slope: float, half: float) -> tuple[float, float] | None:
    """Return where ``|offset + t * slope| <= half``."""
    if abs(slope) < 1e-12:
        return (-math.inf, math.inf) if abs(offset) <= half + _RIM_M else None
    ends = ((-half - offset) / slope, (half - offset) / slope)
    return min(ends), max(ends)


def _round(shape: Cylinder, start: Point, direction: Point) -> tuple[float, float] | None:
    """Return where a line is inside an upright cylinder without ends."""
    x, y = start[0] - shape.centre[0], start[1] - shape.centre[1]
    a = direction[0] ** 2 + direction[1] ** 2
    radius = shape.diameter_m / 2
    if a < 1e-18:
        return (-math.inf, math.inf) if math.hypot(x, y) <= radius + _RIM_M else None
    middle = -(x * direction[0] + y * direction[1]) / a
    off2 = (x + middle * direction[0]) ** 2 + (y + middle * direction[1]) ** 2
    if off2 > (radius + _RIM_M) ** 2:
        return None
    half = math.sqrt(max(radius * radius - off2, 0.0) / a)
    return middle - half, middle + half


def _through(shape: Mesh, start: Point, direction: Point) -> tuple[float, float] | None:
    """Return where a line goes into a closed surface of triangles and where it comes out."""
    met = []
    for face in shape.faces:
        corner, one, other = (shape.corners[index] for index in face)
        u, v = plus(one, corner, -1.0), plus(other, corner, -1.0)
        normal = cross(u, v)
        steep = dot(normal, direction)
        if abs(steep) < 1e-18:
            continue
        away = dot(normal, plus(corner, start, -1.0)) / steep
        inside = plus(plus(start, direction, away), corner, -1.0)
        size = dot(normal, normal)
        b = dot(cross(inside, v), normal) / size
        c = dot(cross(u, inside), normal) / size
        if min(b, c, 1 - b - c) >= -1e-9:
            met.append(away)
    return (min(met), max(met)) if met else None


def _meeting(spans: Iterable[tuple[float, float] | None]) -> tuple[float, float] | None:
    low, high = -math.inf, math.inf
    for span in spans:
        if span is None:
            return None
        low, high = max(low, span[0]), min(high, span[1])
    return (low, high) if low <= high + _RIM_M else None
