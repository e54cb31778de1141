"""How long an arm takes along a path, within the limits of its joints.

A path in joint space is a cubic spline through nodes; it is run through from rest to rest with
constant acceleration, constant speed and constant deceleration of the path's parameter. Speed
and acceleration of a cubic spline are greatest at nodes or where they turn, so that the limits
hold everywhere, not at samples only.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from skillplan.robots import panda

Array = NDArray[np.float64]

# Of a joint's acceleration so much may go into the bends of the path, the rest into gaining
# speed. The best of these shares is taken: with laxer limits none of them becomes slower.
_SHARES: Final = tuple(step / 40 for step in range(1, 40))


@dataclass(frozen=True)
class JointLimits:
    """How fast joints may move and gain speed.

    Parameters
    ----------
    speed_rad_per_s, acceleration_rad_per_s2
        Of every joint, each > 0; shape (7,).

    Raises
    ------
    ValueError
        If a limit is not positive.
    """

    speed_rad_per_s: tuple[float, ...] = panda.JOINT_SPEED_RAD_PER_S
    acceleration_rad_per_s2: tuple[float, ...] = panda.JOINT_ACCELERATION_RAD_PER_S2

    def __post_init__(self) -> None:
        for name in ("speed_rad_per_s", "acceleration_rad_per_s2"):
            values = getattr(self, name)
            if not all(math.isfinite(value) and value > 0 for value in values):
                raise ValueError(f"Joint limits {name} must be > 0, not {values}.")

    def scaled(self, fraction: float) -> JointLimits:
        """Return the limits of which a fraction in (0, 1] is used."""
        return JointLimits(
            tuple(fraction * value for value in self.speed_rad_per_s),
            tuple(fraction * value for value in self.acceleration_rad_per_s2),
        )


@dataclass(frozen=True)
class Trajectory:
    """A path and the time it takes.

    Parameters
    ----------
    path
        Where the joints go.
    speed_per_s, acceleration_per_s2
        Of the path's parameter, which goes from 0 to 1.
    """

    path: JointPath
    speed_per_s: float
    acceleration_per_s2: float

    @property
    def duration_s(self) -> float:
        """From rest to rest [s]; 0 where the path leads nowhere."""
        if math.isinf(self.acceleration_per_s2):
            return 0.0
        return _duration_s(self.speed_per_s, self.acceleration_per_s2)

    def at(self, time_s: float) -> tuple[Array, Array, Array]:
        """Return joint angles [rad], speeds [rad/s] and accelerations [rad/s^2] at a time.

        Parameters
        ----------
        time_s
            In [0, `duration_s`].

        Returns
        -------
        tuple
            Three arrays of shape (joints,).
        """
        whole_s = self.duration_s
        if whole_s == 0.0:
            still = np.zeros(self.path.nodes.shape[1])
            return self.path.nodes[0].copy(), still, still.copy()
        gain = self.acceleration_per_s2
        peak = min(self.speed_per_s, math.sqrt(gain))
        ramp_s = peak / gain
        if time_s <= ramp_s:
            place, rate, change = gain * time_s**2 / 2, gain * time_s, gain
        elif time_s <= whole_s - ramp_s:
            place, rate, change = peak * (time_s - ramp_s / 2), peak, 0.0
        else:
            left_s = whole_s - time_s
            place, rate, change = 1 - gain * left_s**2 / 2, gain * left_s, -gain
        joints, slope, bend = self.path.at(place)
        return joints, slope * rate, slope * change + bend * rate**2


class JointPath:
    """A cubic spline through joint angles, with equal steps of its parameter from 0 to 1.

    Parameters
    ----------
    nodes
        Joint angles [rad], shape (nodes, joints), two nodes at least.

    Raises
    ------
    ValueError
        If there are fewer than two nodes.
    """

    def __init__(self, nodes: Sequence[Array] | Array) -> None:
        self.nodes: Array = np.array(nodes, dtype=float)
        if len(self.nodes) < 2:
            raise ValueError(f"Path needs at least two nodes, not {len(self.nodes)}.")
        intervals = len(self.nodes) - 1
        self._step = 1 / intervals
        # Second derivatives at the nodes; none at the ends (a natural spline).
        self._bends = _solver(intervals) @ self.nodes

    def at(self, place: float) -> tuple[Array, Array, Array]:
        """Return angles [rad] and their first and second derivative by the parameter."""
        step = self._step
        intervals = len(self.nodes) - 1
        number = min(max(int(place * intervals), 0), intervals - 1)
        u = place / step - number
        q0, q1 = self.nodes[number], self.nodes[number + 1]
        m0, m1 = self._bends[number], self._bends[number + 1]
        v = 1 - u
        angles = v * q0 + u * q1 + step**2 / 6 * ((v**3 - v) * m0 + (u**3 - u) * m1)
        slope = (q1 - q0) / step + step / 6 * ((1 - 3 * v**2) * m0 + (3 * u**2 - 1) * m1)
        return angles, slope, v * m0 + u * m1

    @property
    def steepest(self) -> Array:
        """Greatest size of the first derivative of every joint, shape (joints,)."""
        step, bends = self._step, self._bends
        rise = np.diff(self.nodes, axis=0) / step
        before, after = bends[:-1], bends[1:]
        found = np.maximum(
            np.abs(rise - step / 6 * (2 * before + after)),
            np.abs(rise + step / 6 * (before + 2 * after)),
        )
        # Within an interval it turns where the second derivative changes its sign.
        turns = before * after < 0
        share = np.divide(before, before - after, out=np.zeros_like(before), where=turns)
        inner = rise + step / 6 * ((1 - 3 * (1 - share) ** 2) * before + (3 * share**2 - 1) * after)
        found = np.maximum(found, np.where(turns, np.abs(inner), 0.0))
        return np.asarray(found.max(axis=0))

    @property
    def sharpest(self) -> Array:
        """Greatest size of the second derivative of every joint, shape (joints,)."""
        return np.asarray(np.abs(self._bends).max(axis=0))

    def timed(self, limits: JointLimits) -> Trajectory:
        """Return the fastest trajectory found along the path within the limits."""
        top_speed = np.array(limits.speed_rad_per_s)
        top_gain = np.array(limits.acceleration_rad_per_s2)
        # What a rounding error leaves of a joint at rest is no motion.
        steepest = np.maximum(self.steepest, 1e-12)
        sharpest = np.maximum(self.sharpest, 1e-12)
        if float(steepest.max()) <= 1e-9:
            return Trajectory(self, math.inf, math.inf)
        speed = float((top_speed / steepest).min())
        bend = float((top_gain / sharpest).min())
        gain = float((top_gain / steepest).min())
        choices = [(min(speed, math.sqrt(share * bend)), (1 - share) * gain) for share in _SHARES]
        return Trajectory(self, *min(choices, key=lambda choice: _duration_s(*choice)))


def _duration_s(speed_per_s: float, acceleration_per_s2: float) -> float:
    """Return how long a path of length 1 takes from rest to rest [s]."""
    if speed_per_s**2 >= acceleration_per_s2:
        return 2 / math.sqrt(acceleration_per_s2)
    return 1 / speed_per_s + speed_per_s / acceleration_per_s2


@lru_cache(maxsize=64)
def _solver(intervals: int) -> Array:
    """Return the matrix from nodes to second derivatives, shape (nodes, nodes)."""
    count = intervals + 1
    left = np.eye(count)
    right = np.zeros((count, count))
    for row in range(1, intervals):
        left[row, row - 1 : row + 2] = (1, 4, 1)
        right[row, row - 1 : row + 2] = np.array((1, -2, 1)) * 6 * intervals**2
    return np.asarray(np.linalg.solve(left, right))
