"""What operational-space control has to know of the arm: mass matrix, Jacobian, bias forces.

The simulator works them out itself, or pinocchio does, from the same description of the robot; the
two agree to the last digits, which a test says.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import pinocchio
import pybullet
from numpy.typing import NDArray

from skillplan.task.pose import Pose
from skillplan_pybullet.arm.robot_file import TIP_LINK, RobotFile

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Terms:
    """Dynamics of the arm in one configuration.

    Parameters
    ----------
    mass
        Mass matrix [kg m2], shape (joints, joints).
    jacobian
        Of the tip, linear above angular velocity, shape (6, joints).
    bias
        Torques of gravity, centrifugal and Coriolis forces [N m], shape (joints,).
    """

    mass: Vector
    jacobian: Vector
    bias: Vector


class Dynamics(Protocol):
    """Works out the terms."""

    def terms(self, angles: Vector, rates: Vector) -> Terms:
        """Return the terms at joint angles and rates, shape (joints + 2,): jaws count."""


class PybulletDynamics:
    """Terms by the simulator.

    Parameters
    ----------
    client, robot
        Where the arm is, and its number there.
    file
        What it was loaded from.
    mount
        Where its base is, and how it is turned.
    """

    def __init__(self, client: int, robot: int, file: RobotFile, mount: Pose) -> None:
        self._client, self._robot = client, robot
        self._hand, self._joints = file.hand, len(file.joints)
        self._turned = np.array(mount.rotation)
        self._still = [0.0] * (self._joints + len(file.jaws))

    def terms(self, angles: Vector, rates: Vector) -> Terms:
        """Return the terms; see :class:`Dynamics`."""
        joints, speeds, still, arm = angles.tolist(), rates.tolist(), self._still, self._joints
        mass = pybullet.calculateMassMatrix(self._robot, joints, physicsClientId=self._client)
        linear, angular = pybullet.calculateJacobian(
            self._robot,
            self._hand,
            (0.0, 0.0, 0.0),
            joints,
            still,
            still,
            physicsClientId=self._client,
        )
        bias = pybullet.calculateInverseDynamics(
            self._robot, joints, speeds, still, physicsClientId=self._client
        )
        # The simulator leaves out how the base is turned.
        jacobian = _in_world(self._turned, np.concatenate([linear, angular])[:, :arm])
        return Terms(np.array(mass)[:arm, :arm], jacobian, np.array(bias)[:arm])


class PinocchioDynamics:
    """Terms by pinocchio, from the same description.

    Parameters
    ----------
    file
        What the arm was loaded from.
    mount
        Where its base is, and how it is turned.
    """

    def __init__(self, file: RobotFile, mount: Pose) -> None:
        self._model = pinocchio.buildModelFromXML(file.dynamics)
        # The description is of an arm whose base is the world's origin.
        self._turned = np.array(mount.rotation)
        upwards = pinocchio.Motion.Zero()
        upwards.linear = self._turned.T @ self._model.gravity.linear
        self._model.gravity = upwards
        self._data = self._model.createData()
        self._hand = self._model.getFrameId(TIP_LINK)
        self._joints = len(file.joints)

    def terms(self, angles: Vector, rates: Vector) -> Terms:
        """Return the terms; see :class:`Dynamics`."""
        model, data, arm = self._model, self._data, self._joints
        mass = np.array(pinocchio.crba(model, data, angles))
        mass = np.triu(mass) + np.triu(mass, 1).T
        bias = np.array(pinocchio.nonLinearEffects(model, data, angles, rates))
        aligned = pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
        pinocchio.computeJointJacobians(model, data, angles)
        pinocchio.updateFramePlacements(model, data)
        jacobian = np.array(pinocchio.getFrameJacobian(model, data, self._hand, aligned))
        return Terms(mass[:arm, :arm], _in_world(self._turned, jacobian[:, :arm]), bias[:arm])


def _in_world(turned: Vector, jacobian: Vector) -> Vector:
    """Return a Jacobian of the base's frame in the world that the base is turned in."""
    return np.concatenate([turned @ jacobian[:3], turned @ jacobian[3:]])
