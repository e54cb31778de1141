"""Joint angles for poses of the tip, within limits, those nearest to the home posture first.

Where there is a formula, it gives all of them. Seven joints leave one degree of freedom: the elbow
may swing about the line from shoulder to wrist. For an arm whose description says with which joint,
and a hand that points straight down, every start of the search gives one position of the elbow. For
all else the search starts from postures that fill the joints' ranges evenly.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, Final

import numpy as np
import pinocchio as pin

from skillplan.physics.linear_motions import LinearMotion
from skillplan.task.pose import DOWN, Point, same_direction
from skillplan_pinocchio.arm_model import (
    ArmModel,
    Vector,
    closing_yaw_rad,
    hand_pose,
    pose_down,
)
from skillplan_pinocchio.kinematics.fixed_order import dot, length, solved, times
from skillplan_pinocchio.kinematics.joint_path import JointPath
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


# A path is a spline through so many intervals.
_INTERVALS = 8
# Where it follows a direction of insertion, through more: it stays within 0.1 mm of the line.
_FINE_INTERVALS = 16


@dataclass(frozen=True)
class Strokes:
    """The paths of the joints to a target and back; the arm stops between two of them.

    Parameters
    ----------
    down
        To the target, one for each straight stretch of the tip.
    up
        Back from it, likewise.
    """

    down: tuple[JointPath, ...]
    up: tuple[JointPath, ...]

    @property
    def begin(self) -> Vector:
        """Joint angles where it begins [rad]."""
        return np.asarray(self.down[0].nodes[0])

    @property
    def end(self) -> Vector:
        """Joint angles where it ends [rad]."""
        return np.asarray(self.up[-1].nodes[-1])

    @cached_property
    def mirrored(self) -> bool:
        """Whether the way back is the way there."""
        return len(self.down) == len(self.up) and all(
            np.array_equal(there.nodes, back.nodes[::-1])
            for there, back in zip(self.down, reversed(self.up), strict=True)
        )

    @cached_property
    def distinct(self) -> tuple[JointPath, ...]:
        """The paths, each once, whichever way it is taken."""
        return self.down if self.mirrored else (*self.down, *self.up)


def strokes(
    arm: ArmModel, motion: LinearMotion, near: Vector | None = None
) -> Iterator[Strokes | Unreachable]:
    """Yield paths to a target and back, by posture at the target, the preferred first.

    Parameters
    ----------
    arm
        The arm.
    motion
        Where the tip goes.
    near
        A posture from which it is not to be far to the target, of a hand that does not point down
        [rad], shape (joints,); the home posture by default.

    Yields
    ------
    Strokes
        Along the motion; or why this posture leads to none.
    """
    if motion.is_vertical:
        for path in descent_paths(arm, motion.tip, motion.above, motion.closing_yaw_rad):
            yield path if isinstance(path, Unreachable) else there_and_back(path)
        return
    target = hand_pose(motion.tip, motion.orientation)
    if motion.points_down:
        found = elbows(arm, motion.tip, motion.closing_yaw_rad)
    else:
        found = postures(arm, target, near)
    for joints in found:
        if isinstance(joints, Unreachable):
            yield joints
            continue
        yield _along(arm, motion, joints)


def there_and_back(path: JointPath) -> Strokes:
    """Return a path and the same backwards."""
    return Strokes((path,), (JointPath(path.nodes[::-1]),))


def _along(arm: ArmModel, motion: LinearMotion, joints: Vector) -> Strokes | Unreachable:
    """Return the paths that lead to a posture at the target, and back from it."""
    # Of the two turns of the hand, the one that was found.
    _, rotation = arm.tip(joints)
    there = _followed(arm, motion.approach[::-1], joints, rotation)
    if isinstance(there, Unreachable):
        return there
    back = _followed(arm, motion.retreat, joints, rotation)
    if isinstance(back, Unreachable):
        return back
    down = tuple(JointPath(path.nodes[::-1]) for path in reversed(there))
    return Strokes(down, back)


def _followed(
    arm: ArmModel, points: Sequence[Point], joints: Vector, rotation: Any
) -> tuple[JointPath, ...] | Unreachable:
    """Return the paths along straight stretches of the tip, from a posture at the first point."""
    paths = []
    for begin, end in pairwise(points):
        nodes = [joints]
        for number in range(1, _FINE_INTERVALS + 1):
            position = np.array(_between(begin, end, number / _FINE_INTERVALS))
            reached = solve(arm, pin.SE3(rotation, position), nodes[-1])
            if isinstance(reached, Unreachable):
                return reached
            nodes.append(reached)
        joints = nodes[-1]
        paths.append(JointPath(nodes))
    return tuple(paths)


def descent_paths(
    arm: ArmModel, tip: Point, above: Point, closing_yaw: float
) -> Iterator[JointPath | Unreachable]:
    """Yield paths straight down to a target, by position of the elbow; see :func:`elbows`.

    Parameters
    ----------
    arm
        The arm.
    tip
        Where the tip is to be at the end [m].
    above
        Where it comes from, straight above [m].
    closing_yaw
        Direction in which the jaws are to close, from x about the vertical [rad].

    Yields
    ------
    JointPath
        From `above` to `tip`; or why this position of the elbow leads to none.
    """
    for elbow in elbows(arm, tip, closing_yaw):
        if isinstance(elbow, Unreachable):
            yield elbow
            continue
        _, rotation = arm.tip(elbow)
        # Of the two turns of the hand, the one that was found.
        yaw = closing_yaw_rad(rotation)
        nodes = [elbow]
        reached: Vector | Unreachable = elbow
        for number in range(1, _INTERVALS + 1):
            share = number / _INTERVALS
            position = _between(tip, above, share)
            reached = solve(arm, pose_down(position, yaw), nodes[-1])
            if isinstance(reached, Unreachable):
                break
            nodes.append(reached)
        yield reached if isinstance(reached, Unreachable) else JointPath(nodes[::-1])


def _between(one: Vector | Point, other: Vector | Point, share: float) -> Point:
    x, y, z = (
        float(a + share * (b - a)) for a, b in zip(np.asarray(one), np.asarray(other), strict=True)
    )
    return (x, y, z)
