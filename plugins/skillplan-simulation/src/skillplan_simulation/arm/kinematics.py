"""Where the tip of a robot's hand is, by pinocchio's kinematics: what control needs of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import pinocchio
from numpy.typing import NDArray

from skillplan.robots.arm_description import ArmDescription, Transform
from skillplan.task.motion import Point
from skillplan.task.scene import Robot
from skillplan_pinocchio.kinematics.numeric_inverse import NumericInverse
from skillplan_pinocchio.kinematics.serial_arm import SerialArm
from skillplan_simulation.arm.rotations import points_down, rpy_of

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class TipPose:
    """Where the tip of the hand is: its position [m], and the hand's axes as columns."""

    position: Vector
    rotation: Vector


class UnreachableError(Exception):
    """Raised, in words, where no joint angles bring the tip to a pose."""


class ArmKinematics:
    """Kinematics of an arm as it is mounted, with its hand.

    Parameters
    ----------
    description
        The robot.
    base
        Where it stands in the world.
    tool
        Where the tip is, seen from the flange.
    """

    def __init__(self, description: ArmDescription, base: Transform, tool: Transform) -> None:
        self.arm = SerialArm(description, base, tool)
        self.home_rad: Vector = self.arm.home_rad
        self.low_rad, self.high_rad = self.arm.low_rad, self.arm.high_rad
        self._numeric = NumericInverse(self.arm)
        self._tip = self.arm.model.getFrameId("tip")
        self._data = self.arm.model.createData()

    def tip(self, joints_rad: Vector) -> TipPose:
        """Return where the tip is.

        Parameters
        ----------
        joints_rad
            Shape (joints,).
        """
        found = self.arm.tip(joints_rad)
        return TipPose(found.translation.copy(), found.rotation.copy())

    def frames(self, joints_rad: Vector) -> list[Any]:
        """Return where the joints are, from the first, and the tip at last, as `pinocchio.SE3`."""
        model, data = self.arm.model, self._data
        pinocchio.framesForwardKinematics(model, data, joints_rad)
        joints = [data.oMi[index].copy() for index in range(1, model.njoints)]
        return [*joints, data.oMf[self._tip].copy()]

    def follow(self, position: Point, rotation: Vector, joints_rad: Vector) -> Vector | None:
        """Return joint angles near given ones that bring the tip to a pose close by, or None."""
        return self._numeric.solve_from(joints_rad, _se3(position, rotation))


@lru_cache(maxsize=16)
def _made(description: ArmDescription, base: Transform, tool: Transform) -> ArmKinematics:
    return ArmKinematics(description, base, tool)


def kinematics_of(robot: Robot) -> ArmKinematics:
    """Return the kinematics of a robot of a task."""
    base = Transform(robot.base, rpy_of(np.array(robot.mount.rotation)))
    return _made(robot.model, base, robot.tip)


def unreachable(position: Point, rotation: Vector) -> UnreachableError:
    """Return that a pose is out of reach, in words."""
    x, y, z = position
    along = ", ".join(f"{value + 0.0:.2f}" for value in rotation[:, 2].round(2))
    points = "pointing straight down" if points_down(rotation) else f"pointing along ({along})"
    return UnreachableError(
        f"no posture of the arm within its joint limits brings the hand, {points}, "
        f"to ({x:.3f}, {y:.3f}, {z:.3f}) m"
    )


def _se3(position: Point, rotation: Vector) -> Any:
    return pinocchio.SE3(rotation, np.array(position, dtype=float))
