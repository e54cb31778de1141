"""The motion space of a part: offsets on a lattice, rotations about axes, and collisions.

The offsets bring faces into contact, which is where CAD has most stops and slots; evenly spaced
ones fill the gaps.
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
_PER_PLACEMENT = 0.02


@dataclass(frozen=True, slots=True)
class Axis:
    """A rotation axis.

    Parameters
    ----------
    point_m, direction
        Point and unit vector in the product's frame, with the part in place.
    """

    point_m: Vector
    direction: Vector


@dataclass(frozen=True, slots=True)
class Met:
    """A part that is hit on a motion."""

    part: str
    point_m: Vector


def rotate_about(axis: Axis, angle_rad: float) -> tuple[Array, Array]:
    """Return the rotation about an axis, as matrix and offset."""
    x, y, z = axis.direction
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    matrix = np.eye(3) + np.sin(angle_rad) * across + (1 - np.cos(angle_rad)) * across @ across
    point = np.asarray(axis.point_m)
    return matrix, point - matrix @ point


class Surroundings:
    """Collision test of the moving parts against the others.

    Parameters
    ----------
    moving
        Shrunk meshes that move as one.
    standing
        Shrunk meshes of the other parts.

    Attributes
    ----------
    effort
        Work done so far; 1 is about a millisecond. It depends on the meshes only.
    """

    def __init__(self, moving: Sequence[MeshTree], standing: Sequence[MeshTree]) -> None:
        self.moving, self.standing = tuple(moving), tuple(standing)
        self._lows = np.array([tree.low_m for tree in standing]).reshape(-1, 3)
        self._highs = np.array([tree.high_m for tree in standing]).reshape(-1, 3)
        self._points = np.concatenate([tree.vertices_m for tree in moving])
        self._request = coal.CollisionRequest(coal.CollisionRequestFlag.CONTACT, 1)
        self.effort = 0.0

    @cached_property
    def low_m(self) -> Array:
        """Lowest corner of the bounding box of the standing parts."""
        return np.asarray(self._lows.min(axis=0))

    @cached_property
    def high_m(self) -> Array:
        """Highest corner of the bounding box of the standing parts."""
        return np.asarray(self._highs.max(axis=0))

    def compute_box(self, matrix: Array) -> tuple[Array, Array]:
        """Return the bounding box of the moving parts, rotated about the origin."""
        points = self._points @ matrix.T
        return points.min(axis=0), points.max(axis=0)

    def find_obstacle(self, matrix: Array, offset_m: Array) -> Met | None:
        """Return the first obstacle of a placement, or None."""
        at = coal.Transform3s(matrix, offset_m)
        self.effort += _PER_PLACEMENT
        for mover in self.moving:
            centre = (mover.low_m + mover.high_m) / 2
            half = np.abs(matrix) @ ((mover.high_m - mover.low_m) / 2)
            middle = matrix @ centre + offset_m
            near = ((self._lows < middle + half) & (self._highs > middle - half)).all(axis=1)
            for number in np.flatnonzero(near):
                other = self.standing[number]
                self.effort += _estimate_effort(mover.size, other.size)
                result = coal.CollisionResult()
                if coal.collide(mover.tree, at, other.tree, _STILL, self._request, result):
                    point = result.getContact(0).pos
                    return Met(other.name, (float(point[0]), float(point[1]), float(point[2])))
        return None

    def list_overlaps(self) -> tuple[Met, ...]:
        """Return the standing parts that collide with the moving ones in their place."""
        overlaps = []
        for number in range(len(self.standing)):
            alone = Surroundings(self.moving, self.standing[number : number + 1])
            met = alone.find_obstacle(np.eye(3), np.zeros(3))
            if met is not None:
                overlaps.append(met)
        return tuple(overlaps)

    def is_out(self, low_m: Array, high_m: Array) -> bool:
        """Return whether a box is clear of the bounding box of the standing parts."""
        return bool(((high_m < self.low_m) | (low_m > self.high_m)).any())


def _estimate_effort(triangles: int, others: int) -> float:
    """Return the effort of a collision test of two meshes; measured on meshes from CAD."""
    pairs = triangles * others
    return min(6e-6 * pairs, 0.018 * float(np.sqrt(pairs)))


def list_stops(moving: Sequence[Part], standing: Sequence[Part], inset_m: float) -> list[Array]:
    """Return the offsets to consider along each axis, ascending, with 0 and one beyond each end.

    Parameters
    ----------
    inset_m
        Inset of the shrunk meshes; closer offsets are merged [m].
    """
    mine, theirs = _find_flats(moving), _find_flats(standing)
    low = np.min([part.bounds_m[0] for part in moving], axis=0)
    high = np.max([part.bounds_m[1] for part in moving], axis=0)
    lowest = np.min([part.bounds_m[0] for part in standing], axis=0)
    highest = np.max([part.bounds_m[1] for part in standing], axis=0)
    offsets = []
    for axis in range(3):
        begin, end = lowest[axis] - high[axis], highest[axis] - low[axis]
        beyond = 4 * inset_m
        # Contact is between faces of opposite normals.
        meeting = [
            stand - move
            for side in (0, 1)
            for move in mine[axis][side]
            for stand in theirs[axis][1 - side]
        ]
        near = sorted(
            {round(offset, 7) for offset in meeting if begin < offset < end}, key=_sort_key
        )
        spacing = (end - begin) / _EVEN_STEPS
        even = [k * spacing for k in range(-_EVEN_STEPS, _EVEN_STEPS + 1)]
        kept = [0.0, begin - beyond, end + beyond]
        for offset in (*near[:_MOST_STOPS], *(step for step in even if begin < step < end)):
            if min(abs(offset - other) for other in kept) > inset_m:
                kept.append(offset)
        offsets.append(np.array(sorted(kept)))
    return offsets


def _sort_key(offset: float) -> tuple[float, float]:
    return abs(offset), offset


def _find_flats(parts: Sequence[Part]) -> list[tuple[list[float], list[float]]]:
    """Return the positions of flat faces across each axis, for both signs of the normal."""
    corners = np.concatenate([part.vertices_m[part.triangles] for part in parts])
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    normals = normals / np.maximum(lengths, 1e-30)[:, None]
    flats = []
    for axis in range(3):
        sides = []
        for sign in (1.0, -1.0):
            flat = (normals[:, axis] * sign > 1 - 1e-6) & (lengths > 0)
            sides.append(sorted({round(float(value), 7) for value in corners[flat, 0, axis]}))
        flats.append((sides[0], sides[1]))
    return flats


def find_axes(moving: Sequence[Part], most: int = 3) -> tuple[Axis, ...]:
    """Return candidate rotation axes: the axes of round faces, the largest first.

    Parts without round faces get the three axes through their centre.
    """
    faces = [face for part in moving for face in part.faces if face.kind == "cylinder"]
    faces.sort(key=lambda face: -face.radius_m * (face.extent_m[1] - face.extent_m[0]))
    axes: list[Axis] = []
    for face in faces:
        new = Axis(face.origin_m, face.axis)
        if not any(_is_same_line(new, axis) for axis in axes):
            axes.append(new)
    if not axes:
        corners = np.concatenate([part.bounds_m for part in moving])
        middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
        point = (float(middle[0]), float(middle[1]), float(middle[2]))
        lines = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
        axes = [Axis(point, line) for line in lines]
    return tuple(axes[:most])


def _is_same_line(first: Axis, second: Axis) -> bool:
    along = np.asarray(first.direction)
    if abs(along @ np.asarray(second.direction)) < 1 - 1e-6:
        return False
    offset = np.asarray(second.point_m) - np.asarray(first.point_m)
    return bool(np.linalg.norm(np.cross(offset, along)) < 1e-5)
