"""Upright prisms: boxes with a vertical axis and upright cylinders, exactly and without numpy."""

from __future__ import annotations

import math
from dataclasses import dataclass

from skillplan.collision.solids.polygons import Planar, Polygon, intersection, inwards, overlap
from skillplan.task.pose import Pose
from skillplan.task.shape import Box, Cylinder, Shape

# An axis whose cosine with the vertical is this near to 1 is vertical: 5 micrometres of 100 mm.
_VERTICAL = 1e-9
# A point on the rim counts; rounding may put it so far out [m].
_RIM_M = 1e-9
# Corners of the polygon that has a circle's area.
_CIRCLE = 180


@dataclass(frozen=True, slots=True)
class Prism:
    """A polygon or a circle, from one height to another.

    Parameters
    ----------
    low_m, high_m
        Heights of bottom and top [m].
    outline
        Seen from above, corners anticlockwise [m]; empty for a circle.
    centre
        Of the circle [m].
    radius_m
        Of the circle [m].
    """

    low_m: float
    high_m: float
    outline: Polygon = ()
    centre: Planar = (0.0, 0.0)
    radius_m: float = 0.0

    @property
    def width_m(self) -> float:
        """Its least extent in the plane [m]."""
        if not self.outline:
            return 2 * self.radius_m
        a, b, c = self.outline[:3]
        return min(math.dist(a, b), math.dist(b, c))

    @property
    def face(self) -> Polygon:
        """Its top and bottom, seen from above; of a circle a polygon of the same area."""
        if self.outline:
            return self.outline
        step = 2 * math.pi / _CIRCLE
        radius_m = self.radius_m * math.sqrt(step / math.sin(step))
        x, y = self.centre
        return tuple(
            (x + radius_m * math.cos(step * i), y + radius_m * math.sin(step * i))
            for i in range(_CIRCLE)
        )

    def beside_m(self, other: Prism) -> float:
        """Return how far it must move in the plane to be beside another [m]; below 0 if it is."""
        if self.outline and other.outline:
            return overlap(self.outline, other.outline)
        if self.outline:
            return other.radius_m + inwards(self.outline, other.centre)
        if other.outline:
            return self.radius_m + inwards(other.outline, self.centre)
        return self.radius_m + other.radius_m - math.dist(self.centre, other.centre)

    def depth_m(self, other: Prism) -> float:
        """Return how deep it is in another [m]: the least way out; below 0 if they are apart."""
        upright = min(self.high_m - other.low_m, other.high_m - self.low_m)
        return upright if upright <= 0 else min(upright, self.beside_m(other))

    def holds(self, x_m: float, y_m: float) -> bool:
        """Whether a point of the plane is in its outline or on the rim."""
        if self.outline:
            return inwards(self.outline, (x_m, y_m)) >= -_RIM_M
        return math.dist(self.centre, (x_m, y_m)) <= self.radius_m + _RIM_M

    def shared(self, other: Prism) -> Polygon:
        """Return what both cover, seen from above."""
        return intersection(self.face, other.face)


def prism_of(shape: Shape, pose: Pose) -> Prism | None:
    """Return a shape at a pose as an upright prism, or None where it is none."""
    if not isinstance(shape, Box | Cylinder):
        return None
    size = shape.box.size
    rows = pose.rotation
    up = max(range(3), key=lambda axis: abs(rows[2][axis]))
    if 1 - abs(rows[2][up]) > _VERTICAL or (isinstance(shape, Cylinder) and up != 2):
        return None
    x, y, z = pose.apply(shape.centre)
    low_m, high_m = z - size[up] / 2, z + size[up] / 2
    if isinstance(shape, Cylinder):
        return Prism(low_m, high_m, centre=(x, y), radius_m=shape.diameter_m / 2)
    u, v = (axis for axis in range(3) if axis != up)
    a = (rows[0][u] * size[u] / 2, rows[1][u] * size[u] / 2)
    b = (rows[0][v] * size[v] / 2, rows[1][v] * size[v] / 2)
    if a[0] * b[1] < a[1] * b[0]:
        b = (-b[0], -b[1])
    return Prism(
        low_m,
        high_m,
        (
            (x - a[0] - b[0], y - a[1] - b[1]),
            (x + a[0] - b[0], y + a[1] - b[1]),
            (x + a[0] + b[0], y + a[1] + b[1]),
            (x - a[0] + b[0], y - a[1] + b[1]),
        ),
    )
