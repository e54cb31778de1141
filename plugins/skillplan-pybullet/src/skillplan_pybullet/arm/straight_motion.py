"""Straight moves of the tip with bounded speed and acceleration, at rest at both ends."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan_pybullet.arm.rotations import of_vector

Vector = NDArray[np.float64]

# Of the profile of least jerk: its highest speed and acceleration, by mean speed and duration.
PEAK_SPEED = 1.875
PEAK_ACCELERATION = 10 / math.sqrt(3)


@dataclass(frozen=True, slots=True)
class Setpoint:
    """Where the tip is to be, how fast, and how the hand is to be turned.

    Parameters
    ----------
    position, velocity, acceleration
        [m], [m/s], [m/s2], shape (3,).
    rotation
        How the hand is turned, shape (3, 3).
    spin_rad_per_s
        How fast it turns about the world's axes, shape (3,).
    posture
        Joint angles that the arm is drawn to as far as the tip is not moved by it, shape
        (joints,) [rad].
    is_posture
        Whether the pose is that of the posture.
    """

    position: Vector
    rotation: Vector
    posture: Vector
    velocity: Vector
    spin_rad_per_s: Vector
    acceleration: Vector
    is_posture: bool = False

    @classmethod
    def at_rest(cls, position: Vector, rotation: Vector, posture: Vector) -> Setpoint:
        """Return a setpoint that does not move."""
        return cls(position, rotation, posture, np.zeros(3), np.zeros(3), np.zeros(3))


@dataclass(frozen=True, slots=True)
class Profile:
    """The profile of least jerk: the share of a move that is done, its rate and its change.

    Parameters
    ----------
    duration_s
        How long the move takes [s], > 0.
    """

    duration_s: float

    def at(self, time_s: float) -> tuple[float, float, float]:
        """Return share [-], rate [1/s] and change of the rate [1/s2] after some time."""
        fraction = min(max(time_s / self.duration_s, 0.0), 1.0)
        share = fraction**3 * (10 - 15 * fraction + 6 * fraction**2)
        rate = 30 * fraction**2 * (1 - fraction) ** 2 / self.duration_s
        change = 60 * fraction * (1 - fraction) * (1 - 2 * fraction) / self.duration_s**2
        return share, rate, change


@dataclass(frozen=True, slots=True)
class StraightMotion:
    """A straight move of the tip, turned about one axis meanwhile.

    Parameters
    ----------
    start
        Where it begins.
    end
        Position [m], shape (3,).
    turn_rad
        By how much the hand is turned, as a rotation vector of any length [rad], shape (3,).
    posture
        Of the arm in the end [rad].
    profile
        How it goes on.
    """

    start: Setpoint
    end: Vector
    turn_rad: Vector
    posture: Vector
    profile: Profile

    @classmethod
    def between(
        cls,
        start: Setpoint,
        end: Vector,
        turn_rad: Vector,
        posture: Vector,
        *,
        speed_m_per_s: float,
        acceleration_m_per_s2: float,
        speed_rad_per_s: float = 1.0,
    ) -> StraightMotion:
        """Return the fastest move within limits of speed and acceleration.

        Parameters
        ----------
        start, end, turn_rad, posture
            See the class.
        speed_m_per_s, acceleration_m_per_s2
            Limits of the tip [m/s], [m/s2], > 0.
        speed_rad_per_s
            Limit of the hand's turning [rad/s], > 0.
        """
        distance_m = float(np.linalg.norm(end - start.position))
        duration_s = max(
            PEAK_SPEED * distance_m / speed_m_per_s,
            math.sqrt(PEAK_ACCELERATION * distance_m / acceleration_m_per_s2),
            PEAK_SPEED * float(np.linalg.norm(turn_rad)) / speed_rad_per_s,
            1e-3,
        )
        return cls(start, end, turn_rad, posture, Profile(duration_s))

    @property
    def duration_s(self) -> float:
        """How long it takes [s]."""
        return self.profile.duration_s

    def at(self, time_s: float) -> Setpoint:
        """Return the setpoint after some time; the end from the duration on."""
        share, rate, change = self.profile.at(time_s)
        start = self.start
        path = self.end - start.position
        turned = start.rotation
        if self.turn_rad.any():
            turned = of_vector(share * self.turn_rad) @ turned
        return Setpoint(
            start.position + share * path,
            turned,
            start.posture + share * (self.posture - start.posture),
            rate * path,
            rate * self.turn_rad,
            change * path,
        )
