"""Joint angles for poses of the tip, within limits, those nearest to the home posture first.

Where there is a formula, it gives all of them. Seven joints leave one degree of freedom: the elbow
may swing about the line from shoulder to wrist. For an arm whose description says with which joint,
and a hand that points straight down, every start of the search gives one position of the elbow. For
all else the search starts from postures that fill the joints' ranges evenly.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pinocchio as pin

from skillplan.task.pose import DOWN, Point, same_direction
from skillplan_pinocchio.arm_model import (
    ArmModel,
    Vector,
    closing_yaw_rad,
    pose_down,
)
from skillplan_pinocchio.kinematics.fixed_order import dot, length, solved, times
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
# From this cosine on a direction is another one.
_STRAIGHT = 1 - 1e-9
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
    """Yield joint angles for a hand that points down, nearest to the home posture first.

    Jaws close alike with the hand turned by half a turn, so that both are tried.

    Parameters
    ----------
    arm
        The arm.
    position
        Where the tip is to be in the world [m].
    closing_yaw
        Direction in which the jaws are to close, from x about the vertical [rad].

    Yields
    ------
    Vector
        Joint angles [rad] within their limits, shape (joints,), with the tip within 1e-6 m and
        1e-6 rad of the pose; or why this start led to none.
    """
    _, rotation = arm.tip(arm.home_rad)
    swing = arm.description.swing
    if swing is None or not arm.mount.is_upright or rotation[2, 2] > -_STRAIGHT:
        yield from postures(arm, pose_down(position, closing_yaw))
        return
    base, elbow, hand = swing
    turned, home = arm.mount.yaw_rad, arm.home_rad
    home_yaw = closing_yaw_rad(rotation) - turned
    away = arm.mount.position
    bearing = math.atan2(position[1] - away[1], position[0] - away[0]) - turned
    for elbow_rad in ELBOWS_RAD:
        starts = []
        for turn in (0.0, math.pi):
            # The hand turns against the first joint, looked at from above.
            wrist = home[hand] - _wrapped(closing_yaw - turned + turn - home_yaw - bearing)
            wrist = _within(wrist, arm.low_rad[hand], arm.high_rad[hand])
            # The less the hand is turned, the more room is left for the motions to come.
            starts.append((abs(wrist), wrist, turn))
        for _, wrist, turn in sorted(starts):
            start = home.copy()
            start[base] = bearing - elbow_rad
            start[elbow] = elbow_rad
            start[hand] = wrist
            yield solve(arm, pose_down(position, closing_yaw + turn), start, pull=_PULL)


def postures(
    arm: ArmModel, target: Any, near: Vector | None = None
) -> Iterator[Vector | Unreachable]:
    """Yield joint angles for a hand that points anywhere, nearest to a posture first.

    Jaws close alike with the hand turned by half a turn, so that both are tried.

    Parameters
    ----------
    arm
        The arm.
    target
        Where the tip is to be, as `pinocchio.SE3`.
    near
        That posture [rad], shape (joints,); the home posture by default.

    Yields
    ------
    Vector
        Joint angles [rad] within their limits, shape (joints,), of one turn of the hand or the
        other; or why there are none.
    """
    found: list[Vector] = []
    for turn in (np.eye(3), _HALF_TURN):
        turned = pin.SE3(times(target.rotation, turn), target.translation)
        if near is not None:
            closest = solve(arm, turned, near)
            found += [] if isinstance(closest, Unreachable) else [closest]
        found += _solutions(arm, turned)
    if not found:
        yield _last_try(arm, target)
        return
    wanted = arm.home_rad if near is None else near
    # Sorting keeps the order of those that are equally far.
    yield from sorted(found, key=lambda joints: round(float(np.abs(joints - wanted).max()), 6))


def _solutions(arm: ArmModel, target: Any) -> list[Vector]:
    if arm.closed_form is None:
        return arm.inverse.several(target, _POSTURES, _TRIES)
    turn = 2 * math.pi
    found = []
    for joints in arm.closed_form.solve(target):
        # Of the full turns of a joint, the one nearest to home.
        nearest = joints + turn * np.round((arm.home_rad - joints) / turn)
        nearest = np.where(nearest < arm.low_rad, nearest + turn, nearest)
        nearest = np.where(nearest > arm.high_rad, nearest - turn, nearest)
        found.append(nearest)
    return found


def _last_try(arm: ArmModel, target: Any) -> Vector | Unreachable:
    """Return joint angles from other starts, or why there are none."""
    if arm.closed_form is not None:
        return solve(arm, target, arm.home_rad)
    found = arm.inverse.solve(target)
    if not isinstance(found, Unreached):
        return found
    return _unreachable(target, found.reason, found.distance_m)


def _unreachable(target: Any, why: str, distance_m: float) -> Unreachable:
    x, y, z = (float(value) for value in target.translation)
    px, py, pz = (float(value) for value in target.rotation[:, 2])
    return Unreachable((x, y, z), why, round(distance_m, 6), (px, py, pz))


def solve(arm: ArmModel, target: Any, start: Vector, pull: float = 0.0) -> Vector | Unreachable:
    """Return joint angles for a pose, from a start.

    Parameters
    ----------
    arm
        The arm.
    target
        From :func:`pose_down`.
    start
        Joint angles [rad], shape (joints,); moved into the limits.
    pull
        In [0, 1): how strongly the elbow is held where the start has it. At 0 the joints move
        as little as they can.

    Returns
    -------
    Vector
        Joint angles [rad] within their limits, shape (joints,); or why there are none.
    """
    low, high = arm.low_rad, arm.high_rad
    posture = np.clip(start, low, high)
    joints = posture.copy()
    missed = []
    for iteration in range(_MOST_ITERATIONS):
        twist, jacobian = arm.error(joints, target)
        settled = pull == 0.0 or iteration >= _PULLED_ITERATIONS
        if settled and float(np.abs(twist).max()) < ACCURACY:
            return joints
        missed.append(twist[:3])
        step = _step(jacobian, twist, 0.0 if settled else pull, posture - joints)
        moved = joints + step
        # A joint that would leave its limits stays at them, and the others do the work.
        stuck = (moved < low) | (moved > high)
        if stuck.any():
            free = jacobian * ~stuck
            held = np.where(stuck, np.clip(moved, low, high) - joints, 0.0)
            step = held + _step(free, twist - times(jacobian, held), 0.0, posture) * ~stuck
            moved = np.clip(joints + step, low, high)
        joints = moved
    nearest_m = min(length(one) for one in missed)
    return _unreachable(target, _why(arm, joints, target), nearest_m)


def _step(jacobian: Vector, twist: Vector, pull: float, back: Vector) -> Vector:
    """Return the change of the joints [rad] that goes for the pose, then for the posture."""
    # Less damping the nearer it is, so that the end is Newton's.
    damping = min(_DAMPING, dot(twist, twist)) + 1e-12
    inner = times(jacobian, jacobian.T) + damping * _IDENTITY
    if pull:
        back = pull * back
        left = twist - times(jacobian, back)
        step = back + times(jacobian.T, solved(inner, left))
    else:
        step = times(jacobian.T, solved(inner, twist))
    size = float(np.abs(step).max())
    return step if size <= _MOST_STEP_RAD else step * (_MOST_STEP_RAD / size)


def _why(arm: ArmModel, joints: Vector, target: Any) -> str:
    near = 1e-6
    at_limit = [
        str(number + 1)
        for number in range(arm.joints)
        if not arm.low_rad[number] + near < joints[number] < arm.high_rad[number] - near
    ]
    if at_limit:
        these = "joint" if len(at_limit) == 1 else "joints"
        each = "its limit" if len(at_limit) == 1 else "their limits"
        return f"{these} {' and '.join(at_limit)} at {each}"
    away = length(target.translation - arm.shoulder)
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
