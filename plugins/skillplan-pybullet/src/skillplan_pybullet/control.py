"""What operational-space control has to know of the arm: mass matrix, Jacobian, bias forces.

The simulator works them out itself, or pinocchio does, from the same description of the robot; the
two agree to the last digits, which a test says.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import pinocchio
import pybullet
from numpy.typing import NDArray

from skillplan.task.pose import Pose
from skillplan_pybullet.robot_file import TIP_LINK, RobotFile
from skillplan_simulation.kinematics import TipPose, rotation_error
from skillplan_simulation.motions import JointRates, Setpoint

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


def tracking_torques(
    terms: Terms,
    angles: Vector,
    rates: Vector,
    wanted_rad: Vector,
    wanted: JointRates,
    *,
    stiffness_per_s2: float,
    load: Vector,
    limit_nm: Vector,
) -> Vector:
    """Return joint torques [N m], shape (joints,), within the joints' limits.

    Parameters
    ----------
    terms
        The arm's dynamics.
    angles, rates
        Joint angles [rad] and rates [rad/s], shape (joints,).
    wanted_rad
        Where the joints are to be, shape (joints,).
    wanted
        How fast.
    stiffness_per_s2
        Stiffness by unit of inertia; damping is critical.
    load
        Force [N] and moment [N m] that the tip exerts besides, shape (6,).
    limit_nm
        Greatest torques of the joints [N m], shape (joints,).
    """
    gain = (
        wanted.accelerations_rad_per_s2
        + stiffness_per_s2 * (wanted_rad - angles)
        + 2 * math.sqrt(stiffness_per_s2) * (wanted.speeds_rad_per_s - rates)
    )
    found = terms.mass @ gain + terms.bias + terms.jacobian.T @ load
    return np.clip(found, -limit_nm, limit_nm)


# How firmly the arm is drawn to its posture [1/s2].
_NULLSPACE_STIFFNESS_PER_S2 = 400.0


def torques(
    terms: Terms,
    angles: Vector,
    rates: Vector,
    pose: TipPose,
    wanted: Setpoint,
    *,
    stiffness_per_s2: float,
    force_n: Vector,
    moment_nm: Vector,
    limit_nm: Vector,
) -> Vector:
    """Return joint torques [N m], shape (joints,), within the joints' limits.

    Parameters
    ----------
    terms
        The arm's dynamics.
    angles, rates
        Joint angles [rad] and rates [rad/s], shape (joints,).
    pose
        Where the tip is.
    wanted
        Where it is to be, how it is to be turned, and how fast; and to which posture the arm is
        drawn.
    stiffness_per_s2
        Stiffness by unit of mass; damping is critical.
    force_n
        Force that the tip exerts besides [N], shape (3,).
    moment_nm
        Moment about the tip likewise [N m], shape (3,).
    limit_nm
        Greatest torques of the joints [N m], shape (joints,).
    """
    damping = 2 * math.sqrt(stiffness_per_s2)
    jacobian = terms.jacobian
    velocity = jacobian @ rates
    wanted_velocity = np.concatenate([wanted.velocity, wanted.spin_rad_per_s])
    error = np.concatenate(
        [wanted.position - pose.position, rotation_error(pose.rotation, wanted.rotation)]
    )
    acceleration = stiffness_per_s2 * error + damping * (wanted_velocity - velocity)
    acceleration[:3] += wanted.acceleration
    mass_inverse = np.linalg.inv(terms.mass)
    inertia = np.linalg.inv(jacobian @ mass_inverse @ jacobian.T)
    wrench = inertia @ acceleration
    wrench[:3] += force_n
    wrench[3:] += moment_nm
    away, lag = wanted.posture - angles, -rates
    if wanted.joints is not None:
        lag = wanted.joints.speeds_rad_per_s - rates
    firmness = _NULLSPACE_STIFFNESS_PER_S2
    pull = firmness * away + 2 * math.sqrt(firmness) * lag
    if wanted.joints is not None:
        pull = pull + wanted.joints.accelerations_rad_per_s2
    consistent = mass_inverse @ jacobian.T @ inertia
    posture = terms.mass @ pull
    found = jacobian.T @ wrench + terms.bias + posture - jacobian.T @ (consistent.T @ posture)
    return np.clip(found, -limit_nm, limit_nm)
