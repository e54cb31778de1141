"""Where the joints of an arm are in many postures at once."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from skillplan_pinocchio.kinematics.fixed_order import times
from skillplan_pinocchio.planning.moving_solids import Vector


class ArmFrames:
    """The frames of an arm's joints, worked out for many postures at once.

    Parameters
    ----------
    model
        The arm's `pinocchio.Model`; all of its joints turn.

    Attributes
    ----------
    axes
        Of the joints, unit vectors in their own frames, shape (joints, 3).
    spans_m
        How far the origin of each joint's frame is from the axis of the joint before, and from the
        origin of the frame before [m].
    """

    def __init__(self, model: Any) -> None:
        data = model.createData()
        turned = []
        for angle_rad in (0.0, np.pi / 2, np.pi):
            pin.forwardKinematics(model, data, np.full(model.nv, angle_rad))
            turned.append(np.array([one.rotation for one in data.liMi][1:]))
        # A joint's rotation is still + sin q quarter + (1 - cos q) half, whatever its axis is.
        self._still, quarter, half = turned
        self._half = (half - self._still) / 2
        self._quarter = quarter - self._still - self._half
        cross = times(np.swapaxes(self._still, 1, 2), self._quarter)
        self.axes = np.stack([cross[:, 2, 1], cross[:, 0, 2], cross[:, 1, 0]], axis=1)
        self._offsets_m = np.array([one.translation for one in data.liMi][1:])
        # Before the first joint there is none.
        beside = np.cross(self._offsets_m, np.concatenate([np.zeros((1, 3)), self.axes[:-1]]))
        self.spans_m: list[tuple[float, float]] = [
            (float(one), float(other))
            for one, other in zip(
                np.linalg.norm(beside, axis=1), np.linalg.norm(self._offsets_m, axis=1), strict=True
            )
        ]

    def at(self, joints_rad: Vector) -> tuple[Vector, Vector]:
        """Return rotations and origins [m] of the base's and the joints' frames.

        Parameters
        ----------
        joints_rad
            Shape (postures, joints).

        Returns
        -------
        tuple
            Of shapes (postures, 1 + joints, 3, 3) and (postures, 1 + joints, 3).
        """
        sines = np.sin(joints_rad)[:, :, np.newaxis, np.newaxis]
        cosines = np.cos(joints_rad)[:, :, np.newaxis, np.newaxis]
        turns = self._still + sines * self._quarter + (1 - cosines) * self._half
        count, joints = joints_rad.shape
        rotations = np.empty((count, joints + 1, 3, 3))
        origins = np.empty((count, joints + 1, 3))
        rotations[:, 0], origins[:, 0] = np.eye(3), 0.0
        for joint in range(joints):
            rotations[:, joint + 1] = times(rotations[:, joint], turns[:, joint])
            moved = times(rotations[:, joint], self._offsets_m[joint])
            origins[:, joint + 1] = origins[:, joint] + moved
        return rotations, origins
