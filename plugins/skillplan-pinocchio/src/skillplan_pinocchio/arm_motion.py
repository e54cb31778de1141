"""Paths of the joints to a target and back."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import pinocchio as pin

from skillplan.physics.linear_motions import LinearMotion
from skillplan.task.motion import Point
from skillplan_pinocchio.arm_model import (
    ArmModel,
    Vector,
    closing_yaw_rad,
    hand_pose,
    pose_down,
)
from skillplan_pinocchio.inverse_kinematics import Unreachable, elbows, postures, solve
from skillplan_pinocchio.kinematics.joint_path import JointPath

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
    for found in elbows(arm, tip, closing_yaw):
        if isinstance(found, Unreachable):
            yield found
            continue
        _, rotation = arm.tip(found)
        # Of the two turns of the hand, the one that was found.
        yaw = closing_yaw_rad(rotation)
        nodes = [found]
        reached: Vector | Unreachable = found
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
