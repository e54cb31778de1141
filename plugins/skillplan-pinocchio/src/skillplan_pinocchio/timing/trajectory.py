"""The fastest trajectory along a joint path, from rest to rest within joint limits, by toppra.

toppra optimises the speed of the path's parameter on a grid. The grid is refined until the limits
nearly hold between its places, too; the rest is removed by slowing down the whole run. So the
limits hold everywhere, not only at samples.
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
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from skillplan.robots.arm_description import ArmDescription
from skillplan_pinocchio.kinematics.joint_path import Array, JointPath

if TYPE_CHECKING:
    from skillplan_pinocchio.timing.slow_zones import RateLimits, SlowZones

# Intervals that lose more than this share of a run's time are split into `_PARTS`.
_LOST: Final = 0.0002
_PARTS: Final = 8

# Modules, and names in them, that toppra imports only for plots, its own splines and another linear
# solver.
_UNUSED: Final = {
    "scipy": (),
    "matplotlib": (),
    "matplotlib.pyplot": (),
    "scipy.interpolate": ("BPoly", "CubicSpline", "PPoly", "UnivariateSpline"),
    "scipy.sparse": (),
}


@dataclass(frozen=True, slots=True, eq=False)
class GridRun:
    """A run on a grid, and its quality.

    Parameters
    ----------
    rates
        Rates of the parameter at the places.
    excess
        Factor by which a limit is exceeded between two places; at most 1 if none is.
    lost
        Share of its time that the run loses to the grid, by interval. The rate changes evenly
        between two places; if little acceleration is used, it could reach the faster end's rate
        sooner.
    """

    places: Array
    rates: Array
    excess: float
    lost: Array

    @classmethod
    def on(
        cls,
        path: JointPath,
        places: Array,
        limits: tuple[Array, Array],
        limit_rates: RateLimits | None = None,
    ) -> GridRun:
        """Return the run on a grid with a place at every node."""
        speed, gain = limits
        most = None if limit_rates is None else limit_rates(places)
        rates = _run(path, (0, len(path.nodes) - 1), places, limits, most)
        fastest, hardest = _find_peaks(path, places, rates)
        used = (hardest / gain).max(axis=1)
        excess = max(float((fastest / speed).max()), math.sqrt(float(used.max())))
        steps_s = _compute_steps_s(places, rates)
        fastest_s = np.diff(places) / np.maximum(rates[1:], rates[:-1])
        lost = (steps_s - fastest_s) * np.maximum(1 - used, 0.0) / steps_s.sum()
        return cls(places, rates, excess, lost)

    @property
    def duration_s(self) -> float:
        """Duration within the limits [s]."""
        return float(_compute_steps_s(self.places, self.rates).sum()) * max(self.excess, 1.0)

    @property
    def finer(self) -> Array:
        """A grid with more places where the run could be faster."""
        begins, steps = self.places[:-1], np.diff(self.places)
        parts = np.where(self.lost > _LOST, _PARTS, 1)
        number = np.concatenate([np.arange(count) for count in parts.tolist()])
        inner = np.repeat(begins, parts) + number * np.repeat(steps / parts, parts)
        return np.append(inner, self.places[-1])


def _compute_steps_s(places: Array, rates: Array) -> Array:
    """Return the durations between neighbouring places [s]."""
    return np.asarray(2 * np.diff(places) / (rates[1:] + rates[:-1]))


def _run(
    path: JointPath,
    nodes: tuple[int, int],
    places: Array,
    limits: tuple[Array, Array],
    most: Array | None,
) -> Array:
    """Return the rates of the parameter at places, of which each node is one.

    Parameters
    ----------
    nodes
        Numbers of the first and last node.
    most
        Greatest rates there; None for no limit.
    """
    first, last = nodes
    span = places[-1] - places[0]
    slopes, bends = path.derivatives(places)
    grid = (places - places[0]) / span
    within = None if most is None else most / span
    rates = _compute_rates(slopes * span, bends * span**2, grid, limits, within)
    if rates is not None:
        return np.asarray(rates * span)
    if last - first == 1:
        raise ArithmeticError("toppra found no run between two nodes of a path of the joints")
    middle = (first + last) // 2
    cut = int(np.abs(places - middle / (len(path.nodes) - 1)).argmin())
    before, after = (None, None) if most is None else (most[: cut + 1], most[cut:])
    begin = _run(path, (first, middle), places[: cut + 1], limits, before)
    end = _run(path, (middle, last), places[cut:], limits, after)
    return np.concatenate([begin[:-1], end])


@dataclass(frozen=True, slots=True, eq=False)
class _Geometry:
    """Derivatives of a path at the places of a grid, in toppra's interface."""

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


def _compute_rates(
    slopes: Array, bends: Array, grid: Array, limits: tuple[Array, Array], most: Array | None
) -> Array | None:
    """Return the rates of the parameter on a grid from 0 to 1, or None if toppra fails."""
    speed, gain = limits
    steepest, sharpest = np.abs(slopes).max(axis=0), np.abs(bends).max(axis=0)
    # In these units of time and of each joint's angle, toppra's coefficients are at most 1 for any
    # path: its tolerances are absolute.
    unit_s = max(
        float((steepest / speed).max()),
        math.sqrt(float((np.maximum(steepest, sharpest) / gain).max())),
    )
    unit_rad = np.maximum(np.maximum(steepest, sharpest), 1e-6 * gain * unit_s**2)
    problem = _import_problem()
    within = None if most is None else most * unit_s
    speeds = problem.SpeedLimits(speed * unit_s / unit_rad, within)
    accelerations = problem.AccelerationLimits(gain * unit_s**2 / unit_rad)
    geometry = _Geometry(slopes / unit_rad, bends / unit_rad)
    run = problem.FastestRun(speeds, accelerations, geometry, grid)
    run.compute_parameterization(0.0, 0.0)
    rates = run.problem_data.sd_vec
    if rates is None or not bool(np.isfinite(rates).all() and (rates[1:-1] > 0).all()):
        return None
    return np.asarray(rates) / unit_s


@cache
def _import_problem() -> Any:
    """Import the builder of toppra's problems, without toppra's plotting and splines.

    Its log is silenced: a run that toppra does not find is searched in parts.
    """
    with warnings.catch_warnings(), _hide_modules(_UNUSED):
        # Its docstrings have invalid escapes.
        warnings.simplefilter("ignore")
        from skillplan_pinocchio.timing import toppra_problem
    logging.getLogger("toppra").setLevel(logging.CRITICAL)
    return toppra_problem


@contextmanager
def _hide_modules(unused: Mapping[str, tuple[str, ...]]) -> Iterator[None]:
    """Replace unused modules by empty ones during an import.

    They take several times as long as the rest, and matplotlib fails if the environment names an
    unknown backend.
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


def _find_peaks(path: JointPath, places: Array, rates: Array) -> tuple[Array, Array]:
    """Return the maximum speed and acceleration of every joint in each interval of a run.

    At a distance d into an interval a joint's slope is quadratic in d, its bend and the squared
    rate are linear. So its acceleration is quadratic, and its speed has an extremum where that is
    0.
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
        candidates = [-once / (2 * twice), larger / twice, none / larger]
    # Without such an extremum another place is evaluated, which does no harm.
    candidates += [np.zeros_like(none), np.broadcast_to(length, none.shape)]
    distances = [np.clip(np.nan_to_num(d, posinf=0.0, neginf=0.0), 0.0, length) for d in candidates]
    squares = [np.maximum(start + 2 * gain * d, 0.0) for d in distances]
    speeds = [
        np.abs(slope + (bend + turn * d / 2) * d) * np.sqrt(square)
        for d, square in zip(distances, squares, strict=True)
    ]
    gains = [np.abs(none + (once + twice * d) * d) for d in distances]
    return np.max(speeds, axis=0), np.max(gains, axis=0)


# Intervals of a grid, and minimum between two nodes; grids are refined until a run exceeds the
# limits by at most this factor.
_GRIDS: Final = (64, 128, 256, 512, 1024)
_FEWEST: Final = 8
_EXCESS: Final = 1.001
# Loss of a run above which its grid is split, and maximum number of splits.
_MOST_LOST_SHARE: Final = 0.005
_SPLITS: Final = 4


@dataclass(frozen=True, slots=True)
class JointLimits:
    """Speed and acceleration limits of joints.

    Parameters
    ----------
    speed_rad_per_s, acceleration_rad_per_s2
        Limits of every joint, each > 0; shape (joints,).

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
        """Return a fraction in (0, 1] of the limits."""
        return JointLimits(
            tuple(fraction * value for value in self.speed_rad_per_s),
            tuple(fraction * value for value in self.acceleration_rad_per_s2),
        )

    def stretched(self, factor: float) -> JointLimits:
        """Return the limits whose runs take `factor` times as long, > 0."""
        return JointLimits(
            tuple(value / factor for value in self.speed_rad_per_s),
            tuple(value / factor**2 for value in self.acceleration_rad_per_s2),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """A path with its timing.

    Parameters
    ----------
    places
        Increasing path parameters from 0 to 1; a single one if the path has no length.
    rates_per_s
        Rates of the parameter there, 0 at both ends; between two places the rate changes evenly in
        time.
    times_s
        Times at the places, from 0 on.
    """

    path: JointPath
    places: Array
    rates_per_s: Array
    times_s: Array

    @property
    def duration_s(self) -> float:
        """Duration from rest to rest [s]; 0 if the path has no length."""
        return float(self.times_s[-1])

    def at(self, time_s: float) -> tuple[Array, Array, Array]:
        """Return joint angles [rad], speeds [rad/s] and accelerations [rad/s^2] at a time.

        Parameters
        ----------
        time_s
            Time in [0, `duration_s`].

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


def find_fastest_trajectory(
    path: JointPath, limits: JointLimits, slow_zones: SlowZones | None = None
) -> Trajectory:
    """Return the fastest run along a path within limits.

    A straight path has a closed form. On a path too uneven for toppra, the run stops at the middle
    node.

    Parameters
    ----------
    slow_zones
        Zones with a limit on the speed of the tool's tip, which the run keeps within 1 %.

    Raises
    ------
    ArithmeticError
        If toppra finds no run between two nodes either.
    """
    # Rounding errors of a joint at rest do not count as motion.
    if float(path.steepest.max()) <= 1e-9:
        return Trajectory(path, np.zeros(1), np.zeros(1), np.zeros(1))
    speed, gain = np.array(limits.speed_rad_per_s), np.array(limits.acceleration_rad_per_s2)
    limit_rates = None if slow_zones is None else slow_zones.limit(path)
    if len(path.nodes) == 2 and limit_rates is None:
        return _time_straight_path(path, speed, gain)
    knots = len(path.nodes) - 1
    for intervals in _GRIDS:
        count = knots * max(math.ceil(intervals / knots), _FEWEST)
        run = GridRun.on(path, np.arange(count + 1) / count, (speed, gain), limit_rates)
        if run.excess <= _EXCESS:
            break
    for _ in range(_SPLITS):
        if float(run.lost.sum()) <= _MOST_LOST_SHARE:
            break
        finer = _split(path, run, (speed, gain), limit_rates)
        if finer.duration_s >= run.duration_s:
            break
        run = finer
    rates = run.rates / max(run.excess, 1.0)
    steps_s = 2 * np.diff(run.places) / (rates[1:] + rates[:-1])
    times_s = np.concatenate([np.zeros(1), np.cumsum(steps_s)])
    return Trajectory(path, run.places, rates, times_s)


def _split(
    path: JointPath, run: GridRun, limits: tuple[Array, Array], limit_rates: RateLimits | None
) -> GridRun:
    """Return the run on a finer grid, or the same run if toppra finds none."""
    try:
        return GridRun.on(path, run.finer, limits, limit_rates)
    except ArithmeticError:
        return run


def _time_straight_path(path: JointPath, speed: Array, gain: Array) -> Trajectory:
    """Return the fastest run along a straight path: accelerate, coast, decelerate."""
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
