"""Bodies from above and in space: corners and faces of their shapes where they stand."""

from __future__ import annotations

import math

from skillplan.task.pose import Point as Point3
from skillplan.task.pose import Pose
from skillplan.task.scene import Body
from skillplan.task.shape import Box, Cylinder, Shape
from skillplan.views.pictures.drawing import Point, hull

_SIDES = 24
_FACES = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))


def corners_of(shape: Shape) -> list[Point3]:
    """Return the corners of a shape in its body's frame [m]; a cylinder has 24 sides."""
    if isinstance(shape, Box):
        (x, y, z), (sx, sy, sz) = shape.centre, shape.size
        return [
            (x + i * sx / 2, y + j * sy / 2, z + k * sz / 2)
            for k in (-1, 1)
            for j in (-1, 1)
            for i in (-1, 1)
        ]
    if isinstance(shape, Cylinder):
        radius_m = shape.diameter_m / 2
        x, y, z = shape.centre
        return [
            (
                x + radius_m * math.cos(2 * math.pi * side / _SIDES),
                y + radius_m * math.sin(2 * math.pi * side / _SIDES),
                z + end * shape.height_m / 2,
            )
            for end in (-1, 1)
            for side in range(_SIDES)
        ]
    return list(shape.corners)


def faces_of(shape: Shape) -> list[tuple[int, ...]]:
    """Return the faces of a shape by corners, anticlockwise from outside."""
    if isinstance(shape, Box):
        return list(_FACES)
    if isinstance(shape, Cylinder):
        sides = [
            (k, (k + 1) % _SIDES, _SIDES + (k + 1) % _SIDES, _SIDES + k) for k in range(_SIDES)
        ]
        bottom, top = tuple(reversed(range(_SIDES))), tuple(range(_SIDES, 2 * _SIDES))
        return [*sides, bottom, top]
    return list(shape.faces)


def outlines(body: Body, pose: Pose) -> list[tuple[Point, ...]]:
    """Return the outline of each of a body's convex shapes from above [m]."""
    found = []
    for shape in body.shapes:
        seen = [pose.apply(corner)[:2] for corner in corners_of(shape)]
        found.append(hull([(round(x, 6), round(y, 6)) for x, y in seen]))
    return [one for one in found if len(one) > 2]
