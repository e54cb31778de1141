"""Poses of an arm's links in many postures at once."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from skillplan.robots.arm_description import ArmDescription, Joint, Transform
from skillplan.robots.urdf import Rigid

Numbers = NDArray[np.float64]


def make_matrix(transform: Transform) -> Numbers:
    """Return a transform as a matrix, shape (4, 4)."""
    rigid = Rigid.of(transform.xyz_m, transform.rpy_rad)
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rigid.rows, rigid.origin
    return matrix


def compute_link_frames(
    arm: ArmDescription, joints_rad: Numbers, base: Numbers | None = None
) -> list[Numbers]:
    """Return the frames of base, links and flange, each of shape (n, 4, 4).

    Parameters
    ----------
    joints_rad
        Joint angles, of prismatic joints strokes [m], shape (n, joints).
    base
        Pose of the base in the world, shape (4, 4). Default: at its origin.
    """
    frames = [np.tile(np.eye(4) if base is None else base, (len(joints_rad), 1, 1))]
    for number, joint in enumerate(arm.joints):
        placed = frames[-1] @ make_matrix(joint.placement)
        frames.append(placed @ _move(joint, joints_rad[:, number]))
    return [*frames, frames[-1] @ make_matrix(arm.tip)]


def _move(joint: Joint, values: Numbers) -> Numbers:
    if not joint.is_prismatic:
        return rotate_about(joint.axis, values)
    motions = np.tile(np.eye(4), (len(values), 1, 1))
    motions[:, :3, 3] = values[:, np.newaxis] * np.array(joint.axis)
    return motions


def rotate_about(axis: Sequence[float], angles_rad: Numbers) -> Numbers:
    """Return rotations about a unit axis, shape (n, 4, 4) (Rodrigues)."""
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotations = np.tile(np.eye(4), (len(angles_rad), 1, 1))
    sine, versine = np.sin(angles_rad)[:, None, None], 1 - np.cos(angles_rad)[:, None, None]
    rotations[:, :3, :3] += sine * skew + versine * (skew @ skew)
    return rotations


def spread_postures(arm: ArmDescription, count: int, share: float = 1.0) -> Numbers:
    """Return postures that fill the joint ranges evenly, shape (count, joints) (Roberts 2018).

    Parameters
    ----------
    share
        Share of each range about its middle, in (0, 1]. Of a joint that turns further, one turn.
    """
    low, high = np.array(arm.low_rad), np.array(arm.high_rad)
    turns = [math.inf if joint.is_prismatic else math.pi for joint in arm.joints]
    half = share * np.minimum((high - low) / 2, turns)
    # Root of x^(d + 1) = x + 1, by fixed-point iteration.
    root = 2.0
    for _ in range(64):
        root = (1 + root) ** (1 / (len(low) + 1))
    steps = np.array([root ** -(number + 1) for number in range(len(low))])
    places = (0.5 + np.outer(np.arange(1, count + 1), steps)) % 1.0
    return follow(arm, (low + high) / 2 + half * (2 * places - 1))


def follow(arm: ArmDescription, postures: Numbers) -> Numbers:
    """Return postures with each following joint where its leader puts it, shape (n, joints)."""
    followed = np.array(postures)
    for number, joint in enumerate(arm.joints):
        if joint.follows is not None:
            leader, factor, offset = joint.follows
            followed[..., number] = factor * followed[..., leader] + offset
    return followed
