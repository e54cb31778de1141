"""Joint trajectories of skills: points in time, and actions of the hand in between."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan.task.pose import Pose

Array = NDArray[np.float64]

NS_PER_S = 1_000_000_000
# Poses of a turn per second, and at most.
_POSES_PER_S, _MOST_POSES = 20, 2_000


@dataclass(frozen=True, slots=True)
class HandAction:
    """An action of the hand while the arm rests.

    Parameters
    ----------
    after_ns
        Time since the begin of the skill [ns].
    """

    after_ns: int
    text: str


@dataclass(frozen=True, slots=True)
class WorkholderTurn:
    """Motion of a workholder in a turn while the arm rests.

    Parameters
    ----------
    after_ns
        Time since the begin of the skill [ns].
    times_ns
        Times of the poses, strictly rising from 0 [ns].
    poses
        Motion of its bodies since its first orientation, in the world.
    """

    after_ns: int
    workholder: str
    times_ns: tuple[int, ...]
    poses: tuple[Pose, ...]


@dataclass(frozen=True, slots=True, eq=False)
class SkillTrajectory:
    """Points of the joints in one skill, from rest to rest.

    Parameters
    ----------
    begin_ns
        Begin in the plan [ns].
    times_ns
        Times of the points, strictly rising from 0 [ns].
    positions_rad, speeds_rad_per_s
        Angles and speeds of the joints, shape (points, joints).
    """

    skill: str
    begin_ns: int
    times_ns: tuple[int, ...]
    positions_rad: Array
    speeds_rad_per_s: Array
    hand: tuple[HandAction, ...]
    turns: tuple[WorkholderTurn, ...] = ()

    @property
    def end_ns(self) -> int:
        """End in the plan [ns]."""
        return self.begin_ns + self.times_ns[-1]


class TrajectoryPoints:
    """Collects the points of a skill.

    Parameters
    ----------
    begin_rad
        Posture of the arm before, shape (joints,).
    """

    def __init__(self, begin_rad: Array) -> None:
        self._now_s = 0.0
        self._times_ns = [0]
        self._positions = [np.asarray(begin_rad, dtype=float)]
        self._speeds = [np.zeros(len(begin_rad))]
        self._hand: list[HandAction] = []
        self._turns: list[WorkholderTurn] = []

    def move(self, times_s: Array, positions_rad: Array, speeds_rad_per_s: Array) -> None:
        """Add a run from rest to rest.

        Parameters
        ----------
        times_s
            Times of the points from 0; the first point is the current posture.
        positions_rad, speeds_rad_per_s
            Angles and speeds of the joints, shape (points, joints).
        """
        for time_s, position, speed in zip(
            times_s[1:], positions_rad[1:], speeds_rad_per_s[1:], strict=True
        ):
            self._add(self._now_s + float(time_s), position, speed)
        self._now_s += float(times_s[-1])

    @property
    def now_s(self) -> float:
        """Time since the begin of the skill [s]."""
        return self._now_s

    def act(self, duration_s: float, text: str) -> None:
        """Add an action of the hand during which the arm rests."""
        self._hand.append(HandAction(_to_ns(self._now_s), text))
        self.rest(duration_s)

    def rest(self, duration_s: float) -> None:
        """Let the arm rest [s]."""
        self._now_s += duration_s
        self._add(self._now_s, self._positions[-1], np.zeros(len(self._positions[-1])))

    def turn(
        self, duration_s: float, text: str, workholder: str, pose_at: Callable[[float], Pose]
    ) -> None:
        """Add a turn of a workholder, from its poses by the share of the time."""
        count = min(_MOST_POSES, max(1, math.ceil(duration_s * _POSES_PER_S)))
        shares = [number / count for number in range(count + 1)]
        times_ns = tuple(_to_ns(share * duration_s) for share in shares)
        poses = tuple(pose_at(share) for share in shares)
        self._turns.append(WorkholderTurn(_to_ns(self._now_s), workholder, times_ns, poses))
        self.act(duration_s, text)

    def of(self, skill: str, begin_ns: int) -> SkillTrajectory:
        """Return the trajectory of a skill that begins at a time."""
        return SkillTrajectory(
            skill,
            begin_ns,
            tuple(self._times_ns),
            np.array(self._positions),
            np.array(self._speeds),
            tuple(self._hand),
            tuple(self._turns),
        )

    def _add(self, time_s: float, position: Array, speed: Array) -> None:
        time_ns = _to_ns(time_s)
        # A run below a nanosecond moves nothing.
        if time_ns > self._times_ns[-1]:
            self._times_ns.append(time_ns)
            self._positions.append(position)
            self._speeds.append(speed)


def split_seconds(time_ns: int) -> tuple[int, int]:
    """Return a time as whole seconds and remaining nanoseconds."""
    return divmod(time_ns, NS_PER_S)


def _to_ns(time_s: float) -> int:
    return round(time_s * NS_PER_S)
