"""What toppra finds on a grid along a path of the joints, and how good it is.

toppra (Pham and Pham, "A new approach to time-optimal path parameterization based on reachability
analysis", 2018) chooses the speed of the path's parameter on a grid. Between two places of the
grid the parameter has constant acceleration and the path is one cubic, so that the greatest speed
and acceleration of every joint are known in closed form.
"""

from __future__ import annotations

import logging
import math
import sys
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from types import ModuleType
from typing import Any, Final

import numpy as np

from skillplan_pinocchio.kinematics.joint_path import Array, JointPath

# Intervals that lose more than this share of a run's time are split into so many.
_LOST: Final = 0.0002
_PARTS: Final = 8

# What toppra imports to draw its insides, for splines of its own, and for another linear solver; a
# path here tells its derivatives itself. With the names that it takes from there.
_UNUSED: Final = {
    "scipy": (),
    "matplotlib": (),
    "matplotlib.pyplot": (),
    "scipy.interpolate": ("BPoly", "CubicSpline", "PPoly", "UnivariateSpline"),
    "scipy.sparse": (),
}


@dataclass(frozen=True, slots=True, eq=False)
class GridRun:
    """What toppra finds on a grid, and how good it is.

    Parameters
    ----------
    places
        The grid.
    rates
        How fast the parameter changes there.
    excess
        By which factor a limit is exceeded between two places; 1 at most where none is.
    lost
        How much of its time the run loses to the grid, by interval, as a share. The parameter gains
        speed evenly between two places: where hardly any acceleration is used, it might go at the
        speed of the faster end sooner.
    """

    places: Array
    rates: Array
    excess: float
    lost: Array

    @classmethod
    def on(cls, path: JointPath, places: Array, limits: tuple[Array, Array]) -> GridRun:
        """Return the run on a grid with a place at every node."""
        speed, gain = limits
        rates = _run(path, (0, len(path.nodes) - 1), places, limits)
        fastest, hardest = _peaks(path, places, rates)
        used = (hardest / gain).max(axis=1)
        excess = max(float((fastest / speed).max()), math.sqrt(float(used.max())))
        steps_s = _steps_s(places, rates)
        least_s = np.diff(places) / np.maximum(rates[1:], rates[:-1])
        lost = (steps_s - least_s) * np.maximum(1 - used, 0.0) / steps_s.sum()
        return cls(places, rates, excess, lost)

    @property
    def duration_s(self) -> float:
        """How long it takes within the limits [s]."""
        return float(_steps_s(self.places, self.rates).sum()) * max(self.excess, 1.0)

    @property
    def finer(self) -> Array:
        """A grid with more places where the run might be faster."""
        begins, steps = self.places[:-1], np.diff(self.places)
        parts = np.where(self.lost > _LOST, _PARTS, 1)
        number = np.concatenate([np.arange(count) for count in parts.tolist()])
        inner = np.repeat(begins, parts) + number * np.repeat(steps / parts, parts)
        return np.append(inner, self.places[-1])


def _steps_s(places: Array, rates: Array) -> Array:
    """Return how long a run takes between every two places [s]."""
    return np.asarray(2 * np.diff(places) / (rates[1:] + rates[:-1]))


def _run(
    path: JointPath, nodes: tuple[int, int], places: Array, limits: tuple[Array, Array]
) -> Array:
    """Return how fast the parameter changes at places, of which each node is one.

    Parameters
    ----------
    path
        Where the joints go.
    nodes
        From which node to which, by number: the first place and the last.
    places
        A grid between them.
    limits
        Speeds and accelerations.
    """
    first, last = nodes
    span = places[-1] - places[0]
    slopes, bends = path.derivatives(places)
    grid = (places - places[0]) / span
    rates = _rates(slopes * span, bends * span**2, grid, limits)
    if rates is not None:
        return np.asarray(rates * span)
    if last - first == 1:
        raise ArithmeticError("toppra found no run between two nodes of a path of the joints")
    middle = (first + last) // 2
    cut = int(np.abs(places - middle / (len(path.nodes) - 1)).argmin())
    one = _run(path, (first, middle), places[: cut + 1], limits)
    other = _run(path, (middle, last), places[cut:], limits)
    return np.concatenate([one[:-1], other])


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
    problem = _problem()
    speeds = problem.SpeedLimits(speed * unit_s / unit_rad)
    accelerations = problem.AccelerationLimits(gain * unit_s**2 / unit_rad)
    geometry = _Geometry(slopes / unit_rad, bends / unit_rad)
    run = problem.FastestRun(speeds, accelerations, geometry, grid)
    run.compute_parameterization(0.0, 0.0)
    rates = run.problem_data.sd_vec
    if rates is None or not bool(np.isfinite(rates).all() and (rates[1:-1] > 0).all()):
        return None
    return np.asarray(rates) / unit_s


@cache
def _problem() -> Any:
    """Return what builds toppra's problems; toppra leaves out what only draws and interpolates.

    It is kept quiet: a run that it does not find is looked for in parts.
    """
    with warnings.catch_warnings(), _without(_UNUSED):
        # Of docstrings with escapes that Python does not know, where it was not compiled before.
        warnings.simplefilter("ignore")
        from skillplan_pinocchio.timing import toppra_problem
    logging.getLogger("toppra").setLevel(logging.CRITICAL)
    return toppra_problem


@contextmanager
def _without(unused: Mapping[str, tuple[str, ...]]) -> Iterator[None]:
    """Import what imports modules for parts of it that nobody asks for, and leave these alone.

    They take several times as long as all the rest, and drawing fails where the environment names
    a backend that is none.
    """
    absent = {name: names for name, names in unused.items() if name not in sys.modules}
    for name, names in absent.items():
        sys.modules[name] = ModuleType(name)
        vars(sys.modules[name]).update(dict.fromkeys(names))
    try:
        yield
    finally:
        for name in absent:
            del sys.modules[name]


def _peaks(path: JointPath, places: Array, rates: Array) -> tuple[Array, Array]:
    """Return the greatest speed and acceleration of every joint in each interval of a run.

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
    return np.max(speeds, axis=0), np.max(gains, axis=0)
