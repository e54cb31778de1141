"""Figures of repeated runs, each with the interval in which its true value lies 95 times of 100."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

# Two-sided, 95 %.
_TAIL = 0.975
_NORMAL = statistics.NormalDist().inv_cdf(_TAIL)
# Number of resamples of a bootstrap; more of them change no printed digit.
_RESAMPLES = 10_000
# Fewest runs whose mean gets an interval.
_FEWEST = 3


@dataclass(frozen=True, slots=True)
class Estimate:
    """A figure and its 95 % interval.

    Parameters
    ----------
    low, high
        The interval; None if there are too few runs.

    Raises
    ------
    ValueError
        If the figure lies outside the interval.
    """

    value: float
    low: float | None = None
    high: float | None = None

    def __post_init__(self) -> None:
        if (self.low is None) != (self.high is None):
            raise ValueError("An interval has two ends.")
        if self.low is not None and self.high is not None:
            slack = 1e-9 * max(1.0, abs(self.value))
            if not self.low - slack <= self.value <= self.high + slack:
                raise ValueError(f"{self.value} lies outside [{self.low}, {self.high}].")

    def document(self) -> dict[str, Any]:
        """Return the figure as JSON values."""
        ends = None if self.low is None else [self.low, self.high]
        return {"value": self.value, "ci95": ends}


def share(count: int, total: int) -> Estimate | None:
    """Return a share with its interval after Wilson (1927); None for a total of 0.

    Unlike the textbook's interval it does not shrink to a point if all or none count.

    Parameters
    ----------
    count, total
        Numerator and denominator, 0 <= count <= total.

    Raises
    ------
    ValueError
        If the count is out of range.
    """
    if not 0 <= count <= total:
        raise ValueError(f"A share of {count} of {total} makes no sense.")
    if total == 0:
        return None
    fraction, z2 = count / total, _NORMAL**2
    middle = (fraction + z2 / (2 * total)) / (1 + z2 / total)
    spread = fraction * (1 - fraction) / total + z2 / (4 * total**2)
    half = _NORMAL / (1 + z2 / total) * math.sqrt(spread)
    low = 0.0 if count == 0 else middle - half
    high = 1.0 if count == total else middle + half
    return Estimate(fraction, low, high)


def mean(values: Sequence[float]) -> Estimate | None:
    """Return a mean with Student's t interval over independent runs; None without runs.

    One or two runs give no interval: over two it would be 9 times the distance between them.
    """
    if not values:
        return None
    value = math.fsum(values) / len(values)
    if len(values) < _FEWEST:
        return Estimate(value)
    half = t_quantile(len(values) - 1) * statistics.stdev(values) / math.sqrt(len(values))
    return Estimate(value, value - half, value + half)


def interquartile_mean(values: Sequence[float]) -> Estimate | None:
    """Return the mean of the middle half of independent runs, with its bootstrap interval.

    A quarter of the runs, rounded down, is left out at either end, so that one run that went
    astray does not decide; Agarwal et al., "Deep reinforcement learning at the edge of the
    statistical precipice" (2021). The interval holds the middle 95 % of the figures of resampled
    runs, always the same resamples. One or two runs give no interval.
    """
    if not values:
        return None
    # Imported here because most figures need no arrays.
    import numpy as np

    count = len(values)
    cut = count // 4
    runs = np.sort(np.asarray(values, dtype=np.float64))
    value = float(runs[cut : count - cut].mean())
    if count < _FEWEST:
        return Estimate(value)
    draws = np.random.Generator(np.random.PCG64(count)).integers(count, size=(_RESAMPLES, count))
    middles = np.sort(runs[draws], axis=1)[:, cut : count - cut].mean(axis=1)
    low, high = np.quantile(middles, [1 - _TAIL, _TAIL])
    # With few runs the interval of resamples may miss the figure itself.
    return Estimate(value, min(float(low), value), max(float(high), value))


def t_quantile(freedom: int) -> float:
    """Return the 97.5 % quantile of Student's t distribution.

    Parameters
    ----------
    freedom
        Degrees of freedom, >= 1.

    Raises
    ------
    ValueError
        If there are none.
    """
    if freedom < 1:
        raise ValueError(f"Degrees of freedom must be >= 1, not {freedom}.")
    if freedom > 1_000:
        # Cornish and Fisher's first correction is exact to six digits here.
        return _NORMAL + (_NORMAL**3 + _NORMAL) / (4 * freedom)
    low, high = _NORMAL, 13.0
    while high - low > 1e-12 * high:
        middle = (low + high) / 2
        if _t_within(middle, freedom) < 2 * _TAIL - 1:
            low = middle
        else:
            high = middle
    return high


def _t_within(t: float, freedom: int) -> float:
    """Return the probability of [-t, t]: Abramowitz and Stegun, 26.7.3 and 26.7.4."""
    angle = math.atan(t / math.sqrt(freedom))
    sine, square = math.sin(angle), math.cos(angle) ** 2
    odd = freedom % 2
    term = math.cos(angle) if odd else 1.0
    total = term if freedom > 1 else 0.0
    for k in range(2 + odd, freedom - 1, 2):
        term *= square * (k - 1) / k
        total += term
    return 2 / math.pi * (angle + sine * total) if odd else sine * total
