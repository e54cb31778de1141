"""Kinematics of a robot's hand, and its rotations as matrices and rotation vectors.

The hand's z points out of it, its y along the closing axis of its jaws. Matrices have shape (3, 3),
rotation vectors shape (3,) [rad].
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import pinocchio
from numpy.typing import NDArray

from skillplan.robots.arm_description import ArmDescription, Transform
from skillplan.task.motion import Point
from skillplan.task.pose import Pose, Quaternion
from skillplan.task.scene import Robot
from skillplan_pinocchio.kinematics.fixed_order import length, times
from skillplan_pinocchio.kinematics.numeric_inverse import NumericInverse
from skillplan_pinocchio.kinematics.serial_arm import SerialArm

Vector = NDArray[np.float64]

# Tolerance of the cosine of a hand that points down.
_DOWN = 1e-9


# Moment of a payload that tilts no hand by much [N m].
_BALANCED_NM = 0.05


def is_balanced(moment_nm: Vector) -> bool:
    """Return whether the moment of a payload is small enough to be neglected."""
    return float(np.abs(moment_nm).max()) < _BALANCED_NM


def points_down(rotation: Vector) -> bool:
    """Return whether a hand points straight down."""
    return bool(rotation[2, 2] <= _DOWN - 1.0)


def convert_quaternion(orientation: Quaternion) -> Vector:
    """Return a unit quaternion (x, y, z, w) as a matrix."""
    return np.array(Pose((0.0, 0.0, 0.0), orientation).rotation)


def make_pose(position: Vector, rotation: Vector) -> Pose:
    """Return a position [m] and a rotation, up to rounding, as a pose."""
    x, y, z = position.tolist()
    across, out = ((rotation[:, axis] / length(rotation[:, axis])).tolist() for axis in (1, 2))
    return Pose.of_axes((x, y, z), tuple(across), tuple(out))


def compute_rpy(rotation: Vector) -> tuple[float, float, float]:
    """Return a rotation as roll, pitch and yaw [rad]."""
    sine = -float(rotation[2, 0])
    pitch = math.atan2(sine, math.hypot(float(rotation[0, 0]), float(rotation[1, 0])))
    if abs(sine) > 1 - 1e-12:
        # Roll and yaw turn about one axis.
        return 0.0, pitch, math.atan2(-float(rotation[0, 1]), float(rotation[1, 1]))
    roll = math.atan2(float(rotation[2, 1]), float(rotation[2, 2]))
    return roll, pitch, math.atan2(float(rotation[1, 0]), float(rotation[0, 0]))


def compute_turn(start: Vector, end: Vector) -> Vector:
    """Return the shortest rotation vector from one rotation to another [rad]."""
    change = times(end, start.T)
    axis = 0.5 * np.array(
        [change[2, 1] - change[1, 2], change[0, 2] - change[2, 0], change[1, 0] - change[0, 1]]
    )
    sine, cosine = length(axis), 0.5 * (float(np.trace(change)) - 1)
    if sine > 1e-7:
        return np.asarray(axis * (math.atan2(sine, cosine) / sine))
    if cosine > 0:
        return axis
    # Half a turn: the axis is the column of I + R that is longest.
    columns = 0.5 * (change + np.eye(3))
    longest = int(np.argmax(np.diag(columns)))
    column = columns[:, longest]
    return np.asarray(math.pi * column / length(column))


def compute_rotation_error(rotation: Vector, target: Vector) -> Vector:
    """Return the remaining rotation as an axis times the sine of the angle."""
    return np.array(compute_rotation_left(rotation, target))


def compute_rotation_left(rotation: Vector, target: Vector) -> tuple[float, float, float]:
    """Return `compute_rotation_error` as three floats."""
    # Half the sum of the cross products of the hand's axes; floats are faster here than arrays.
    (a, d, g), (b, e, h), (c, f, i) = rotation.tolist()
    (p, s, v), (q, t, w), (r, u, x) = target.tolist()
    return (
        0.5 * ((b * r - c * q) + (e * u - f * t) + (h * x - i * w)),
        0.5 * ((c * p - a * r) + (f * s - d * u) + (i * v - g * x)),
        0.5 * ((a * q - b * p) + (d * t - e * s) + (g * w - h * v)),
    )


@dataclass(frozen=True, slots=True)
class TipPose:
    """Pose of the tip of the hand: position [m], and the hand's axes as columns."""

    position: Vector
    rotation: Vector


class UnreachableError(Exception):
    """No joint angles bring the tip to a pose."""


class ArmKinematics:
    """Kinematics of a mounted arm with its hand.

    Parameters
    ----------
    base
        Pose of the base in the world.
    tool
        Pose of the tip in the frame of the flange.
    """

    def __init__(self, description: ArmDescription, base: Transform, tool: Transform) -> None:
        self.arm = SerialArm(description, base, tool)
        self.home_rad: Vector = self.arm.home_rad
        self.low_rad, self.high_rad = self.arm.low_rad, self.arm.high_rad
        self._numeric = NumericInverse(self.arm)
        self._tip = self.arm.model.getFrameId("tip")
        self._data = self.arm.model.createData()

    def tip(self, joints_rad: Vector) -> TipPose:
        """Return the pose of the tip.

        Parameters
        ----------
        joints_rad
            Joint angles [rad], shape (joints,).
        """
        pose = self.arm.tip(joints_rad)
        return TipPose(pose.translation.copy(), pose.rotation.copy())

    def frames(self, joints_rad: Vector) -> list[Any]:
        """Return the poses of the joints in order, then of the tip, as `pinocchio.SE3`."""
        model, data = self.arm.model, self._data
        pinocchio.framesForwardKinematics(model, data, joints_rad)
        joints = [data.oMi[index].copy() for index in range(1, model.njoints)]
        return [*joints, data.oMf[self._tip].copy()]

    def follow(self, position: Point, rotation: Vector, joints_rad: Vector) -> Vector | None:
        """Return joint angles near given ones for a nearby pose of the tip, or None."""
        return self._numeric.solve_from(joints_rad, _make_se3(position, rotation))


# Damping that keeps singular postures solvable.
_DAMPING = 1e-8


def resolve_acceleration(jacobian: Vector, acceleration: Vector) -> Vector:
    """Return joint accelerations nearest to an acceleration of the tip, for missing joints.

    With fewer than six joints the tip cannot take every acceleration.

    Parameters
    ----------
    jacobian
        Jacobian of the tip, linear above angular velocity, shape (6, joints).
    acceleration
        Linear above angular acceleration of the tip, shape (6,).
    """
    joints = jacobian.shape[1]
    inner = jacobian.T @ jacobian + _DAMPING * np.eye(joints)
    return np.asarray(np.linalg.solve(inner, jacobian.T @ acceleration))


@lru_cache(maxsize=16)
def _make_kinematics(
    description: ArmDescription, base: Transform, tool: Transform
) -> ArmKinematics:
    return ArmKinematics(description, base, tool)


def get_kinematics(robot: Robot) -> ArmKinematics:
    """Return the kinematics of a robot of a task, cached."""
    base = Transform(robot.base, compute_rpy(np.array(robot.mount.rotation)))
    return _make_kinematics(robot.model, base, robot.tip)


def make_unreachable_error(position: Point, rotation: Vector) -> UnreachableError:
    """Return the error that a pose is out of reach."""
    x, y, z = position
    along = ", ".join(f"{value + 0.0:.2f}" for value in rotation[:, 2].round(2))
    points = "pointing straight down" if points_down(rotation) else f"pointing along ({along})"
    return UnreachableError(
        f"no posture of the arm within its joint limits brings the hand, {points}, "
        f"to ({x:.3f}, {y:.3f}, {z:.3f}) m"
    )


def _make_se3(position: Point, rotation: Vector) -> Any:
    return pinocchio.SE3(rotation, np.array(position, dtype=float))
