"""Moves that are straight in joint space: within the joints' limits wherever their ends are.

A hand that is turned in space on the way goes so: turned about one axis, the wrist may run into
its limits.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan_pybullet.arm.kinematics import ArmKinematics, TipPose
from skillplan_pybullet.arm.straight_motion import (
    PEAK_ACCELERATION,
    PEAK_SPEED,
    Profile,
    Setpoint,
)

Vector = NDArray[np.float64]

# Joints move no faster than this [rad/s], [rad/s2].
_SPEED_RAD_PER_S = 1.2
_ACCELERATION_RAD_PER_S2 = 5.0
# The way of the tip is looked at in so many pieces.
_PIECES = 16


@dataclass(frozen=True, slots=True)
class JointMotion:
    """A move that is straight in joint space.

    Parameters
    ----------
    kinematics
        The arm's.
    start, end
        Joint angles [rad], shape (joints,).
    profile
        How it goes on.
    """

    kinematics: ArmKinematics
    start: Vector
    end: Vector
    profile: Profile

    @classmethod
    def between(
        cls,
        kinematics: ArmKinematics,
        start: Vector,
        end: Vector,
        *,
        speed_m_per_s: float,
        acceleration_m_per_s2: float,
    ) -> JointMotion:
        """Return the fastest move within limits of joints and tip.

        Parameters
        ----------
        kinematics, start, end
            See the class.
        speed_m_per_s, acceleration_m_per_s2
            Of the tip on average, as for a straight move [m/s], [m/s2], > 0.
        """
        path = np.array([pose.position for pose in tip_path(kinematics, start, end)])
        way_m = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
        turn_rad = float(np.abs(end - start).max())
        duration_s = max(
            PEAK_SPEED * way_m / speed_m_per_s,
            math.sqrt(PEAK_ACCELERATION * way_m / acceleration_m_per_s2),
            PEAK_SPEED * turn_rad / _SPEED_RAD_PER_S,
            math.sqrt(PEAK_ACCELERATION * turn_rad / _ACCELERATION_RAD_PER_S2),
            1e-3,
        )
        return cls(kinematics, start, end, Profile(duration_s))

    @property
    def duration_s(self) -> float:
        """How long it takes [s]."""
        return self.profile.duration_s

    def at(self, time_s: float) -> Setpoint:
        """Return the setpoint after some time; the end from the duration on."""
        share, rate, change = self.profile.at(time_s)
        path = self.end - self.start
        joints = self.start + share * path
        tip, jacobian = self.kinematics.tip_and_jacobian(joints)
        along = jacobian @ path
        return Setpoint(
            tip.position,
            tip.rotation,
            joints,
            rate * along[:3],
            rate * along[3:],
            change * along[:3],
            is_posture=True,
        )


def tip_path(kinematics: ArmKinematics, start: Vector, end: Vector) -> list[TipPose]:
    """Return where the tip is on the way between two postures, both included."""
    return [kinematics.tip(joints) for joints in postures_between(start, end)]


def postures_between(start: Vector, end: Vector) -> list[Vector]:
    """Return postures on the way between two that is straight in joint space, both included."""
    shares = np.linspace(0.0, 1.0, _PIECES + 1).tolist()
    return [start + share * (end - start) for share in shares]


def turned_on_the_way(kinematics: ArmKinematics, start: Vector, end: Vector) -> float:
    """Return by how much the hand turns about the vertical on the way between postures [rad].

    Counted beyond half a circle, as the wrist turns.
    """
    turned_rad = 0.0
    path = tip_path(kinematics, start, end)
    for before, after in itertools.pairwise(path):
        change = after.rotation @ before.rotation.T
        sine, cosine = change[1, 0] - change[0, 1], change[0, 0] + change[1, 1]
        turned_rad += math.atan2(float(sine), float(cosine))
    return turned_rad
