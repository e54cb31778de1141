"""Many rotations and frames at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from skillplan.robots.arm_description import ArmDescription, Transform
from skillplan.robots.rigid import Rigid
from skillplan.task.pose import Pose

Numbers = NDArray[np.float64]


def matrix(transform: Transform) -> Numbers:
    """Return a transform as a matrix, shape (4, 4)."""
    rigid = Rigid.of(transform.xyz_m, transform.rpy_rad)
    return _filled(np.array(rigid.rows), np.array(rigid.origin))


def pose_matrix(pose: Pose) -> Numbers:
    """Return a pose as a matrix, shape (4, 4)."""
    return _filled(np.array(pose.rotation), np.array(pose.position))


def _filled(rows: Numbers, origin: Numbers) -> Numbers:
    made = np.eye(4)
    made[:3, :3], made[:3, 3] = rows, origin
    return made


def about(axis: Sequence[float], angles_rad: Numbers) -> Numbers:
    """Return rotations about a unit axis, shape (n, 4, 4) (Rodrigues)."""
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    made = np.tile(np.eye(4), (len(angles_rad), 1, 1))
    sine, versine = np.sin(angles_rad)[:, None, None], 1 - np.cos(angles_rad)[:, None, None]
    made[:, :3, :3] += sine * skew + versine * (skew @ skew)
    return made


def link_frames(arm: ArmDescription, mount: Pose, joints_rad: Numbers) -> list[Numbers]:
    """Return the frames of base, links and flange, each of shape (n, 4, 4).

    Parameters
    ----------
    arm
        With as many joints as there are columns.
    mount
        Of its base in the world.
    joints_rad
        Angles, shape (n, joints).
    """
    frames = [np.tile(pose_matrix(mount), (len(joints_rad), 1, 1))]
    for number, joint in enumerate(arm.joints):
        placed = frames[-1] @ matrix(joint.placement)
        frames.append(placed @ about(joint.axis, joints_rad[:, number]))
    return [*frames, frames[-1] @ matrix(arm.tip)]


def rows_of(frames: Numbers) -> Numbers:
    """Return frames as positions and quaternions, shape (n, 7); neighbours in one hemisphere."""
    r = frames[:, :3, :3]
    trace = r[:, 0, 0] + r[:, 1, 1] + r[:, 2, 2]
    # Of four ways to a quaternion each frame takes the one that divides by the most (Shepperd).
    choice = np.argmax(np.stack([r[:, 0, 0], r[:, 1, 1], r[:, 2, 2], trace], axis=1), axis=1)
    q = np.empty((len(r), 4))
    for axis in range(3):
        own = choice == axis
        j, k = (axis + 1) % 3, (axis + 2) % 3
        q[own, axis] = 1 + 2 * r[own, axis, axis] - trace[own]
        q[own, j] = r[own, j, axis] + r[own, axis, j]
        q[own, k] = r[own, k, axis] + r[own, axis, k]
        q[own, 3] = r[own, k, j] - r[own, j, k]
    own = choice == 3
    q[own, 0] = r[own, 2, 1] - r[own, 1, 2]
    q[own, 1] = r[own, 0, 2] - r[own, 2, 0]
    q[own, 2] = r[own, 1, 0] - r[own, 0, 1]
    q[own, 3] = 1 + trace[own]
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    return np.hstack([frames[:, :3, 3], hemisphere(q)])


def hemisphere(quaternions: Numbers) -> Numbers:
    """Return the same rotations, each quaternion on the side of the one before."""
    if len(quaternions) < 2:
        return quaternions
    flips = np.sign(np.einsum("ij,ij->i", quaternions[1:], quaternions[:-1]))
    flips[flips == 0] = 1
    return np.asarray(quaternions * np.concatenate([[1.0], np.cumprod(flips)])[:, None])
