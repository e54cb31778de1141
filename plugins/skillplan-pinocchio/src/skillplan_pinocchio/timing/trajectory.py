"""The fastest run along a path of the joints, from rest to rest within their limits, by toppra.

toppra chooses the speed of the path's parameter on a grid; see `toppra_run`. Finer grids are taken
until the limits hold between its places, too, but for a little: by that little the whole run is
slowed down. The limits hold everywhere, not at samples only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from skillplan.robots.arm_description import ArmDescription
from skillplan_pinocchio.kinematics.joint_path import Array, JointPath
from skillplan_pinocchio.timing.toppra_run import GridRun

# A grid has about so many intervals, and so many between two nodes at least. Finer ones are taken
# until a run exceeds the limits by no more than this factor.
_GRIDS: Final = (64, 128, 256, 512, 1024)
_FEWEST: Final = 8
_EXCESS: Final = 1.001
# Where a run loses more than this share of its time to its grid, it is split, so often at most.
_LOST: Final = 0.005
_SPLITS: Final = 4


@dataclass(frozen=True, slots=True)
class JointLimits:
    """How fast joints may move and gain speed.

    Parameters
    ----------
    speed_rad_per_s, acceleration_rad_per_s2
        Of every joint, each > 0; shape (joints,).

    Raises
    ------
    ValueError
        If a limit is not positive.
    """

    speed_rad_per_s: tuple[float, ...]
    acceleration_rad_per_s2: tuple[float, ...]

    def __post_init__(self) -> None:
        for name in ("speed_rad_per_s", "acceleration_rad_per_s2"):
            values = getattr(self, name)
            if not all(math.isfinite(value) and value > 0 for value in values):
                raise ValueError(f"Joint limits {name} must be > 0, not {values}.")

    @classmethod
    def of(cls, arm: ArmDescription) -> JointLimits:
        """Return the limits of an arm."""
        return cls(arm.speed_rad_per_s, arm.acceleration_rad_per_s2)

    def scaled(self, fraction: float) -> JointLimits:
        """Return the limits of which a fraction in (0, 1] is used."""
        return JointLimits(
            tuple(fraction * value for value in self.speed_rad_per_s),
            tuple(fraction * value for value in self.acceleration_rad_per_s2),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """A path and when the joints are where on it.

    Parameters
    ----------
    path
        Where the joints go.
    places
        Of the path's parameter, rising from 0 to 1; a single one where the path leads nowhere.
    rates_per_s
        How fast the parameter changes there, 0 at both ends; between two places it gains speed
        evenly.
    times_s
        When the joints are there, from 0 on.
    """

    path: JointPath
    places: Array
    rates_per_s: Array
    times_s: Array

    @property
    def duration_s(self) -> float:
        """From rest to rest [s]; 0 where the path leads nowhere."""
        return float(self.times_s[-1])

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
        last = len(self.places) - 2
        if last < 0:
            still = np.zeros(self.path.joints)
            return self.path.at(0.0), still, still.copy()
        number = min(max(int(np.searchsorted(self.times_s, time_s, "right")) - 1, 0), last)
        begin, end = self.places[number : number + 2]
        slow, fast = self.rates_per_s[number : number + 2]
        gain = (fast**2 - slow**2) / (2 * (end - begin))
        passed_s = time_s - self.times_s[number]
        rate = slow + gain * passed_s
        place = min(max(begin + (slow + gain * passed_s / 2) * passed_s, begin), end)
        slope, bend = self.path.rates(place)
        return self.path.at(place), slope * rate, slope * gain + bend * rate**2


def fastest_trajectory(path: JointPath, limits: JointLimits) -> Trajectory:
    """Return the fastest run along a path within limits.

    A straight path needs no toppra: its fastest run has a closed form. Where a path is so uneven
    that toppra finds nothing on it, the run stops at its middle node.

    Parameters
    ----------
    path
        Where the joints go.
    limits
        Of their speeds and accelerations.

    Raises
    ------
    ArithmeticError
        If toppra finds nothing between two nodes either.
    """
    # What a rounding error leaves of a joint at rest is no motion.
    if float(path.steepest.max()) <= 1e-9:
        return Trajectory(path, np.zeros(1), np.zeros(1), np.zeros(1))
    speed, gain = np.array(limits.speed_rad_per_s), np.array(limits.acceleration_rad_per_s2)
    if len(path.nodes) == 2:
        return _straight(path, speed, gain)
    knots = len(path.nodes) - 1
    for intervals in _GRIDS:
        count = knots * max(math.ceil(intervals / knots), _FEWEST)
        run = GridRun.on(path, np.arange(count + 1) / count, (speed, gain))
        if run.excess <= _EXCESS:
            break
    for _ in range(_SPLITS):
        if float(run.lost.sum()) <= _LOST:
            break
        finer = _split(path, run, (speed, gain))
        if finer.duration_s >= run.duration_s:
            break
        run = finer
    rates = run.rates / max(run.excess, 1.0)
    steps_s = 2 * np.diff(run.places) / (rates[1:] + rates[:-1])
    times_s = np.concatenate([np.zeros(1), np.cumsum(steps_s)])
    return Trajectory(path, run.places, rates, times_s)


def _split(path: JointPath, run: GridRun, limits: tuple[Array, Array]) -> GridRun:
    """Return the run on a finer grid, or the same one where toppra finds nothing on that."""
    try:
        return GridRun.on(path, run.finer, limits)
    except ArithmeticError:
        return run


def _straight(path: JointPath, speed: Array, gain: Array) -> Trajectory:
    """Return the fastest run along a straight path: all joints gain speed, keep it, and lose it."""
    turns = np.maximum(path.steepest, 1e-12)
    fastest, hardest = float((speed / turns).min()), float((gain / turns).min())
    if fastest**2 >= hardest:
        top = math.sqrt(hardest)
        places, rates = np.array([0.0, 0.5, 1.0]), np.array([0.0, top, 0.0])
        times_s = np.array([0.0, 1.0, 2.0]) / top
        return Trajectory(path, places, rates, times_s)
    ramp, ramp_s = fastest**2 / (2 * hardest), fastest / hardest
    until_s = ramp_s + (1 - 2 * ramp) / fastest
    return Trajectory(
        path,
        np.array([0.0, ramp, 1 - ramp, 1.0]),
        np.array([0.0, fastest, fastest, 0.0]),
        np.array([0.0, ramp_s, until_s, until_s + ramp_s]),
    )
