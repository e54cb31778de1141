"""What operational-space control has to know of the arm: mass matrix, Jacobian, bias forces.

The simulator works them out itself, or pinocchio does, from the same description of the robot; the
two agree to the last digits, which a test says.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
import pinocchio
import pybullet
import pybullet_data
from numpy.typing import NDArray

from skillplan.robots import panda

Vector = NDArray[np.float64]

URDF = Path(pybullet_data.__file__).parent / "franka_panda" / "panda.urdf"
ARM_JOINTS = tuple(range(7))
HAND_LINK = 8
FINGER_LINKS = (9, 10)


@dataclass(frozen=True, slots=True)
class Terms:
    """Dynamics of the arm in one configuration.

    Parameters
    ----------
    mass
        Mass matrix [kg m2], shape (7, 7).
    jacobian
        Of the tip, linear above angular velocity, shape (6, 7).
    bias
        Torques of gravity, centrifugal and Coriolis forces [N m], shape (7,).
    """

    mass: Vector
    jacobian: Vector
    bias: Vector


class Dynamics(Protocol):
    """Works out the terms."""

    def terms(self, angles: Vector, rates: Vector) -> Terms:
        """Return the terms at joint angles and rates, the fingers' included, shape (9,) each."""


class PybulletDynamics:
    """Terms by the simulator."""

    def __init__(self, client: int, robot: int) -> None:
        self._client, self._robot = client, robot

    def terms(self, angles: Vector, rates: Vector) -> Terms:
        """Return the terms; see :class:`Dynamics`."""
        joints, speeds, still = angles.tolist(), rates.tolist(), [0.0] * 9
        mass = pybullet.calculateMassMatrix(self._robot, joints, physicsClientId=self._client)
        linear, angular = pybullet.calculateJacobian(
            self._robot,
            HAND_LINK,
            (0.0, 0.0, panda.TIP_M),
            joints,
            still,
            still,
            physicsClientId=self._client,
        )
        bias = pybullet.calculateInverseDynamics(
            self._robot, joints, speeds, still, physicsClientId=self._client
        )
        jacobian = np.concatenate([np.array(linear)[:, :7], np.array(angular)[:, :7]])
        return Terms(np.array(mass)[:7, :7], jacobian, np.array(bias)[:7])


class PinocchioDynamics:
    """Terms by pinocchio."""

    def __init__(self) -> None:
        self._model = pinocchio.buildModelFromUrdf(str(URDF))
        self._data = self._model.createData()
        self._hand = self._model.getFrameId("panda_hand")

    def terms(self, angles: Vector, rates: Vector) -> Terms:
        """Return the terms; see :class:`Dynamics`."""
        pin, model, data = pinocchio, self._model, self._data
        mass = np.array(pin.crba(model, data, angles))
        mass = np.triu(mass) + np.triu(mass, 1).T
        bias = np.array(pin.nonLinearEffects(model, data, angles, rates))
        aligned = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        pin.computeJointJacobians(model, data, angles)
        pin.updateFramePlacements(model, data)
        at_hand = np.array(pin.getFrameJacobian(model, data, self._hand, aligned))[:, :7]
        lever = panda.TIP_M * np.array(data.oMf[self._hand].rotation)[:, 2]
        at_hand[:3] += np.cross(at_hand[3:].T, lever).T
        return Terms(mass[:7, :7], at_hand, bias[:7])
