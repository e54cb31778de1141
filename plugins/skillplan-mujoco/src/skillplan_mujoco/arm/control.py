"""Torques of the joints: by operational space for the tip, or for every joint on its own.

The laws are those of the other engine (`operational_space` and `joint_tracking` there), written so
that every sum has a fixed order.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan_mujoco.simulator.fixed_order import Factor, times
from skillplan_pinocchio.simulation.arm.kinematics import TipPose
from skillplan_pinocchio.simulation.arm.rotations import rotation_error
from skillplan_pinocchio.simulation.arm.straight_motion import Setpoint

Vector = NDArray[np.float64]

# How firmly the arm is drawn to its posture [1/s2].
_NULLSPACE_STIFFNESS_PER_S2 = 400.0


@dataclass(frozen=True, slots=True)
class ArmState:
    """What control has to know of the arm.

    Parameters
    ----------
    angles, rates
        Joint angles [rad] and rates [rad/s], shape (joints,).
    tip
        Where the tip is.
    mass
        Mass matrix [kg m2], shape (joints, joints).
    jacobian
        Of the tip, linear above angular velocity, shape (6, joints).
    bias
        Torques of gravity, centrifugal and Coriolis forces [N m], shape (joints,).
    """

    angles: Vector
    rates: Vector
    tip: TipPose
    mass: Vector
    jacobian: Vector
    bias: Vector


def torques(state: ArmState, wanted: Setpoint, stiffness_per_s2: float, load: Vector) -> Vector:
    """Return joint torques [N m], shape (joints,).

    Parameters
    ----------
    state
        Of the arm.
    wanted
        Where the tip is to be, or every joint.
    stiffness_per_s2
        Stiffness by unit of inertia; damping is critical.
    load
        Force [N] and moment [N m] that the tip exerts besides, shape (6,).
    """
    if wanted.tracks_joints and wanted.joints is not None:
        gain = (
            wanted.joints.accelerations_rad_per_s2
            + stiffness_per_s2 * (wanted.posture - state.angles)
            + 2 * math.sqrt(stiffness_per_s2) * (wanted.joints.speeds_rad_per_s - state.rates)
        )
        return times(state.mass, gain) + state.bias + times(state.jacobian.T, load)
    jacobian = state.jacobian
    mass = Factor(state.mass)
    mobility = Factor(np.array([times(jacobian, mass.solve(row)) for row in jacobian]))
    wrench = mobility.solve(_acceleration(state, wanted, stiffness_per_s2)) + load
    pull = _pull(state, wanted)
    # What of the pull would move the tip is taken from it.
    wrench -= mobility.solve(times(jacobian, pull))
    return times(jacobian.T, wrench) + state.bias + times(state.mass, pull)


def _acceleration(state: ArmState, wanted: Setpoint, stiffness_per_s2: float) -> Vector:
    """Return how the tip is to be accelerated, linear before angular, shape (6,)."""
    error = np.concatenate(
        [
            wanted.position - state.tip.position,
            rotation_error(state.tip.rotation, wanted.rotation),
        ]
    )
    velocity = np.concatenate([wanted.velocity, wanted.spin_rad_per_s])
    lag = velocity - times(state.jacobian, state.rates)
    found: Vector = stiffness_per_s2 * error + 2 * math.sqrt(stiffness_per_s2) * lag
    found[:3] += wanted.acceleration
    return found


def _pull(state: ArmState, wanted: Setpoint) -> Vector:
    """Return the accelerations that draw the joints to their posture, shape (joints,)."""
    firmness = _NULLSPACE_STIFFNESS_PER_S2
    away, lag = wanted.posture - state.angles, -state.rates
    if wanted.joints is not None:
        lag = wanted.joints.speeds_rad_per_s - state.rates
    pull: Vector = firmness * away + 2 * math.sqrt(firmness) * lag
    if wanted.joints is not None:
        pull = pull + wanted.joints.accelerations_rad_per_s2
    return pull
