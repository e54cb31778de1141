"""The centre of a body's volume, and whether what it stands on is about it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise

from skillplan.collision.solids.polygons import Planar
from skillplan.task.pose import Point, Pose, cross, dot
from skillplan.task.shape import Box, Cylinder, Mesh, Shape

_ROUNDING_M = 1e-9


def centre_of(shapes: Sequence[Shape], pose: Pose) -> Planar:
    """Return the centre of volume of some shapes at a pose, seen from above [m].

    What several of them share counts several times.
    """
    measured = [_volume(shape) for shape in shapes]
    total = sum(volume for volume, _ in measured)
    x, y, z = (sum(volume * at[i] for volume, at in measured) / total for i in range(3))
    placed = pose.apply((x, y, z))
    return placed[0], placed[1]


def stands(centre: Planar, corners: Iterable[Planar]) -> bool:
    """Whether a point lies within the hull of others: whether they surround it."""
    angles = []
    for x, y in corners:
        dx, dy = x - centre[0], y - centre[1]
        if math.hypot(dx, dy) <= _ROUNDING_M:
            return True
        angles.append(math.atan2(dy, dx))
    if not angles:
        return False
    angles.sort()
    around = [*angles, angles[0] + 2 * math.pi]
    return max(b - a for a, b in pairwise(around)) <= math.pi + _ROUNDING_M


def _volume(shape: Shape) -> tuple[float, Point]:
    """Return the volume of a shape [m3] and its centre [m]."""
    if isinstance(shape, Box):
        return math.prod(shape.size), shape.centre
    if isinstance(shape, Cylinder):
        return math.pi / 4 * shape.diameter_m**2 * shape.height_m, shape.centre
    return _volume_within(shape)


def _volume_within(mesh: Mesh) -> tuple[float, Point]:
    total, x, y, z = 0.0, 0.0, 0.0, 0.0
    for face in mesh.faces:
        a, b, c = (mesh.corners[index] for index in face)
        # Of the tetrahedron with the origin as its fourth corner.
        volume = dot(a, cross(b, c)) / 6
        total += volume
        x += volume * (a[0] + b[0] + c[0]) / 4
        y += volume * (a[1] + b[1] + c[1]) / 4
        z += volume * (a[2] + b[2] + c[2]) / 4
    return total, (x / total, y / total, z / total)
