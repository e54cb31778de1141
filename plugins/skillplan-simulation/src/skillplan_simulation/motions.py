"""Timed motions of the arm: straight moves of the tip, joint moves, and planned motions."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from skillplan.physics.linear_motions import LinearMotion
from skillplan_pinocchio.kinematics.fixed_order import length, times
from skillplan_simulation.kinematics import ArmKinematics, points_down

Vector = NDArray[np.float64]

PEAK_SPEED = 1.875
"""Peak speed of the minimum-jerk profile, relative to the mean speed."""

# Its peak acceleration, relative to length and duration.
_PEAK_ACCELERATION = 10 / math.sqrt(3)


class PosturePath(Protocol):
    """A joint path on which the tip moves straight."""

    def at(self, place: float) -> Vector:
        """Return the joint angles [rad] at a share of the path, shape (joints,)."""

    def at_each(self, places: Sequence[float]) -> tuple[Vector, Vector, Vector]:
        """Return joint angles [rad], first and second derivatives at many shares.

        Shape (places, joints) each.
        """


@dataclass(frozen=True, slots=True)
class PathSection:
    """A section of a joint path, from one share of it to another."""

    path: PosturePath
    begin: float
    end: float

    def at(self, place: float) -> Vector:
        """Return the joint angles [rad] at a share of the section, shape (joints,)."""
        return self.path.at(self.begin + place * (self.end - self.begin))

    def at_each(self, places: Sequence[float]) -> tuple[Vector, Vector, Vector]:
        """Return joint angles [rad], first and second derivatives; see `PosturePath`."""
        share = self.end - self.begin
        shares = [self.begin + place * share for place in places]
        joints, slopes, bends = self.path.at_each(shares)
        return joints, share * slopes, share**2 * bends


@dataclass(frozen=True, slots=True)
class JointRates:
    """Target speeds and accelerations of joints.

    Parameters
    ----------
    speeds_rad_per_s, accelerations_rad_per_s2
        Shape (joints,) each.
    """

    speeds_rad_per_s: Vector
    accelerations_rad_per_s2: Vector


@dataclass(frozen=True, slots=True)
class Setpoint:
    """Target pose and motion of the tip.

    Parameters
    ----------
    position, velocity, acceleration
        Target [m], [m/s], [m/s2], shape (3,).
    rotation
        Target rotation of the hand, shape (3, 3).
    spin_rad_per_s
        Target angular velocity about the world's axes, shape (3,).
    posture
        Joint angles that attract the arm in the null space of the tip, shape (joints,) [rad].
    joints
        Rates of the posture; None if it is constant.
    tracks_joints
        True if every joint tracks the posture. Otherwise the tip tracks the pose, and the joints
        follow the posture in its null space.
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
        """Return a setpoint at rest."""
        return cls(position, rotation, posture, np.zeros(3), np.zeros(3), np.zeros(3))


@dataclass(frozen=True, slots=True)
class Profile:
    """The minimum-jerk profile: share of a move, its rate and the change of the rate.

    Parameters
    ----------
    duration_s
        Duration of the move [s], > 0.
    """

    duration_s: float

    def at(self, time_s: float) -> tuple[float, float, float]:
        """Return share [-], rate [1/s] and change of the rate [1/s2] at a time."""
        fraction = min(max(time_s / self.duration_s, 0.0), 1.0)
        share = fraction**3 * (10 - 15 * fraction + 6 * fraction**2)
        rate = 30 * fraction**2 * (1 - fraction) ** 2 / self.duration_s
        change = 60 * fraction * (1 - fraction) * (1 - 2 * fraction) / self.duration_s**2
        return share, rate, change


@dataclass(frozen=True, slots=True)
class StraightMotion:
    """A straight move of the tip between two rests; the hand is not turned.

    Parameters
    ----------
    end
        Target position [m], shape (3,).
    path
        Joint path on which the tip moves; None keeps the posture.
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
        joints_rad_per_s: Sequence[float],
    ) -> StraightMotion:
        """Return the fastest move within limits of speed and acceleration.

        Near a singular posture the joints limit the speed of the tip.

        Parameters
        ----------
        speed_m_per_s, acceleration_m_per_s2
            Limits of the tip [m/s], [m/s2], > 0.
        joints_rad_per_s
            Speed limits of the joints [rad/s], > 0, shape (joints,).
        """
        distance_m = length(end - start.position)
        duration_s = max(
            PEAK_SPEED * distance_m / speed_m_per_s,
            math.sqrt(_PEAK_ACCELERATION * distance_m / acceleration_m_per_s2),
            1e-3,
            0.0 if path is None else _bound_duration_s(path, joints_rad_per_s),
        )
        return cls(start, end, path, Profile(duration_s))

    @property
    def duration_s(self) -> float:
        """Duration [s]."""
        return self.profile.duration_s

    def at(self, time_s: float) -> Setpoint:
        """Return the setpoint at a time; from the duration on, the end."""
        return next(self.at_each([time_s]))

    def at_each(self, times_s: Sequence[float]) -> Iterator[Setpoint]:
        """Yield the setpoints at many times, equal to `at`."""
        course = [self.profile.at(time_s) for time_s in times_s]
        shares = [share for share, _, _ in course]
        # Scalar powers: numpy's may differ in the last digit.
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


def _bound_duration_s(path: PosturePath, speed_rad_per_s: Sequence[float]) -> float:
    """Return the least duration in which joints follow a path within their speeds [s]."""
    course = [Profile(1.0).at(number / _SAMPLES) for number in range(_SAMPLES + 1)]
    _, slopes, _ = path.at_each([share for share, _, _ in course])
    rates = np.array([[rate] for _, rate, _ in course])
    return float((np.abs(rates * slopes) / speed_rad_per_s).max())


# Minimum number of pieces of a path, and number of pieces between two nodes.
_PIECES, _PIECES_PER_NODE = 32, 4
# Number of samples for speeds and accelerations.
_SAMPLES = 100
# Points of a held part along the axes of the hand, from the tip [m].
_HELD_M = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]])


class JointRun(Protocol):
    """A joint path with its timing."""

    @property
    def duration_s(self) -> float:
        """Duration from rest to rest [s]; 0 if the path has no length."""

    def at(self, time_s: float) -> tuple[Vector, Vector, Vector]:
        """Return angles [rad], speeds [rad/s] and accelerations [rad/s2], each (joints,)."""


@dataclass(frozen=True, slots=True)
class SlowedRun:
    """A run that is slowed down by a constant factor.

    Parameters
    ----------
    factor
        Ratio of the durations, >= 1.
    """

    run: JointRun
    factor: float

    @classmethod
    def within(
        cls, run: JointRun, kinematics: ArmKinematics, acceleration_m_per_s2: float
    ) -> JointRun:
        """Return a run, slowed down if a held part would exceed an acceleration [m/s2], > 0.

        Samples the tip and points around it, so rotations of the hand count.
        """
        step_s = run.duration_s / _SAMPLES
        if step_s <= 0:
            return run
        joints = [run.at(number * step_s)[0] for number in range(_SAMPLES + 1)]
        tips = [kinematics.tip(joint) for joint in joints]
        points = np.array([(tip.position + times(_HELD_M, tip.rotation.T)) for tip in tips])
        gains = np.linalg.norm(np.diff(points, n=2, axis=0), axis=2) / step_s**2
        excess = math.sqrt(float(gains.max()) / acceleration_m_per_s2)
        return run if excess <= 1.0 else cls(run, excess)

    @property
    def duration_s(self) -> float:
        """Duration from rest to rest [s]."""
        return self.factor * self.run.duration_s

    def at(self, time_s: float) -> tuple[Vector, Vector, Vector]:
        """Return angles [rad], speeds [rad/s] and accelerations [rad/s2], each (joints,)."""
        joints, speeds, gains = self.run.at(time_s / self.factor)
        return joints, speeds / self.factor, gains / self.factor**2


@dataclass(frozen=True, slots=True)
class JointMotion:
    """A move along a joint path.

    Parameters
    ----------
    nodes_rad
        Joint angles on the path, shape (nodes, joints).
    """

    kinematics: ArmKinematics
    nodes_rad: Vector
    run: JointRun

    @property
    def duration_s(self) -> float:
        """Duration [s]."""
        return self.run.duration_s

    def at(self, time_s: float) -> Setpoint:
        """Return the setpoint at a time; from the duration on, the end."""
        if time_s >= self.duration_s:
            joints: Vector = self.nodes_rad[-1]
            speeds = gains = np.zeros(len(joints))
        else:
            joints, speeds, gains = self.run.at(time_s)
        tip = self.kinematics.tip(joints)
        # Only joint rates are commanded; the tip follows.
        still = np.zeros(3)
        rates = JointRates(speeds, gains)
        return Setpoint(tip.position, tip.rotation, joints, still, still, still, rates, True)

    def at_each(self, times_s: Sequence[float]) -> Iterator[Setpoint]:
        """Yield the setpoints at many times, equal to `at`."""
        return map(self.at, times_s)

    def postures(self) -> list[Vector]:
        """Return postures along the path, ends included, dense enough to interpolate linearly."""
        count = max(_PIECES, _PIECES_PER_NODE * (len(self.nodes_rad) - 1))
        times_s = np.linspace(0.0, self.duration_s, count + 1)[:-1].tolist()
        return [*(self.run.at(time_s)[0] for time_s in times_s), self.nodes_rad[-1]]


@dataclass(frozen=True, slots=True)
class ArmMotion:
    """A motion of the hand with its joint paths.

    Parameters
    ----------
    rotation
        Rotation of the hand, shape (3, 3).
    down
        Joint paths along the stretches of the approach.
    up
        Joint paths along the stretches of the retreat.
    travel
        Travel from the previous posture to the start of the approach.
    matters
        True if the travel may meet an obstacle, or turns the hand in space.
    around
        Bodies that the travel avoids; empty if it is straight.
    """

    motion: LinearMotion
    rotation: Vector
    down: tuple[PosturePath, ...]
    up: tuple[PosturePath, ...]
    travel: JointMotion
    matters: bool
    around: tuple[str, ...] = ()

    @property
    def approach(self) -> tuple[Vector, ...]:
        """Postures at the points of the approach [rad], shape (joints,) each."""
        return _list_ends(self.down)

    @property
    def retreat(self) -> tuple[Vector, ...]:
        """Postures at the points of the retreat [rad], shape (joints,) each."""
        return _list_ends(self.up)

    @property
    def points_down(self) -> bool:
        """Return whether the hand points straight down."""
        return points_down(self.rotation)


def _list_ends(paths: tuple[PosturePath, ...]) -> tuple[Vector, ...]:
    return (paths[0].at(0.0), *(path.at(1.0) for path in paths))
