"""Poses in space, and vectors.

Quaternions are ``(x, y, z, w)``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

Point = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Rotation = tuple[Point, Point, Point]

DOWN: Point = (0.0, 0.0, -1.0)
"""Unit vector that points down in the world."""

# Tolerance of the cosine of two equal directions.
_SAME = 1e-9


@dataclass(frozen=True, slots=True)
class Pose:
    """Position [m] and orientation (unit quaternion x, y, z, w)."""

    position: Point
    orientation: Quaternion = (0.0, 0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        if not all(math.isfinite(value) for value in (*self.position, *self.orientation)):
            raise ValueError("Pose must be finite.")
        norm = math.sqrt(sum(value * value for value in self.orientation))
        if abs(norm - 1) > 1e-9:
            raise ValueError(f"Pose quaternion must have unit length, not {norm}.")

    @classmethod
    def upright(cls, position: Point, yaw_rad: float = 0.0) -> Pose:
        """Return a pose rotated by `yaw_rad` about the vertical."""
        return cls(position, (0.0, 0.0, math.sin(yaw_rad / 2), math.cos(yaw_rad / 2)))

    @classmethod
    def turned(cls, position: Point, rpy_rad: Point) -> Pose:
        """Return a pose rotated about the fixed axes x, y and z, in this order.

        Parameters
        ----------
        position
            Position of the origin [m].
        rpy_rad
            Roll, pitch and yaw [rad], as in a URDF.
        """
        roll, pitch, yaw = rpy_rad
        if roll == pitch == 0.0:
            return cls.upright(position, yaw)
        sr, cr = math.sin(roll / 2), math.cos(roll / 2)
        sp, cp = math.sin(pitch / 2), math.cos(pitch / 2)
        sy, cy = math.sin(yaw / 2), math.cos(yaw / 2)
        return cls(
            position,
            _unit(
                (
                    sr * cp * cy - cr * sp * sy,
                    cr * sp * cy + sr * cp * sy,
                    cr * cp * sy - sr * sp * cy,
                    cr * cp * cy + sr * sp * sy,
                )
            ),
        )

    @classmethod
    def of_axes(cls, position: Point, y: Point, z: Point) -> Pose:
        """Return the pose with given y and z axes: perpendicular unit vectors."""
        x = cross(y, z)
        return cls(
            position, _quaternion(((x[0], y[0], z[0]), (x[1], y[1], z[1]), (x[2], y[2], z[2])))
        )

    @property
    def yaw_rad(self) -> float:
        """Rotation about the vertical [rad], in (-pi, pi]."""
        x, y, z, w = self.orientation
        return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))

    @property
    def is_upright(self) -> bool:
        """True if the z axis is vertical."""
        x, y, _, _ = self.orientation
        return 2 * (x * x + y * y) <= _SAME

    @property
    def rotation(self) -> Rotation:
        """Rows of the rotation matrix."""
        x, y, z, w = self.orientation
        return (
            (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
            (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
            (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
        )

    def rotate(self, vector: Point) -> Point:
        """Return a vector of this frame in the parent frame."""
        a, b, c = self.rotation
        return (dot(a, vector), dot(b, vector), dot(c, vector))

    def apply(self, point: Point) -> Point:
        """Return a point of this frame in the parent frame [m]."""
        return plus(self.position, self.rotate(point))

    def then(self, other: Pose) -> Pose:
        """Return a pose of this frame in the parent frame."""
        return Pose(self.apply(other.position), _unit(_times(self.orientation, other.orientation)))

    def inverse(self) -> Pose:
        """Return the pose of the parent frame in this frame."""
        x, y, z, w = self.orientation
        back = Pose((0.0, 0.0, 0.0), (-x, -y, -z, w))
        px, py, pz = back.rotate(self.position)
        return Pose((-px, -py, -pz), back.orientation)

    def moved(self, by: Point) -> Pose:
        """Return the pose moved by a vector [m]."""
        return Pose(plus(self.position, by), self.orientation)


def dot(a: Point, b: Point) -> float:
    """Return the scalar product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Point, b: Point) -> Point:
    """Return the vector product of two vectors."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def plus(a: Point, b: Point, times: float = 1.0) -> Point:
    """Return `a + times * b`."""
    return (a[0] + times * b[0], a[1] + times * b[1], a[2] + times * b[2])


def unit(vector: Point) -> Point:
    """Return the unit vector in the direction of a vector.

    Raises
    ------
    ValueError
        If the vector is zero or not finite.
    """
    length = math.hypot(*vector)
    if not 0 < length < math.inf:
        raise ValueError(f"{vector} has no direction.")
    return (vector[0] / length, vector[1] / length, vector[2] / length)


def is_unit(vector: Point) -> bool:
    """Return whether a vector has length 1."""
    return abs(math.hypot(*vector) - 1) <= _SAME


def is_same_direction(a: Point, b: Point) -> bool:
    """Return whether two unit vectors are equal."""
    return dot(a, b) >= 1 - _SAME


def _times(a: Quaternion, b: Quaternion) -> Quaternion:
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def _unit(q: Quaternion) -> Quaternion:
    norm = math.sqrt(sum(value * value for value in q))
    x, y, z, w = (value / norm for value in q)
    return (x, y, z, w)


def _quaternion(rows: Rotation) -> Quaternion:
    """Return the quaternion of a rotation matrix (Shepperd 1978)."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rows
    largest = max(xx + yy + zz, xx, yy, zz)
    if largest == xx + yy + zz:
        q = (zy - yz, xz - zx, yx - xy, 1 + xx + yy + zz)
    elif largest == xx:
        q = (1 + xx - yy - zz, xy + yx, xz + zx, zy - yz)
    elif largest == yy:
        q = (xy + yx, 1 + yy - xx - zz, yz + zy, xz - zx)
    else:
        q = (xz + zx, yz + zy, 1 + zz - xx - yy, yx - xy)
    return _unit(q)
