"""Straight moves of the tip with bounded speed and acceleration, at rest at both ends.

The hand is not turned meanwhile.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from skillplan_pinocchio.kinematics.fixed_order import length

Vector = NDArray[np.float64]

# Of the profile of least jerk: its highest speed and acceleration, by mean speed and duration.
_PEAK_SPEED = 1.875
_PEAK_ACCELERATION = 10 / math.sqrt(3)


class PosturePath(Protocol):
    """A path of the joints on which the tip goes straight."""

    def at(self, place: float) -> Vector:
        """Return the joint angles [rad] after a share of it, shape (joints,)."""

    def at_each(self, places: Sequence[float]) -> tuple[Vector, Vector, Vector]:
        """Return joint angles [rad], first and second derivative by the share, at many shares.

        Shape (places, joints) each.
        """


@dataclass(frozen=True, slots=True)
class JointRates:
    """How fast joints are to move.

    Parameters
    ----------
    speeds_rad_per_s, accelerations_rad_per_s2
        Shape (joints,) each.
    """

    speeds_rad_per_s: Vector
    accelerations_rad_per_s2: Vector


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
    joints
        How fast the posture changes; None where it does not.
    tracks_joints
        Whether every joint follows the posture, of which the pose is that of the tip; else the tip
        follows the pose, and joints the posture as far as that leaves them free.
    """

    position: Vector
    rotation: Vector
    posture: Vector
    velocity: Vector
    spin_rad_per_s: Vector
    acceleration: Vector
    joints: JointRates | None = None
    tracks_joints: bool = False

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
    """A straight move of the tip.

    Parameters
    ----------
    start
        Where it begins.
    end
        Position [m], shape (3,).
    path
        Of the joints, on which the tip goes there; None where the posture is kept.
    profile
        How it goes on.
    """

    start: Setpoint
    end: Vector
    path: PosturePath | None
    profile: Profile

    @classmethod
    def between(
        cls,
        start: Setpoint,
        end: Vector,
        path: PosturePath | None,
        *,
        speed_m_per_s: float,
        acceleration_m_per_s2: float,
    ) -> StraightMotion:
        """Return the fastest move within limits of speed and acceleration.

        Parameters
        ----------
        start, end, path
            See the class.
        speed_m_per_s, acceleration_m_per_s2
            Limits of the tip [m/s], [m/s2], > 0.
        """
        distance_m = length(end - start.position)
        duration_s = max(
            _PEAK_SPEED * distance_m / speed_m_per_s,
            math.sqrt(_PEAK_ACCELERATION * distance_m / acceleration_m_per_s2),
            1e-3,
        )
        return cls(start, end, path, Profile(duration_s))

    @property
    def duration_s(self) -> float:
        """How long it takes [s]."""
        return self.profile.duration_s

    def at(self, time_s: float) -> Setpoint:
        """Return the setpoint after some time; the end from the duration on."""
        return next(self.at_each([time_s]))

    def at_each(self, times_s: Sequence[float]) -> Iterator[Setpoint]:
        """Yield the setpoints after many times, as `at` does each of them."""
        course = [self.profile.at(time_s) for time_s in times_s]
        shares = [share for share, _, _ in course]
        # Powers as of numbers: those of an array may differ in the last digit.
        table = np.array([(*values, values[1] ** 2) for values in course])
        share, rate, change, rate_squared = table.T[:, :, np.newaxis]
        start, still = self.start, np.zeros(3)
        way = self.end - start.position
        positions, velocities, gains = start.position + share * way, rate * way, change * way
        if self.path is None:
            for place, speed, gain in zip(positions, velocities, gains, strict=True):
                yield Setpoint(place, start.rotation, start.posture, speed, still, gain)
            return
        postures, slopes, bends = self.path.at_each(shares)
        speeds, bent = rate * slopes, change * slopes + rate_squared * bends
        for number, posture in enumerate(postures):
            yield Setpoint(
                positions[number],
                start.rotation,
                posture,
                velocities[number],
                still,
                gains[number],
                JointRates(speeds[number], bent[number]),
            )
