"""Where a part may be on its way out: offsets on a lattice, turns about axes, and what it meets.

Offsets are those at which its faces come to faces of others, as CAD has most of its stops and
slots there, and evenly spaced ones between them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import coal
import numpy as np
from numpy.typing import NDArray

from skillplan_cad.planning.shrunk_meshes import MeshTree
from skillplan_cad.product import Part, Vector

Array = NDArray[np.float64]
_STILL = coal.Transform3s()
_EVEN_STEPS = 16
_MOST_STOPS = 40


@dataclass(frozen=True, slots=True)
class Axis:
    """A line that a part may be turned about.

    Parameters
    ----------
    point_m, direction
        In the product's frame, with the part in place.
    """

    point_m: Vector
    direction: Vector


@dataclass(frozen=True, slots=True)
class Met:
    """A part that is met on a motion.

    Parameters
    ----------
    part
        Its name.
    point_m
        Where they meet.
    """

    part: str
    point_m: Vector


def turned(axis: Axis, angle_rad: float) -> tuple[Array, Array]:
    """Return the rotation about a line, as a matrix and the offset that belongs to it."""
    x, y, z = axis.direction
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    matrix = np.eye(3) + np.sin(angle_rad) * across + (1 - np.cos(angle_rad)) * across @ across
    point = np.asarray(axis.point_m)
    return matrix, point - matrix @ point


class Surroundings:
    """What stands about the parts that move, and whether these meet it.

    Parameters
    ----------
    moving
        Shrunk meshes of what moves as one.
    standing
        Shrunk meshes of what stands.
    """

    def __init__(self, moving: Sequence[MeshTree], standing: Sequence[MeshTree]) -> None:
        self.moving, self.standing = tuple(moving), tuple(standing)
        self._lows = np.array([one.low_m for one in standing]).reshape(-1, 3)
        self._highs = np.array([one.high_m for one in standing]).reshape(-1, 3)
        self._points = np.concatenate([one.vertices_m for one in moving])
        self._request = coal.CollisionRequest(coal.CollisionRequestFlag.CONTACT, 1)

    @cached_property
    def low_m(self) -> Array:
        """The least corner of the box about all that stands."""
        return np.asarray(self._lows.min(axis=0))

    @cached_property
    def high_m(self) -> Array:
        """The greatest corner of it."""
        return np.asarray(self._highs.max(axis=0))

    def box_of(self, matrix: Array) -> tuple[Array, Array]:
        """Return the box about what moves, turned about the origin."""
        points = self._points @ matrix.T
        return points.min(axis=0), points.max(axis=0)

    def meets(self, matrix: Array, offset_m: Array) -> Met | None:
        """Return what a placement of the moving parts meets first in order, or None."""
        at = coal.Transform3s(matrix, offset_m)
        for one in self.moving:
            centre = (one.low_m + one.high_m) / 2
            half = np.abs(matrix) @ ((one.high_m - one.low_m) / 2)
            middle = matrix @ centre + offset_m
            near = ((self._lows < middle + half) & (self._highs > middle - half)).all(axis=1)
            for number in np.flatnonzero(near):
                other = self.standing[number]
                result = coal.CollisionResult()
                if coal.collide(one.tree, at, other.tree, _STILL, self._request, result):
                    point = result.getContact(0).pos
                    return Met(other.name, (float(point[0]), float(point[1]), float(point[2])))
        return None

    def is_out(self, low_m: Array, high_m: Array) -> bool:
        """Return whether a box is beside the box about all that stands."""
        return bool(((high_m < self.low_m) | (low_m > self.high_m)).any())


def stops(moving: Sequence[Part], standing: Sequence[Part], inset_m: float) -> list[Array]:
    """Return for each axis the offsets to consider, ascending, with 0 and one beyond each end.

    Parameters
    ----------
    moving, standing
        What moves and what stands.
    inset_m
        By how much less than the meshes collide; offsets closer than that are one.
    """
    mine, theirs = _flats(moving), _flats(standing)
    low = np.min([part.bounds_m[0] for part in moving], axis=0)
    high = np.max([part.bounds_m[1] for part in moving], axis=0)
    least = np.min([part.bounds_m[0] for part in standing], axis=0)
    most = np.max([part.bounds_m[1] for part in standing], axis=0)
    found = []
    for axis in range(3):
        begin, end = least[axis] - high[axis], most[axis] - low[axis]
        beyond = 4 * inset_m
        # A face comes to one that looks the other way.
        meeting = [
            stand - move
            for side in (0, 1)
            for move in mine[axis][side]
            for stand in theirs[axis][1 - side]
        ]
        near = sorted({round(one, 7) for one in meeting if begin < one < end}, key=_by_size)
        spacing = (end - begin) / _EVEN_STEPS
        even = [k * spacing for k in range(-_EVEN_STEPS, _EVEN_STEPS + 1)]
        kept = [0.0, begin - beyond, end + beyond]
        for one in (*near[:_MOST_STOPS], *(each for each in even if begin < each < end)):
            if min(abs(one - other) for other in kept) > inset_m:
                kept.append(one)
        found.append(np.array(sorted(kept)))
    return found


def _by_size(offset: float) -> tuple[float, float]:
    return abs(offset), offset


def _flats(parts: Sequence[Part]) -> list[tuple[list[float], list[float]]]:
    """Return for each axis where flat faces across it lie: those that look along it, and back."""
    corners = np.concatenate([part.vertices_m[part.triangles] for part in parts])
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    normals = normals / np.maximum(lengths, 1e-30)[:, None]
    found = []
    for axis in range(3):
        sides = []
        for sign in (1.0, -1.0):
            flat = (normals[:, axis] * sign > 1 - 1e-6) & (lengths > 0)
            sides.append(sorted({round(float(one), 7) for one in corners[flat, 0, axis]}))
        found.append((sides[0], sides[1]))
    return found


def axes_of(moving: Sequence[Part], most: int = 3) -> tuple[Axis, ...]:
    """Return the lines that parts may be turned about: of their round faces, the largest first.

    What has none may be turned about lines through its middle.
    """
    faces = [face for part in moving for face in part.faces if face.kind == "cylinder"]
    faces.sort(key=lambda face: -face.radius_m * (face.extent_m[1] - face.extent_m[0]))
    found: list[Axis] = []
    for face in faces:
        new = Axis(face.origin_m, face.axis)
        if not any(_same_line(new, axis) for axis in found):
            found.append(new)
    if not found:
        corners = np.concatenate([part.bounds_m for part in moving])
        middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
        point = (float(middle[0]), float(middle[1]), float(middle[2]))
        lines = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
        found = [Axis(point, line) for line in lines]
    return tuple(found[:most])


def _same_line(one: Axis, other: Axis) -> bool:
    along = np.asarray(one.direction)
    if abs(along @ np.asarray(other.direction)) < 1 - 1e-6:
        return False
    apart = np.asarray(other.point_m) - np.asarray(one.point_m)
    return bool(np.linalg.norm(np.cross(apart, along)) < 1e-5)
