"""An arm with its hand for pinocchio, built from its description: no model file is read.

The tip is the lowest point of hand or tool; it is at one and the same distance from the frame
of the hand whatever is attached.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from skillplan.robots.arm_description import ArmDescription, Hand
from skillplan.robots.catalogue import DEFAULT_HAND, DEFAULT_MODEL
from skillplan.task.pose import Point, Pose, Quaternion
from skillplan.task.scene import Robot
from skillplan_pinocchio.kinematics.numeric_inverse import NumericInverse
from skillplan_pinocchio.kinematics.serial_arm import SerialArm
from skillplan_pinocchio.kinematics.ur_inverse import UrInverse, UrLengths
from skillplan_pinocchio.link_pieces import link_pieces

Vector = NDArray[np.float64]


class ArmModel:
    """The arm: where the tip is, how it moves, and where the links are.

    Parameters
    ----------
    base
        Where the arm stands in the world [m].
    description
        The robot.
    orientation
        How its base is turned.
    hand
        What is on its flange.

    Attributes
    ----------
    description
        As given.
    mount
        Where its base is, and how it is turned.
    low_rad, high_rad
        Limits of the joints [rad], shape (joints,).
    home_rad
        The description's posture [rad], shape (joints,).
    pieces
        The shapes about its links.
    """

    def __init__(
        self,
        base: Point = (0.0, 0.0, 0.0),
        description: ArmDescription = DEFAULT_MODEL,
        orientation: Quaternion = (0.0, 0.0, 0.0, 1.0),
        hand: Hand = DEFAULT_HAND,
    ) -> None:
        self.description = description
        self.mount = Pose(base, orientation)
        self.hand = hand
        turned = pin.SE3(np.array(self.mount.rotation), np.array(base, dtype=float))
        self.serial = SerialArm(description, turned, hand.tip_on_flange)
        self.low_rad = self.serial.low_rad
        self.high_rad = self.serial.high_rad
        self.home_rad = self.serial.home_rad
        self.model = self.serial.model
        self.pieces = link_pieces(description)
        self._data = self.model.createData()

    @classmethod
    def of(cls, robot: Robot) -> ArmModel:
        """Return the arm of a scene's robot."""
        return cls(robot.base, robot.model, robot.base_orientation, robot.hand)

    @cached_property
    def inverse(self) -> NumericInverse:
        """Joint angles for any pose of the tip."""
        return NumericInverse(self.serial)

    @cached_property
    def closed_form(self) -> UrInverse | None:
        """All joint angles for any pose of the tip, where there is a formula."""
        return None if UrLengths.of(self.description) is None else UrInverse(self.serial)

    @cached_property
    def shoulder(self) -> Vector:
        """Where the second joint is at home [m], shape (3,)."""
        pin.forwardKinematics(self.model, self._data, self.home_rad)
        return np.asarray(self._data.oMi[min(2, self.joints)].translation.copy())

    @property
    def joints(self) -> int:
        """How many joints it has."""
        return len(self.home_rad)

    def tip(self, joints_rad: Vector) -> tuple[Vector, Vector]:
        """Return position [m], shape (3,), and rotation, shape (3, 3), of the tip.

        The tip's z points out of the hand, its y along the closing axis of the jaws.
        """
        placement = self.serial.tip(joints_rad)
        return placement.translation.copy(), placement.rotation.copy()

    def error(self, joints_rad: Vector, target: Any) -> tuple[Vector, Vector]:
        """Return how far the tip is from a pose, and the Jacobian; see :meth:`SerialArm.error`."""
        return self.serial.error(joints_rad, target)

    @cached_property
    def boxes(self) -> tuple[NDArray[np.intp], Vector, Vector]:
        """Of every piece which joint moves it, from 0, and centre and half extents of its box [m].

        In the frame of the joint; shapes (pieces,), (pieces, 3) and (pieces, 3).
        """
        joints = np.array([piece.link - 1 for piece in self.pieces], dtype=np.intp)
        centres = np.array([piece.box[0] for piece in self.pieces]).reshape(-1, 3)
        return joints, centres, np.array([piece.box[1] for piece in self.pieces]).reshape(-1, 3)

    def frames(self, postures_rad: Sequence[Vector]) -> tuple[Vector, Vector]:
        """Return rotations and origins [m] of the joints' frames in some postures.

        Parameters
        ----------
        postures_rad
            Joint angles [rad], each of shape (joints,).

        Returns
        -------
        tuple
            Of shapes (postures, joints, 3, 3) and (postures, joints, 3).
        """
        placements = []
        for joints_rad in postures_rad:
            pin.forwardKinematics(self.model, self._data, joints_rad)
            placements.append([one.homogeneous for one in self._data.oMi[1:]])
        found = np.array(placements)
        return found[..., :3, :3], found[..., :3, 3]


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
