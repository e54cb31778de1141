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

from skillplan.physics.linear_motions import LinearMotion
from skillplan_pinocchio.kinematics.fixed_order import length, times
from skillplan_simulation.kinematics import ArmKinematics, points_down

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


# A way is looked at in so many pieces at least, and in so many between two nodes.
_PIECES, _PIECES_PER_NODE = 32, 4
# Accelerations of the tip are looked at in so many steps.
_SAMPLES = 100
# Of what is held, from the tip, along the axes of the hand [m].
_HELD_M = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]])


class JointRun(Protocol):
    """A path of the joints, and when they are where on it."""

    @property
    def duration_s(self) -> float:
        """From rest to rest [s]; 0 where the path leads nowhere."""

    def at(self, time_s: float) -> tuple[Vector, Vector, Vector]:
        """Return angles [rad], speeds [rad/s] and accelerations [rad/s2], each (joints,)."""


@dataclass(frozen=True, slots=True)
class SlowedRun:
    """A run that takes longer, by one factor all along.

    Parameters
    ----------
    run
        The faster one.
    factor
        How many times as long it takes, >= 1.
    """

    run: JointRun
    factor: float

    @classmethod
    def within(
        cls, run: JointRun, kinematics: ArmKinematics, acceleration_m_per_s2: float
    ) -> JointRun:
        """Return a run, slowed where what is held would exceed an acceleration [m/s2], > 0.

        Looked at are the tip and points about it, so that how fast the hand is turned counts.
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
        """From rest to rest [s]."""
        return self.factor * self.run.duration_s

    def at(self, time_s: float) -> tuple[Vector, Vector, Vector]:
        """Return angles [rad], speeds [rad/s] and accelerations [rad/s2], each (joints,)."""
        joints, speeds, gains = self.run.at(time_s / self.factor)
        return joints, speeds / self.factor, gains / self.factor**2


@dataclass(frozen=True, slots=True)
class JointMotion:
    """A move along a path of the joints.

    Parameters
    ----------
    kinematics
        The arm's.
    nodes_rad
        Joint angles that the path goes through, shape (nodes, joints).
    run
        The path with its times.
    """

    kinematics: ArmKinematics
    nodes_rad: Vector
    run: JointRun

    @property
    def duration_s(self) -> float:
        """How long it takes [s]."""
        return self.run.duration_s

    def at(self, time_s: float) -> Setpoint:
        """Return the setpoint after some time; the end from the duration on."""
        if time_s >= self.duration_s:
            joints: Vector = self.nodes_rad[-1]
            speeds = gains = np.zeros(len(joints))
        else:
            joints, speeds, gains = self.run.at(time_s)
        tip = self.kinematics.tip(joints)
        # The joints are told how fast to go, and the tip follows.
        still = np.zeros(3)
        rates = JointRates(speeds, gains)
        return Setpoint(tip.position, tip.rotation, joints, still, still, still, rates, True)

    def at_each(self, times_s: Sequence[float]) -> Iterator[Setpoint]:
        """Yield the setpoints after many times, as `at` does each of them."""
        return map(self.at, times_s)

    def postures(self) -> list[Vector]:
        """Return postures on the way, both ends included, so dense that it is straight between."""
        count = max(_PIECES, _PIECES_PER_NODE * (len(self.nodes_rad) - 1))
        times_s = np.linspace(0.0, self.duration_s, count + 1)[:-1].tolist()
        return [*(self.run.at(time_s)[0] for time_s in times_s), self.nodes_rad[-1]]


@dataclass(frozen=True, slots=True)
class ArmMotion:
    """A motion of the hand with how the arm follows it.

    Parameters
    ----------
    motion
        Of the task.
    rotation
        How the hand is turned in it, shape (3, 3).
    down
        The paths of the joints along the stretches of the approach.
    up
        The same of the retreat.
    travel
        From where the arm was before to the first of them.
    matters
        Whether something may be met on the travel, or the hand is turned in space on it.
    around
        Bodies that the travel goes round; none where it is straight.
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
        return _ends(self.down)

    @property
    def retreat(self) -> tuple[Vector, ...]:
        """The same of the retreat."""
        return _ends(self.up)

    @property
    def points_down(self) -> bool:
        """Whether the hand points straight down."""
        return points_down(self.rotation)


def _ends(paths: tuple[PosturePath, ...]) -> tuple[Vector, ...]:
    return (paths[0].at(0.0), *(path.at(1.0) for path in paths))
