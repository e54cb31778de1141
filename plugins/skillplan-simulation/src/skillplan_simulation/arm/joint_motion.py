"""Moves that follow a timed path of the joints, such as a travel that was planned."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from skillplan_pinocchio.kinematics.fixed_order import times
from skillplan_simulation.arm.kinematics import ArmKinematics
from skillplan_simulation.arm.straight_motion import JointRates, Setpoint

Vector = NDArray[np.float64]

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
        tips = [kinematics.tip(one) for one in joints]
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
