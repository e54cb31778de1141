"""Where the tip of a robot's hand is, and which joint angles bring it to a pose.

Forward and inverse kinematics of any arm that is described are pinocchio's; this is what control
and executions need of it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
import pinocchio
from numpy.typing import NDArray

from skillplan.robots.arm_description import ArmDescription, Transform
from skillplan.task.motion import Point
from skillplan.task.scene import Robot
from skillplan_pinocchio.kinematics.numeric_inverse import NumericInverse
from skillplan_pinocchio.kinematics.serial_arm import SerialArm
from skillplan_pinocchio.kinematics.ur_inverse import UrInverse, UrLengths
from skillplan_pybullet.arm.rotations import points_down, rpy_of

Vector = NDArray[np.float64]

# Two postures on one way of the tip differ by less in every joint [rad].
_SAME_BRANCH_RAD = 1.5
# Steps in which the tip is followed along a line [m].
_STRIDE_M = 0.05
# Turns of the wrist that starts of the search are given [rad].
_WRIST_TURNS_RAD = (0.0, math.pi / 2, -math.pi / 2, math.pi, -math.pi)


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
        is_ur = UrLengths.of(description) is not None
        self._closed = UrInverse(self.arm) if is_ur else None
        self._numeric = NumericInverse(self.arm)
        self._base = self.arm.base.translation
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

    def tip_and_jacobian(self, joints_rad: Vector) -> tuple[TipPose, Vector]:
        """Return the pose of the tip, and its Jacobian of shape (6, joints) in the world.

        Linear above angular velocity.
        """
        model, data = self.arm.model, self._data
        pinocchio.computeJointJacobians(model, data, joints_rad)
        here = pinocchio.updateFramePlacement(model, data, self._tip)
        jacobian = pinocchio.getFrameJacobian(
            model, data, self._tip, pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )
        return TipPose(here.translation.copy(), here.rotation.copy()), jacobian

    def frames(self, joints_rad: Vector) -> list[Any]:
        """Return where the joints are, from the first, and the tip at last, as `pinocchio.SE3`."""
        model, data = self.arm.model, self._data
        pinocchio.framesForwardKinematics(model, data, joints_rad)
        joints = [data.oMi[index].copy() for index in range(1, model.njoints)]
        return [*joints, data.oMf[self._tip].copy()]

    def reach(self, position: Point, rotation: Vector, near: Vector | None = None) -> Vector:
        """Return joint angles that bring the tip to a pose.

        Parameters
        ----------
        position
            Of the tip [m].
        rotation
            Of the hand, shape (3, 3).
        near
            A posture to stay near [rad]; the home posture by default.

        Returns
        -------
        numpy.ndarray
            Within the joints' limits [rad], shape (joints,).

        Raises
        ------
        UnreachableError
            If there are none.
        """
        for found in self.postures(position, rotation, near):
            return found
        raise unreachable(position, rotation)

    def follow(self, position: Point, rotation: Vector, joints_rad: Vector) -> Vector | None:
        """Return joint angles near given ones that bring the tip to a pose close by, or None."""
        return self._numeric.solve_from(joints_rad, _se3(position, rotation))

    def along(
        self, points: Sequence[Point], rotation: Vector, near: Vector | None = None
    ) -> list[Vector]:
        """Return postures at points between which the tip goes straight, the hand turned so.

        Raises
        ------
        UnreachableError
            If a point is out of reach, or not to be reached from the one before.
        """
        furthest = 0
        for first in self.postures(points[0], rotation, near):
            found = [first]
            for start, end in pairwise(points):
                joints = self._followed(start, end, rotation, found[-1])
                if joints is None:
                    break
                found.append(joints)
            else:
                return found
            furthest = max(furthest, len(found))
        raise unreachable(points[furthest], rotation)

    def postures(
        self, position: Point, rotation: Vector, near: Vector | None = None
    ) -> Iterator[Vector]:
        """Yield joint angles that bring the tip to a pose, the likeliest first."""
        home = self.home_rad if near is None else near
        target = _se3(position, rotation)
        if self._closed is not None:
            found = self._closed.solve(target)
            yield from sorted(found, key=lambda joints: float(np.abs(joints - home).max()))
            return
        yielded: list[Vector] = []
        for start in self._starts(position, home):
            joints = self._numeric.solve_from(start, target)
            if joints is not None and _is_new(joints, yielded):
                yielded.append(joints)
                yield joints
        if not yielded:
            last = self._numeric.solve(target)
            if isinstance(last, np.ndarray):
                yield last

    def _starts(self, position: Point, home: Vector) -> Iterator[Vector]:
        yield home
        bearing = math.atan2(position[1] - self._base[1], position[0] - self._base[0])
        for turn in _WRIST_TURNS_RAD:
            start = home.copy()
            start[0] = bearing
            start[-1] += turn
            yield np.clip(start, self.low_rad, self.high_rad)

    def _followed(
        self, start: Point, end: Point, rotation: Vector, joints_rad: Vector
    ) -> Vector | None:
        begin, path = np.array(start), np.array(end) - np.array(start)
        strides = max(1, math.ceil(float(np.linalg.norm(path)) / _STRIDE_M))
        now = joints_rad
        for stride in range(1, strides + 1):
            x, y, z = (begin + stride / strides * path).tolist()
            then = self.follow((x, y, z), rotation, now)
            if then is None or float(np.abs(then - now).max()) > _SAME_BRANCH_RAD:
                return None
            now = then
        return now


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


def _is_new(joints: Vector, others: Sequence[Vector]) -> bool:
    return all(float(np.abs(joints - other).max()) > 1e-3 for other in others)
