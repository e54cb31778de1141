"""The pose of a product on the table, or on a workholder that turns it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from skillplan_cad.product import Part, Points, Vector

Array = NDArray[np.float64]
Place = tuple[float, float]
_DECIMALS = 7
_SAME = 1e-6
_TWO = 2
# Clearance of the turning product above the table [m].
_CLEARANCE_M = 0.02


@dataclass(frozen=True, eq=False)
class Upright:
    """Pose of the product on the table.

    Parameters
    ----------
    matrix
        Rotation from the product's frame to the world.
    offset_m
        Translation after the rotation [m].
    turned
        Poses when parts and screws go in after the product was turned, in the order of the turns.
    pivot_m
        Fixed point of the turns [m]; None without turns.
    size_m
        Extents x y of the room in which the product stands or turns, and its height over the table
        [m].
    """

    matrix: Array
    offset_m: Array
    turned: Mapping[str, Upright] = field(default_factory=dict)
    pivot_m: tuple[float, float, float] | None = None
    size_m: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def of(self, name: str) -> Upright:
        """Return the pose of the product when a part goes in."""
        return self.turned.get(name, self)

    def keep_turned(self, names: AbstractSet[str]) -> Upright:
        """Return the same pose for fewer parts that go in after turns."""
        if names >= self.turned.keys():
            return self
        return replace(self, turned={n: pose for n, pose in self.turned.items() if n in names})

    @property
    def poses(self) -> tuple[Upright, ...]:
        """The first pose, and those after turns."""
        return tuple(dict.fromkeys((self, *self.turned.values())))

    def find_turn(self, other: Upright) -> Array:
        """Return the rotation from this pose to one after a turn."""
        return np.asarray(np.round(other.matrix @ self.matrix.T, _DECIMALS))

    def unpoint(self, point_m: Array) -> Array:
        """Return the point of the product at a point of the world."""
        return np.asarray(self.matrix.T @ (point_m - self.offset_m))

    def point(self, point_m: Vector) -> tuple[float, float, float]:
        """Return a point of the product in the world, rounded to 0.1 micrometres."""
        return _round(self.matrix @ np.asarray(point_m) + self.offset_m)

    def vector(self, vector: Vector) -> tuple[float, float, float]:
        """Return a direction of the product in the world."""
        return _round(self.matrix @ np.asarray(vector))

    def vertices(self, part: Part) -> Points:
        """Return the vertices of a part in the world."""
        return part.vertices_m @ self.matrix.T + self.offset_m

    def bottom(self, part: Part) -> tuple[float, float, float]:
        """Return the centre of the bottom face of a part's bounding box."""
        points = self.vertices(part)
        low, high = points.min(axis=0), points.max(axis=0)
        return _round(np.array([*((low + high) / 2)[:2], low[2]]))

    def size(self, part: Part) -> Array:
        """Return the extents of a part's bounding box."""
        return np.asarray(np.ptp(self.vertices(part), axis=0))


def place_turned(
    parts: Sequence[Part],
    ups: Sequence[Vector],
    turned: Mapping[str, Vector],
    place_m: Place,
    heading: int = 0,
) -> Upright:
    """Return the pose of parts on the table, or on a workholder that turns them above it.

    Turns from the first orientation are about level axes through the middle of the bounding box.

    Parameters
    ----------
    ups
        Vectors that point up one after another, in the product's frame.
    turned
        The one of each part and screw that goes in after a turn.
    place_m
        Centre of their bounding box, x y [m].
    heading
        Quarter turns about the vertical.
    """
    first = place_upright(parts, ups[0], place_m, heading)
    if len(ups) == 1:
        return first
    points = np.concatenate([first.vertices(part) for part in parts])
    half_m = np.ptp(points, axis=0) / 2
    turns = {up: compute_rotation_to_z(first.vector(up)) for up in ups[1:]}
    radius_m, room_m = float(half_m[2]), half_m.copy()
    for turn in turns.values():
        across = int(np.argmax(np.abs(turn.diagonal()[:2]) < 1 - _SAME)) if _is_quarter(turn) else 1
        swept_m = math.hypot(half_m[across], half_m[2])
        radius_m = max(radius_m, swept_m)
        room_m[across] = max(room_m[across], swept_m)
    if len(ups) > _TWO:
        radius_m = float(np.linalg.norm(half_m))
        room_m[:2] = radius_m
    pivot = np.array([*place_m, math.ceil((radius_m + _CLEARANCE_M) * 1e3) / 1e3])
    offset_m = first.offset_m + np.array([0.0, 0.0, pivot[2] - half_m[2]])
    poses = {
        up: Upright(turn @ first.matrix, turn @ (offset_m - pivot) + pivot)
        for up, turn in turns.items()
    }
    later = {name: poses[up] for name, up in turned.items()}
    size_m = _round(np.array([*(2 * room_m[:2]), pivot[2] + radius_m]))
    return Upright(first.matrix, offset_m, later, _round(pivot), size_m)


def _is_quarter(turn: Array) -> bool:
    """Return whether a rotation is a quarter turn, not a half one."""
    return abs(float(turn[2, 2])) < _SAME


def place_upright(parts: Iterable[Part], up: Vector, place_m: Place, heading: int = 0) -> Upright:
    """Return the pose that puts parts on the table, centred on a place.

    Parameters
    ----------
    up
        Vector that points up, in the product's frame.
    place_m
        Centre of their bounding box on the table, x y [m].
    heading
        Quarter turns about the vertical.
    """
    matrix = compute_rotation_to_z(up, heading)
    points = np.concatenate([part.vertices_m for part in parts]) @ matrix.T
    low, high = points.min(axis=0), points.max(axis=0)
    middle = (low + high) / 2
    offset_m = np.array([place_m[0] - middle[0], place_m[1] - middle[1], -low[2]])
    return Upright(matrix, offset_m, size_m=_round(high - low))


def name_orientations(upright: Upright) -> dict[Upright, str]:
    """Return the name of each pose of a product: up, down, and sides."""
    names: dict[Upright, str] = {}
    for pose in upright.poses:
        cosine = float(upright.find_turn(pose)[2, 2])
        stem = "up" if pose is upright else "down" if cosine < -_SAME else "side"
        count = sum(name.startswith(stem) for name in names.values())
        names[pose] = f"{stem}_{count + 1}" if count else stem
    return names


def list_angles_rad(rotation: Array) -> list[float]:
    """Return the angles about the fixed axes x, y and z of a rotation by quarter turns [rad]."""
    roll = math.atan2(rotation[2, 1], rotation[2, 2])
    pitch = math.asin(max(-1.0, min(1.0, -rotation[2, 0])))
    yaw = math.atan2(rotation[1, 0], rotation[0, 0])
    if abs(rotation[2, 0]) > 1 - _SAME:
        roll, yaw = 0.0, math.atan2(-rotation[0, 1], rotation[1, 1])
    return [round(angle, 8) + 0.0 for angle in (roll, pitch, yaw)]


def compute_rotation_to_z(up: Vector, heading: int = 0) -> Array:
    """Return the smallest rotation that turns a unit vector upwards, then some quarter turns."""
    if heading % 4:
        quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        return np.asarray(quarter @ compute_rotation_to_z(up, heading % 4 - 1))
    z = np.asarray(up) / np.linalg.norm(up)
    if abs(z[2]) > 1 - 1e-12:
        return np.diag([1.0, z[2], z[2]])
    axis = np.cross(z, [0.0, 0.0, 1.0])
    sine, cosine = float(np.linalg.norm(axis)), float(z[2])
    x, y, w = axis / sine
    across = np.array([[0.0, -w, y], [w, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + sine * across + (1 - cosine) * across @ across)


def _round(values: Array) -> tuple[float, float, float]:
    x, y, z = (round(float(value), _DECIMALS) + 0.0 for value in values)
    return x, y, z
