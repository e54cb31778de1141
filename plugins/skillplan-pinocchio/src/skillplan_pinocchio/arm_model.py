"""A Panda with its hand for pinocchio, built from its description: no model file is read.

The tip is the lowest point of hand or tool; it is at one and the same distance from the frame
of the hand whatever is attached.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from skillplan.robots import panda
from skillplan.robots.arm_description import Transform
from skillplan.task.pose import Point, Pose, Quaternion
from skillplan_pinocchio.kinematics.numeric_inverse import NumericInverse
from skillplan_pinocchio.kinematics.serial_arm import SerialArm, build_model

Vector = NDArray[np.float64]

JOINTS: Final = 7


@dataclass(frozen=True, slots=True)
class Capsule:
    """A stand-in for a link: all points within a distance of a segment.

    Parameters
    ----------
    link
        Number of the joint that moves it, 1 to 7.
    start, end
        Ends of the segment in the joint's frame [m].
    radius_m
        Distance from the segment, > 0.
    """

    link: int
    start: Point
    end: Point
    radius_m: float


# Fitted about the collision meshes that the maker publishes, 1 mm larger. The base and the
# first link stand still or turn on the spot.
CAPSULES: Final = (
    Capsule(2, (0.0, 0.0, 0.053), (0.0, -0.144, 0.0), 0.078),
    Capsule(3, (0.0, 0.002, -0.083), (0.083, 0.043, 0.0), 0.071),
    Capsule(4, (0.0, 0.0, 0.042), (-0.083, 0.082, 0.0), 0.071),
    Capsule(5, (0.0, 0.010, -0.242), (0.0, 0.064, 0.002), 0.069),
    Capsule(6, (0.021, 0.010, 0.005), (0.088, 0.008, 0.0), 0.076),
    Capsule(7, (-0.005, -0.005, 0.074), (0.040, 0.035, 0.078), 0.051),
)


class ArmModel:
    """The arm: where the tip is, how it moves, and where the links are.

    Parameters
    ----------
    base
        Where the arm stands in the world [m]; it looks along x.

    Attributes
    ----------
    base
        As given.
    low_rad, high_rad
        Limits of the joints [rad], shape (7,).
    home_rad
        The description's posture [rad], shape (7,).
    """

    def __init__(self, base: Point = (0.0, 0.0, 0.0)) -> None:
        self.base = base
        self.low_rad: Vector = np.array(panda.PANDA.low_rad)
        self.high_rad: Vector = np.array(panda.PANDA.high_rad)
        self.home_rad: Vector = np.array(panda.PANDA.home_rad)
        self.model = build_model(panda.PANDA, Transform(base), panda.TIP_ON_FLANGE)
        self._data = self.model.createData()
        self._tip = self.model.getFrameId("tip")

    @cached_property
    def inverse(self) -> NumericInverse:
        """Joint angles for any pose of the tip."""
        return NumericInverse(SerialArm(panda.PANDA, Transform(self.base), panda.TIP_ON_FLANGE))

    def tip(self, joints_rad: Vector) -> tuple[Vector, Vector]:
        """Return position [m], shape (3,), and rotation, shape (3, 3), of the tip.

        The tip's z points out of the hand, its y along the closing axis of the jaws.
        """
        pin.framesForwardKinematics(self.model, self._data, joints_rad)
        placement = self._data.oMf[self._tip]
        return placement.translation.copy(), placement.rotation.copy()

    def error(self, joints_rad: Vector, target: Any) -> tuple[Vector, Vector]:
        """Return how far the tip is from a pose, and the Jacobian, both in the tip's frame.

        Parameters
        ----------
        joints_rad
            Shape (7,).
        target
            From `pose_down`.

        Returns
        -------
        twist
            Displacement [m] and rotation vector [rad] that are left to go, shape (6,).
        jacobian
            Shape (6, 7).
        """
        pin.computeJointJacobians(self.model, self._data, joints_rad)
        pin.updateFramePlacement(self.model, self._data, self._tip)
        jacobian = pin.getFrameJacobian(self.model, self._data, self._tip, pin.LOCAL)
        left = pin.log6(self._data.oMf[self._tip].actInv(target))
        return left.vector, jacobian

    def segments(self, joints_rad: Vector) -> list[tuple[Vector, Vector]]:
        """Return the ends of the segments of `CAPSULES` in the world [m], each of shape (3,)."""
        pin.forwardKinematics(self.model, self._data, joints_rad)
        found = []
        for capsule in CAPSULES:
            placement = self._data.oMi[capsule.link]
            found.append(
                (
                    placement.act(np.array(capsule.start)),
                    placement.act(np.array(capsule.end)),
                )
            )
        return found


def pose_down(position: Point, closing_yaw_rad: float) -> Any:
    """Return the pose of a tip that points straight down.

    Parameters
    ----------
    position
        Where it is in the world [m].
    closing_yaw_rad
        Direction in which the jaws close, from x about the vertical [rad].
    """
    cos, sin = math.cos(closing_yaw_rad), math.sin(closing_yaw_rad)
    rotation = np.array([[-sin, cos, 0.0], [cos, sin, 0.0], [0.0, 0.0, -1.0]])
    return pin.SE3(rotation, np.array(position, dtype=float))


def hand_pose(position: Point, orientation: Quaternion) -> Any:
    """Return the pose of a tip, as `pinocchio.SE3`.

    Parameters
    ----------
    position
        Where it is in the world [m].
    orientation
        How the hand is turned: z points out of it, y along the closing axis.
    """
    return pin.SE3(np.array(Pose(position, orientation).rotation), np.array(position, dtype=float))


def closing_yaw_rad(rotation: Vector) -> float:
    """Return the direction in which jaws close, from x about the vertical [rad]."""
    return math.atan2(rotation[1, 1], rotation[0, 1])
