"""Where the tip of a Panda is, and which joint angles bring it somewhere, pointing down.

The chain follows the published parameters (`skillplan.robots.panda`); the tests hold it against
the model that is simulated.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from skillplan.robots import panda
from skillplan.task.motion import Point

Vector = NDArray[np.float64]

_LOW = np.array(panda.JOINT_LOW_RAD)
_HIGH = np.array(panda.JOINT_HIGH_RAD)
_READY = np.array(panda.READY_RAD)
_ITERATIONS = 200
_DAMPING = 1e-4
_POSITION_TOLERANCE_M = 1e-6
_ANGLE_TOLERANCE_RAD = 1e-6
# Steps of the search are cut to this [rad]: the chain is far from linear.
_LONGEST_STEP_RAD = 0.4


@dataclass(frozen=True, slots=True)
class TipPose:
    """Where the tip of the hand is: its position [m], and the hand's axes as columns."""

    position: Vector
    rotation: Vector


class UnreachableError(Exception):
    """Raised, in words, where no joint angles bring the tip to a pose."""


def pointing_down(closing_yaw_rad: float) -> Vector:
    """Return the rotation of a hand that points straight down and closes along a direction."""
    cos, sin = math.cos(closing_yaw_rad), math.sin(closing_yaw_rad)
    # Columns: across the closing axis, along it, and down.
    return np.array([[-sin, cos, 0.0], [cos, sin, 0.0], [0.0, 0.0, -1.0]])


def forward(joints_rad: Vector, base: Point = (0.0, 0.0, 0.0)) -> tuple[TipPose, Vector]:
    """Return the pose of the tip and its Jacobian.

    Parameters
    ----------
    joints_rad
        Shape (7,).
    base
        Position of the arm's base [m].

    Returns
    -------
    tuple
        The pose, and the Jacobian of shape (6, 7): linear above angular velocity.
    """
    frame = np.eye(4)
    frame[:3, 3] = base
    axes, origins = [], []
    for length_m, offset_m, twist, angle in zip(
        panda.LINK_LENGTHS_M,
        panda.LINK_OFFSETS_M,
        panda.LINK_TWISTS_RAD,
        joints_rad.tolist(),
        strict=True,
    ):
        ca, sa, ct, st = math.cos(twist), math.sin(twist), math.cos(angle), math.sin(angle)
        frame = frame @ np.array(
            [
                [ct, -st, 0.0, length_m],
                [st * ca, ct * ca, -sa, -offset_m * sa],
                [st * sa, ct * sa, ca, offset_m * ca],
                [0.0, 0.0, 0.0, 1.0],
            ]
        )
        axes.append(frame[:3, 2])
        origins.append(frame[:3, 3])
    cos, sin = math.cos(panda.HAND_YAW_RAD), math.sin(panda.HAND_YAW_RAD)
    rotation = frame[:3, :3] @ np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    tip = frame[:3, 3] + rotation[:, 2] * (panda.FLANGE_M + panda.TIP_M)
    jacobian = np.empty((6, 7))
    jacobian[3:] = np.array(axes).T
    jacobian[:3] = _cross(jacobian[3:], (tip - np.array(origins)).T)
    return TipPose(tip, rotation), jacobian


def rotation_error(rotation: Vector, wanted: Vector) -> Vector:
    """Return the rotation that is left to be made, as an axis times the sine of the angle."""
    across = _cross(rotation, wanted)
    error: Vector = 0.5 * (across[:, 0] + across[:, 1] + across[:, 2])
    return error


def _cross(ones: Vector, others: Vector) -> Vector:
    """Return the cross products of columns: of three rows it is quicker than `numpy.cross`."""
    a, b, c = ones
    x, y, z = others
    return np.array([b * z - c * y, c * x - a * z, a * y - b * x])


def reach(tip: Point, yaw_rad: float, base: Point, seed: Vector | None = None) -> Vector:
    """Return joint angles that bring the tip to a point, the hand pointing straight down.

    Damped least squares from the seed, with the posture of most room in the null space.

    Parameters
    ----------
    tip
        Position [m].
    yaw_rad
        How the hand is turned about the vertical [rad].
    base
        Position of the arm's base [m].
    seed
        Shape (7,); the ready posture by default.

    Returns
    -------
    numpy.ndarray
        Joint angles of shape (7,) [rad].

    Raises
    ------
    UnreachableError
        If there are none within the joint limits.
    """
    return np.array(_reach(tip, yaw_rad, base, None if seed is None else tuple(seed.tolist())))


# The two ends of a motion are asked for again in every execution of it.
@lru_cache(maxsize=1024)
def _reach(
    tip: Point, yaw_rad: float, base: Point, seed: tuple[float, ...] | None
) -> tuple[float, ...]:
    """Return what `reach` returns, as numbers."""
    guesses = [_READY, _READY * np.array([-1, 1, -1, 1, -1, 1, 1])]
    for guess in guesses if seed is None else [np.array(seed), *guesses]:
        joints = _solve(np.array(tip), pointing_down(yaw_rad), base, guess.copy())
        if joints is not None:
            return tuple(joints.tolist())
    raise UnreachableError(
        f"no posture of the arm within its joint limits brings the hand, pointing straight "
        f"down, to ({tip[0]:.3f}, {tip[1]:.3f}, {tip[2]:.3f}) m"
    )


def follow(tip: Point, yaw_rad: float, base: Point, joints: Vector) -> Vector:
    """Return joint angles near given ones that bring the tip to a point close by.

    Raises
    ------
    UnreachableError
        If there are none within the joint limits.
    """
    found = _solve(np.array(tip), pointing_down(yaw_rad), base, joints)
    if found is None:
        raise UnreachableError(f"no posture near by brings the hand to {tip}")
    return found


def _solve(tip: Vector, rotation: Vector, base: Point, joints: Vector) -> Vector | None:
    for _ in range(_ITERATIONS):
        pose, jacobian = forward(joints, base)
        error = np.concatenate([tip - pose.position, rotation_error(pose.rotation, rotation)])
        facing = float(np.trace(pose.rotation.T @ rotation))
        if (
            np.linalg.norm(error[:3]) < _POSITION_TOLERANCE_M
            and np.linalg.norm(error[3:]) < _ANGLE_TOLERANCE_RAD
            and facing > 0
        ):
            return joints
        inverse_of = jacobian.T @ np.linalg.inv(jacobian @ jacobian.T + _DAMPING**2 * np.eye(6))
        step = inverse_of @ error
        # Towards the middle of the joints' ranges, as far as the tip is not moved by it.
        step += (np.eye(7) - inverse_of @ jacobian) @ (0.1 * (_READY - joints))
        longest = np.abs(step).max()
        if longest > _LONGEST_STEP_RAD:
            step *= _LONGEST_STEP_RAD / longest
        joints = np.clip(joints + step, _LOW, _HIGH)
    return None
