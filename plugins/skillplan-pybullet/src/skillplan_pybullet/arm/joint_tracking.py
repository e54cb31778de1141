"""Computed torques: what makes every joint follow angles that are given with their rates.

Unlike operational-space control it leaves no joint free, so that all of the arm is where the path
has it. Used where nothing is to be touched.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from skillplan_pybullet.arm.dynamics import Terms
from skillplan_simulation.arm.straight_motion import JointRates

Vector = NDArray[np.float64]


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
