"""Operational-space control: torques that move the tip as if it were a mass on a spring.

Khatib (1987), in the form that Peters and Schaal (2008) give and Moller et al. use (section
4.4): forces at the tip are shaped by the arm's inertia as seen there, and what torque is left
draws the arm towards a posture without moving the tip.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from skillplan_pybullet.arm.dynamics import Terms
from skillplan_simulation.arm.kinematics import TipPose
from skillplan_simulation.arm.rotations import rotation_error
from skillplan_simulation.arm.straight_motion import Setpoint

Vector = NDArray[np.float64]

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
