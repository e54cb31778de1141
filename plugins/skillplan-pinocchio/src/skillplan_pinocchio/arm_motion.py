"""Paths of the joints: straight down to a target, and from above one target to above another."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from skillplan.task.motion import Point
from skillplan_pinocchio.arm_model import ArmModel, Vector, closing_yaw_rad, pose_down
from skillplan_pinocchio.inverse_kinematics import Unreachable, elbows, solve
from skillplan_pinocchio.joint_path import JointPath

# A path is a spline through so many intervals.
_INTERVALS = 8


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


def transfer_path(arm: ArmModel, start: Vector, end: Vector) -> JointPath:
    """Return the path of a transfer motion, the tip in a straight line, the hand pointing down.

    Where the straight line leads out of reach, as close to the base, all joints go straight to
    their ends instead.

    Parameters
    ----------
    arm
        The arm.
    start, end
        Joint angles with the hand pointing down [rad], shape (7,).
    """
    shares = [number / _INTERVALS for number in range(_INTERVALS + 1)]
    straight = [start + share * (end - start) for share in shares]
    begin, _ = arm.tip(start)
    finish, _ = arm.tip(end)
    yaws = _unwound([closing_yaw_rad(arm.tip(joints)[1]) for joints in straight])
    nodes = [start]
    for share, joints in zip(shares[1:-1], straight[1:-1], strict=True):
        position = _between(begin, finish, share)
        yaw = yaws[0] + share * (yaws[-1] - yaws[0])
        found = solve(arm, pose_down(position, yaw), joints)
        if isinstance(found, Unreachable):
            return JointPath(straight)
        nodes.append(found)
    return JointPath([*nodes, end])


def _between(one: Vector | Point, other: Vector | Point, share: float) -> Point:
    x, y, z = (
        float(a + share * (b - a)) for a, b in zip(np.asarray(one), np.asarray(other), strict=True)
    )
    return (x, y, z)


def _unwound(angles_rad: list[float]) -> list[float]:
    """Return angles with whole turns added, so that none is more than half a turn from the last."""
    found = angles_rad[:1]
    for angle in angles_rad[1:]:
        found.append(found[-1] + (angle - found[-1] + math.pi) % (2 * math.pi) - math.pi)
    return found
