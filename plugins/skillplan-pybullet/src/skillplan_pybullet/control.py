"""Control of the arm in pybullet: dynamics, joint tracking and operational-space torques.

Dynamics come from the simulator or from pinocchio, with the same robot description; a test compares
the two.
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
from skillplan_simulation.kinematics import TipPose, compute_rotation_error, resolve_acceleration
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
        Jacobian of the tip, linear above angular velocity, shape (6, joints).
    bias
        Torques of gravity, centrifugal and Coriolis forces [N m], shape (joints,).
    """

    mass: Vector
    jacobian: Vector
    bias: Vector


class Dynamics(Protocol):
    """Computes the terms."""

    def terms(self, angles: Vector, rates: Vector) -> Terms:
        """Return the terms at joint angles and rates, shape (joints + 2,), jaws included."""


class PybulletDynamics:
    """Dynamics by the simulator.

    Parameters
    ----------
    client, robot
        Physics client, and number of the arm there.
    file
        Description from which the arm was loaded.
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
        # pybullet ignores the orientation of the base.
        jacobian = _transform_to_world(self._turned, np.concatenate([linear, angular])[:, :arm])
        return Terms(np.array(mass)[:arm, :arm], jacobian, np.array(bias)[:arm])


class PinocchioDynamics:
    """Dynamics by pinocchio, from the same description.

    Parameters
    ----------
    file
        Description from which the arm was loaded.
    """

    def __init__(self, file: RobotFile, mount: Pose) -> None:
        self._model = pinocchio.buildModelFromXML(file.dynamics)
        # The base of the description is at the world's origin.
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
        return Terms(
            mass[:arm, :arm], _transform_to_world(self._turned, jacobian[:, :arm]), bias[:arm]
        )


def _transform_to_world(turned: Vector, jacobian: Vector) -> Vector:
    """Transform a Jacobian from the frame of the base to the world."""
    return np.concatenate([turned @ jacobian[:3], turned @ jacobian[3:]])


def compute_tracking_torques(
    terms: Terms,
    angles: Vector,
    rates: Vector,
    target_rad: Vector,
    target_rates: JointRates,
    *,
    stiffness_per_s2: float,
    load: Vector,
    limit_nm: Vector,
) -> Vector:
    """Return joint torques that follow given angles and rates [N m], clipped to the limits.

    Parameters
    ----------
    angles, rates
        Joint angles [rad] and rates [rad/s], shape (joints,).
    target_rad
        Target joint angles, shape (joints,).
    stiffness_per_s2
        Stiffness per unit of inertia; damping is critical.
    load
        Additional force [N] and moment [N m] that the tip exerts, shape (6,).
    limit_nm
        Torque limits [N m], shape (joints,).
    """
    gain = (
        target_rates.accelerations_rad_per_s2
        + stiffness_per_s2 * (target_rad - angles)
        + 2 * math.sqrt(stiffness_per_s2) * (target_rates.speeds_rad_per_s - rates)
    )
    torques_nm = terms.mass @ gain + terms.bias + terms.jacobian.T @ load
    return np.clip(torques_nm, -limit_nm, limit_nm)


# Stiffness of the null-space motion towards the posture [1/s2].
_NULLSPACE_STIFFNESS_PER_S2 = 400.0


def compute_torques(
    terms: Terms,
    angles: Vector,
    rates: Vector,
    pose: TipPose,
    setpoint: Setpoint,
    *,
    stiffness_per_s2: float,
    force_n: Vector,
    moment_nm: Vector,
    limit_nm: Vector,
) -> Vector:
    """Return operational-space torques [N m], shape (joints,), clipped to the limits.

    They move the tip as if it were a mass on a spring.

    Parameters
    ----------
    angles, rates
        Joint angles [rad] and rates [rad/s], shape (joints,).
    setpoint
        Target pose, velocity and acceleration of the tip, and the posture that attracts the arm.
    stiffness_per_s2
        Stiffness per unit of mass; damping is critical.
    force_n
        Additional force that the tip exerts [N], shape (3,).
    moment_nm
        Additional moment about the tip [N m], shape (3,).
    limit_nm
        Torque limits [N m], shape (joints,).
    """
    damping = 2 * math.sqrt(stiffness_per_s2)
    jacobian = terms.jacobian
    velocity = jacobian @ rates
    target_velocity = np.concatenate([setpoint.velocity, setpoint.spin_rad_per_s])
    error = np.concatenate(
        [
            setpoint.position - pose.position,
            compute_rotation_error(pose.rotation, setpoint.rotation),
        ]
    )
    acceleration = stiffness_per_s2 * error + damping * (target_velocity - velocity)
    acceleration[:3] += setpoint.acceleration
    if len(angles) < len(acceleration):
        gain = resolve_acceleration(jacobian, acceleration)
        load = np.concatenate([force_n, moment_nm])
        torques: Vector = terms.mass @ gain + terms.bias + jacobian.T @ load
        return np.clip(torques, -limit_nm, limit_nm)
    mass_inverse = np.linalg.inv(terms.mass)
    inertia = np.linalg.inv(jacobian @ mass_inverse @ jacobian.T)
    wrench = inertia @ acceleration
    wrench[:3] += force_n
    wrench[3:] += moment_nm
    away, lag = setpoint.posture - angles, -rates
    if setpoint.joints is not None:
        lag = setpoint.joints.speeds_rad_per_s - rates
    firmness = _NULLSPACE_STIFFNESS_PER_S2
    pull = firmness * away + 2 * math.sqrt(firmness) * lag
    if setpoint.joints is not None:
        pull = pull + setpoint.joints.accelerations_rad_per_s2
    consistent = mass_inverse @ jacobian.T @ inertia
    posture = terms.mass @ pull
    torques_nm = jacobian.T @ wrench + terms.bias + posture - jacobian.T @ (consistent.T @ posture)
    return np.clip(torques_nm, -limit_nm, limit_nm)
