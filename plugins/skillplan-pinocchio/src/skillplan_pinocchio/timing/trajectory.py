"""The fastest run along a path of the joints, from rest to rest within their limits, by toppra.

toppra (Pham and Pham, "A new approach to time-optimal path parameterization based on reachability
analysis", 2018) chooses the speed of the path's parameter on a grid. Between two places of the
grid the parameter has constant acceleration and the path is one cubic, so that the greatest speed
and acceleration of every joint are known in closed form. By what little they exceed the limits, the
whole run is slowed down: the limits hold everywhere, not at samples only.
"""

from __future__ import annotations

import logging
import math
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from types import ModuleType
from typing import Any, Final

import numpy as np

from skillplan.robots.arm_description import ArmDescription
from skillplan_pinocchio.kinematics.joint_path import Array, JointPath

# A grid has about so many intervals, and so many between two nodes at least. Finer ones are taken
# until a run exceeds the limits by no more than this factor.
_GRIDS: Final = (64, 128, 256, 512, 1024)
_FEWEST: Final = 8
_EXCESS: Final = 1.001


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
        slopes, bends = self.path.derivatives(np.array([place]))
        return self.path.at(place), slopes[0] * rate, slopes[0] * gain + bends[0] * rate**2


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
        per_knot = max(math.ceil(intervals / knots), _FEWEST)
        places, rates = _run(path, (0, knots), per_knot, (speed, gain))
        fastest, hardest = _peaks(path, places, rates)
        excess = max(float((fastest / speed).max()), math.sqrt(float((hardest / gain).max())))
        if excess <= _EXCESS:
            break
    rates = rates / max(excess, 1.0)
    steps_s = 2 * np.diff(places) / (rates[1:] + rates[:-1])
    return Trajectory(path, places, rates, np.concatenate([np.zeros(1), np.cumsum(steps_s)]))


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


def _run(
    path: JointPath, nodes: tuple[int, int], per_knot: int, limits: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Return places from one node to another, and how fast the parameter changes there."""
    first, last = nodes
    count = (last - first) * per_knot
    steps = np.arange(count + 1)
    places = (first * per_knot + steps) / ((len(path.nodes) - 1) * per_knot)
    span = (last - first) / (len(path.nodes) - 1)
    slopes, bends = path.derivatives(places)
    rates = _rates(slopes * span, bends * span**2, steps / count, limits)
    if rates is not None:
        return places, rates * span
    if last - first == 1:
        raise ArithmeticError("toppra found no run between two nodes of a path of the joints")
    middle = (first + last) // 2
    one, other = (_run(path, half, per_knot, limits) for half in ((first, middle), (middle, last)))
    return (
        np.concatenate([one[0][:-1], other[0]]),
        np.concatenate([one[1][:-1], other[1]]),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Geometry:
    """Derivatives of a path at the places of a grid, as toppra asks for them."""

    slopes: Array
    bends: Array

    @property
    def dof(self) -> int:
        return int(self.slopes.shape[1])

    @property
    def path_interval(self) -> Array:
        return np.array([0.0, 1.0])

    def __call__(self, places: Array, order: int) -> Array:
        return self.slopes if order == 1 else self.bends


def _rates(slopes: Array, bends: Array, grid: Array, limits: tuple[Array, Array]) -> Array | None:
    """Return how fast the parameter changes on a grid from 0 to 1; None where toppra fails."""
    speed, gain = limits
    steepest, sharpest = np.abs(slopes).max(axis=0), np.abs(bends).max(axis=0)
    # In this unit of time, and each joint's angles in units of its own, what toppra multiplies with
    # is 1 at most, however short the path is: its tolerances are absolute.
    unit_s = max(
        float((steepest / speed).max()),
        math.sqrt(float((np.maximum(steepest, sharpest) / gain).max())),
    )
    unit_rad = np.maximum(np.maximum(steepest, sharpest), 1e-6 * gain * unit_s**2)
    toppra = _toppra()
    bounds = [
        toppra.constraint.JointVelocityConstraint(speed * unit_s / unit_rad),
        toppra.constraint.JointAccelerationConstraint(gain * unit_s**2 / unit_rad),
    ]
    geometry = _Geometry(slopes / unit_rad, bends / unit_rad)
    solver = toppra.algorithm.TOPPRA(bounds, geometry, gridpoints=grid, solver_wrapper="seidel")
    solver.compute_parameterization(0.0, 0.0)
    rates = solver.problem_data.sd_vec
    if rates is None or not bool(np.isfinite(rates).all() and (rates[1:-1] > 0).all()):
        return None
    return np.asarray(rates) / unit_s


@cache
def _toppra() -> Any:
    """Return the package; it loads scipy, which only who asks for times needs.

    It is kept quiet: a run that it does not find is looked for in parts.
    """
    with warnings.catch_warnings(), _without_drawing():
        # Of docstrings with escapes that Python does not know, where it was not compiled before.
        warnings.simplefilter("ignore")
        import toppra
    logging.getLogger("toppra").setLevel(logging.CRITICAL)
    return toppra


@contextmanager
def _without_drawing() -> Iterator[None]:
    """Import what imports matplotlib only to draw its own insides, and leave matplotlib alone.

    It takes as long as all the rest, and fails where the environment names a backend that is none.
    """
    absent = [name for name in ("matplotlib", "matplotlib.pyplot") if name not in sys.modules]
    sys.modules.update({name: ModuleType(name) for name in absent})
    try:
        yield
    finally:
        for name in absent:
            del sys.modules[name]


def _peaks(path: JointPath, places: Array, rates: Array) -> tuple[Array, Array]:
    """Return the greatest speed and acceleration of every joint on a run.

    At a distance d into an interval a joint's slope is a square of d, its bend and the squared rate
    are straight lines: its acceleration is a square of d, and its speed turns where that is 0.
    """
    slopes, bends = path.derivatives(places)
    length = np.diff(places)[:, np.newaxis]
    start = rates[:-1, np.newaxis] ** 2
    gain = np.diff(rates**2)[:, np.newaxis] / (2 * length)
    slope, bend, turn = slopes[:-1], bends[:-1], np.diff(bends, axis=0) / length
    none = slope * gain + bend * start
    once = 3 * gain * bend + turn * start
    twice = 2.5 * gain * turn
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(np.maximum(once**2 - 4 * twice * none, 0.0))
        larger = -(once + np.copysign(root, once)) / 2
        asked = [-once / (2 * twice), larger / twice, none / larger]
    # Where there is no such place, some other place is asked about; none can do harm.
    asked += [np.zeros_like(none), np.broadcast_to(length, none.shape)]
    found = [np.clip(np.nan_to_num(d, posinf=0.0, neginf=0.0), 0.0, length) for d in asked]
    squares = [np.maximum(start + 2 * gain * d, 0.0) for d in found]
    speeds = [
        np.abs(slope + (bend + turn * d / 2) * d) * np.sqrt(square)
        for d, square in zip(found, squares, strict=True)
    ]
    gains = [np.abs(none + (once + twice * d) * d) for d in found]
    return np.max(speeds, axis=(0, 1)), np.max(gains, axis=(0, 1))
