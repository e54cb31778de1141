"""Straight moves of the tip with bounded speed and acceleration, at rest at both ends."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

# Of the profile of least jerk: its highest speed and acceleration, by mean speed and duration.
_PEAK_SPEED = 1.875
_PEAK_ACCELERATION = 10 / math.sqrt(3)


@dataclass(frozen=True, slots=True)
class Setpoint:
    """Where the tip is to be, how fast, and how the hand is to be turned.

    Parameters
    ----------
    position, velocity
        [m], [m/s], shape (3,).
    yaw_rad, yaw_rate_rad_per_s
        Direction in which the jaws close, and its rate.
    acceleration
        [m/s2], shape (3,).
    """

    position: Vector
    velocity: Vector
    yaw_rad: float
    yaw_rate_rad_per_s: float
    acceleration: Vector

    @classmethod
    def at_rest(cls, position: Vector, yaw_rad: float) -> Setpoint:
        """Return a setpoint that does not move."""
        return cls(position, np.zeros(3), yaw_rad, 0.0, np.zeros(3))


@dataclass(frozen=True, slots=True)
class StraightMotion:
    """A straight move along the profile of least jerk.

    Parameters
    ----------
    start, end
        Positions [m], shape (3,).
    start_yaw_rad, end_yaw_rad
        How the hand is turned [rad].
    duration_s
        How long it takes [s], > 0.
    """

    start: Vector
    end: Vector
    start_yaw_rad: float
    end_yaw_rad: float
    duration_s: float

    @classmethod
    def between(
        cls,
        start: Vector,
        end: Vector,
        start_yaw_rad: float,
        end_yaw_rad: float,
        *,
        speed_m_per_s: float,
        acceleration_m_per_s2: float,
        speed_rad_per_s: float = 1.0,
    ) -> StraightMotion:
        """Return the fastest move within limits of speed and acceleration.

        Parameters
        ----------
        start, end
            Positions [m], shape (3,).
        start_yaw_rad, end_yaw_rad
            How the hand is turned [rad].
        speed_m_per_s, acceleration_m_per_s2
            Limits of the tip [m/s], [m/s2], > 0.
        speed_rad_per_s
            Limit of the hand's turning [rad/s], > 0.
        """
        distance_m = float(np.linalg.norm(end - start))
        turn_rad = abs(end_yaw_rad - start_yaw_rad)
        duration_s = max(
            _PEAK_SPEED * distance_m / speed_m_per_s,
            math.sqrt(_PEAK_ACCELERATION * distance_m / acceleration_m_per_s2),
            _PEAK_SPEED * turn_rad / speed_rad_per_s,
            1e-3,
        )
        return cls(start, end, start_yaw_rad, end_yaw_rad, duration_s)

    def at(self, time_s: float) -> Setpoint:
        """Return the setpoint after some time; the end from the duration on."""
        fraction = min(max(time_s / self.duration_s, 0.0), 1.0)
        share = fraction**3 * (10 - 15 * fraction + 6 * fraction**2)
        rate = 30 * fraction**2 * (1 - fraction) ** 2 / self.duration_s
        change = 60 * fraction * (1 - fraction) * (1 - 2 * fraction) / self.duration_s**2
        path, turn = self.end - self.start, self.end_yaw_rad - self.start_yaw_rad
        return Setpoint(
            self.start + share * path,
            rate * path,
            self.start_yaw_rad + share * turn,
            rate * turn,
            change * path,
        )
