"""Torques of the joints: by operational space for the tip, or for every joint on its own.

The laws are those of the other engine (`operational_space` and `joint_tracking` there), written so
that every sum has a fixed order.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan_mujoco.simulator.fixed_order import product, times, times_transposed
from skillplan_pinocchio.kinematics.fixed_order import solved
from skillplan_simulation.arm.kinematics import TipPose
from skillplan_simulation.arm.rotations import rotation_left
from skillplan_simulation.arm.straight_motion import Setpoint
from skillplan_simulation.simulator import STEPS_PER_S

Vector = NDArray[np.float64]

# How firmly the arm is drawn to its posture [1/s2].
_NULLSPACE_STIFFNESS_PER_S2 = 400.0
# So much of what a joint lags behind is to be gone after one step, under control by position [-].
_SERVO_SHARE = 0.3


@dataclass(slots=True)
class ArmState:
    """What control has to know of the arm; written anew for every step.

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
        return times(state.mass, gain) + state.bias + times_transposed(state.jacobian, load)
    jacobian = state.jacobian
    # Each column how the joints are accelerated by a force or moment at the tip.
    yielding = solved(state.mass, jacobian.T)
    pull = _pull(state, wanted)
    # What of the pull would move the tip is taken from it.
    lacking = _acceleration(state, wanted, stiffness_per_s2) - times(jacobian, pull)
    wrench = solved(product(jacobian, yielding), lacking) + load
    return times_transposed(jacobian, wrench) + state.bias + times(state.mass, pull)


def posture_torques(state: ArmState, posture: Vector, load: Vector) -> Vector:
    """Return joint torques that follow a posture as servos do, one for every joint [N m].

    Each has its joint turn, after one step, as fast as takes away a share of what it lags behind.

    Parameters
    ----------
    state
        Of the arm.
    posture
        Where the joints are to be [rad], shape (joints,).
    load
        Force [N] and moment [N m] that the tip exerts besides, shape (6,).
    """
    speeds = _SERVO_SHARE * STEPS_PER_S * (posture - state.angles)
    gain = STEPS_PER_S * (speeds - state.rates)
    return times(state.mass, gain) + state.bias + times_transposed(state.jacobian, load)


def _acceleration(state: ArmState, wanted: Setpoint, stiffness_per_s2: float) -> Vector:
    """Return how the tip is to be accelerated, linear before angular, shape (6,)."""
    # Numbers are quicker here than arrays of three.
    away = (wanted.position - state.tip.position).tolist()
    away += rotation_left(state.tip.rotation, wanted.rotation)
    rates = [*wanted.velocity.tolist(), *wanted.spin_rad_per_s.tolist()]
    moves = times(state.jacobian, state.rates).tolist()
    damping_per_s = 2 * math.sqrt(stiffness_per_s2)
    found = [
        stiffness_per_s2 * lack + damping_per_s * (rate - move)
        for lack, rate, move in zip(away, rates, moves, strict=True)
    ]
    for axis, gain in enumerate(wanted.acceleration.tolist()):
        found[axis] += gain
    return np.array(found)


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
