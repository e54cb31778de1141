"""Joint angles for a tip that points straight down, by damped least squares within limits.

The seven joints leave one degree of freedom: the elbow may swing about the line from shoulder
to wrist. Every start of the search gives one position of the elbow, the one nearest to the
"ready" pose first.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pinocchio as pin

from skillplan.robots import panda
from skillplan.task.pose import DOWN, Point, same_direction
from skillplan_pinocchio.arm_model import (
    JOINTS,
    ArmModel,
    Vector,
    closing_yaw_rad,
    pose_down,
)
from skillplan_pinocchio.kinematics.numeric_inverse import Unreached

# A solution is this near, in position [m] and rotation [rad].
ACCURACY: Final = 1e-7

# By so much the elbow of a start is swung out [rad], nearest first.
ELBOWS_RAD: Final = (0.0, 0.4, -0.4, 0.8, -0.8, 1.2, -1.2)

_MOST_ITERATIONS = 120
_MOST_STEP_RAD = 0.3
_DAMPING = 1e-4
# This share of the distance to the start's posture is gone in an iteration; not in the last.
_PULL = 0.3
_PULLED_ITERATIONS = 25
_IDENTITY = np.eye(6)
# Of a hand that does not point down so many postures are looked for, from so many starts.
_POSTURES = 6
_TRIES = 24
_HALF_TURN = np.diag([-1.0, -1.0, 1.0])


@dataclass(frozen=True)
class Unreachable:
    """That a pose is out of reach, and why.

    Parameters
    ----------
    position
        Where the tip should be [m].
    why
        In words, such as ``joint 4 at its limit``.
    distance_m
        How far from there the nearest tip found is [m].
    points
        Unit vector along which the hand should point.
    """

    position: Point
    why: str
    distance_m: float
    points: Point = DOWN

    @property
    def reason(self) -> str:
        """One clause."""
        where = ", ".join(f"{value:.3f}" for value in self.position)
        if same_direction(self.points, DOWN):
            return f"the hand cannot point straight down at ({where}): {self.why}"
        along = ", ".join(f"{value:.2f}" for value in self.points)
        return f"the hand cannot point along ({along}) at ({where}): {self.why}"


def elbows(arm: ArmModel, position: Point, closing_yaw: float) -> Iterator[Vector | Unreachable]:
    """Yield joint angles for a pose, by elbow and hand, nearest to the ready pose first.

    Jaws close alike with the hand turned by half a turn, so that both are tried.

    Parameters
    ----------
    arm
        The arm.
    position
        Where the tip is to be [m].
    closing_yaw
        Direction in which the jaws are to close, from x about the vertical [rad].

    Yields
    ------
    Vector
        Joint angles [rad] within their limits, shape (7,), with the tip within 1e-6 m and
        1e-6 rad of the pose; or why this start led to none.
    """
    ready: Vector = np.array(panda.READY_RAD)
    _, rotation = arm.tip(ready)
    ready_yaw = closing_yaw_rad(rotation)
    bearing = math.atan2(position[1] - arm.base[1], position[0] - arm.base[0])
    for elbow_rad in ELBOWS_RAD:
        starts = []
        for turn in (0.0, math.pi):
            # The hand turns against the first joint, looked at from above.
            wrist = panda.READY_RAD[6] - _wrapped(closing_yaw + turn - ready_yaw - bearing)
            wrist = _within(wrist, arm.low_rad[6], arm.high_rad[6])
            # The less the hand is turned, the more room is left for the motions to come.
            starts.append((abs(wrist), wrist, turn))
        for _, wrist, turn in sorted(starts):
            start = ready.copy()
            start[0] = bearing - elbow_rad
            start[2] = elbow_rad
            start[6] = wrist
            yield solve(arm, pose_down(position, closing_yaw + turn), start, pull=_PULL)


def postures(arm: ArmModel, target: Any) -> Iterator[Vector | Unreachable]:
    """Yield joint angles for a hand that points anywhere, nearest to the ready pose first.

    Jaws close alike with the hand turned by half a turn, so that both are tried.

    Parameters
    ----------
    arm
        The arm.
    target
        Where the tip is to be, as `pinocchio.SE3`.

    Yields
    ------
    Vector
        Joint angles [rad] within their limits, shape (7,), of one turn of the hand or the other;
        or why there are none.
    """
    ready: Vector = np.array(panda.READY_RAD)
    found: list[Vector] = []
    for turn in (np.eye(3), _HALF_TURN):
        turned = pin.SE3(target.rotation @ turn, target.translation)
        found += arm.inverse.several(turned, _POSTURES, _TRIES)
    if not found:
        nearest = arm.inverse.solve(target)
        assert isinstance(nearest, Unreached)
        x, y, z = (float(value) for value in target.translation)
        px, py, pz = (float(value) for value in target.rotation[:, 2])
        missed_m = round(nearest.distance_m, 6)
        yield Unreachable((x, y, z), nearest.reason, missed_m, (px, py, pz))
        return
    # Sorting keeps the order of those that are equally far.
    yield from sorted(found, key=lambda joints: round(float(np.abs(joints - ready).max()), 6))


def solve(arm: ArmModel, target: Any, start: Vector, pull: float = 0.0) -> Vector | Unreachable:
    """Return joint angles for a pose, from a start.

    Parameters
    ----------
    arm
        The arm.
    target
        From :func:`pose_down`.
    start
        Joint angles [rad], shape (7,); moved into the limits.
    pull
        In [0, 1): how strongly the elbow is held where the start has it. At 0 the joints move
        as little as they can.

    Returns
    -------
    Vector
        Joint angles [rad] within their limits, shape (7,); or why there are none.
    """
    low, high = arm.low_rad, arm.high_rad
    posture = np.clip(start, low, high)
    joints = posture.copy()
    nearest = math.inf
    for iteration in range(_MOST_ITERATIONS):
        twist, jacobian = arm.error(joints, target)
        size = float(np.abs(twist).max())
        nearest = min(nearest, float(np.linalg.norm(twist[:3])))
        settled = pull == 0.0 or iteration >= _PULLED_ITERATIONS
        if size < ACCURACY and settled:
            return joints
        step = _step(jacobian, twist, 0.0 if settled else pull, posture - joints)
        moved = joints + step
        # A joint that would leave its limits stays at them, and the others do the work.
        stuck = (moved < low) | (moved > high)
        if stuck.any():
            free = jacobian * ~stuck
            held = np.where(stuck, np.clip(moved, low, high) - joints, 0.0)
            step = held + _step(free, twist - jacobian @ held, 0.0, posture) * ~stuck
        joints = np.clip(joints + step, low, high)
    x, y, z = (float(value) for value in target.translation)
    px, py, pz = (float(value) for value in target.rotation[:, 2])
    return Unreachable((x, y, z), _why(arm, joints, target), round(nearest, 6), (px, py, pz))


def _step(jacobian: Vector, twist: Vector, pull: float, back: Vector) -> Vector:
    """Return the change of the joints [rad] that goes for the pose, then for the posture."""
    # Less damping the nearer it is, so that the end is Newton's.
    damping = min(_DAMPING, float(twist @ twist)) + 1e-12
    inner = jacobian @ jacobian.T + damping * _IDENTITY
    if pull:
        back = pull * back
        step = back + jacobian.T @ np.linalg.solve(inner, twist - jacobian @ back)
    else:
        step = jacobian.T @ np.linalg.solve(inner, twist)
    size = float(np.abs(step).max())
    return step if size <= _MOST_STEP_RAD else step * (_MOST_STEP_RAD / size)


def _why(arm: ArmModel, joints: Vector, target: Any) -> str:
    near = 1e-6
    at_limit = [
        str(number + 1)
        for number in range(JOINTS)
        if not arm.low_rad[number] + near < joints[number] < arm.high_rad[number] - near
    ]
    if at_limit:
        these = "joint" if len(at_limit) == 1 else "joints"
        each = "its limit" if len(at_limit) == 1 else "their limits"
        return f"{these} {' and '.join(at_limit)} at {each}"
    shoulder = np.array(arm.base) + np.array([0.0, 0.0, panda.LINK_OFFSETS_M[0]])
    away = float(np.linalg.norm(target.translation - shoulder))
    return f"it is {away:.3f} m from the shoulder, beyond what the arm spans"


def _wrapped(angle_rad: float) -> float:
    """Return an angle in [-pi, pi)."""
    return (angle_rad + math.pi) % (2 * math.pi) - math.pi


def _within(angle_rad: float, low: float, high: float) -> float:
    """Return the turn of an angle that is within limits, or the nearest limit."""
    for turned in (angle_rad, angle_rad - 2 * math.pi, angle_rad + 2 * math.pi):
        if low <= turned <= high:
            return turned
    return min(max(angle_rad, low), high)
