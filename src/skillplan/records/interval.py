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
        The interval; None if there are too few runs, or runs are not samples.

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

    @property
    def bare(self) -> Estimate:
        """The figure without its interval, for runs that are not samples."""
        return Estimate(self.value)

    def document(self) -> dict[str, Any]:
        """Return the figure as JSON values."""
        ends = None if self.low is None else [self.low, self.high]
        return {"value": self.value, "ci95": ends}


def share(count: float, total: int) -> Estimate | None:
    """Return a share with its interval after Wilson (1927); None for a total of 0.

    Unlike the textbook's interval it does not shrink to a point if all or none count.

    Parameters
    ----------
    count, total
        Numerator and denominator, 0 <= count <= total. A sum of shares may stand for a count.

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
    return _with_quantiles(value, np.sort(runs[draws], axis=1)[:, cut : count - cut].mean(axis=1))


Strata = Sequence[Sequence[float]]
"""Scores of the runs of a method, one sequence for every task; higher is better."""


def stratified_iqm(strata: Strata) -> Estimate | None:
    """Return the interquartile mean of the scores of all runs on all tasks; None without runs.

    Agarwal et al. (2021), section 4: a quarter of all scores, rounded down, is left out at either
    end. The bootstrap draws runs within each task. Fewer than three runs give no interval.
    """
    if not any(len(scores) for scores in strata):
        return None
    import numpy as np

    pooled = np.sort(np.concatenate([np.asarray(scores, dtype=np.float64) for scores in strata]))
    cut = len(pooled) // 4
    value = float(pooled[cut : len(pooled) - cut].mean())
    if not _suffice(strata):
        return Estimate(value)
    middles = np.sort(np.hstack(_resample(strata)), axis=1)[:, cut : len(pooled) - cut]
    return _with_quantiles(value, middles.mean(axis=1))


@dataclass(frozen=True, slots=True)
class Profile:
    """Shares of runs whose score is above each threshold, with pointwise 95 % intervals.

    Parameters
    ----------
    thresholds
        Ascending scores tau.
    shares
        Share of the scores above each threshold, in [0, 1].
    low, high
        Ends of the intervals; None if there are too few runs.
    """

    thresholds: tuple[float, ...]
    shares: tuple[float, ...]
    low: tuple[float, ...] | None = None
    high: tuple[float, ...] | None = None

    def document(self) -> dict[str, Any]:
        """Return the profile as JSON values."""
        return {
            "tau": list(self.thresholds),
            "share": list(self.shares),
            "low": None if self.low is None else list(self.low),
            "high": None if self.high is None else list(self.high),
        }


def performance_profile(strata: Strata, thresholds: Sequence[float]) -> Profile:
    """Return the performance profile of a method: Agarwal et al. (2021), section 4.2.

    Parameters
    ----------
    strata
        At least one score.
    """
    import numpy as np

    taus = np.asarray(thresholds, dtype=np.float64)

    def shares_above(scores: Any) -> Any:
        ranked = np.sort(scores)
        return 1.0 - np.searchsorted(ranked, taus, side="right") / len(ranked)

    every = np.concatenate([np.asarray(scores, dtype=np.float64) for scores in strata])
    shares = tuple(shares_above(every).tolist())
    if not _suffice(strata):
        return Profile(tuple(thresholds), shares)
    # A tenth of the resamples draws the same band.
    draws = np.hstack(_resample(strata, _RESAMPLES // 10))
    low, high = np.quantile(np.apply_along_axis(shares_above, 1, draws), [1 - _TAIL, _TAIL], axis=0)
    return Profile(
        tuple(thresholds),
        shares,
        tuple(np.minimum(low, shares).tolist()),
        tuple(np.maximum(high, shares).tolist()),
    )


def probability_of_improvement(first: Strata, second: Strata) -> Estimate:
    """Return the probability that a run of the first method scores above one of the second.

    Agarwal et al. (2021), section 4.3: the mean over the tasks of the Mann-Whitney statistic; a
    tie counts half. The bootstrap draws the runs of both methods within each task.

    Parameters
    ----------
    first, second
        Scores on the same tasks in the same order, at least one for each.

    Raises
    ------
    ValueError
        If the tasks differ in number or have no runs.
    """
    if len(first) != len(second) or not all(map(len, (*first, *second))):
        raise ValueError("Both methods need runs on the same tasks.")
    import numpy as np

    def probabilities(ours: Any, theirs: Any) -> Any:
        above = (ours[..., :, None] > theirs[..., None, :]).mean(axis=(-2, -1))
        ties = (ours[..., :, None] == theirs[..., None, :]).mean(axis=(-2, -1))
        return above + ties / 2

    arrays = [
        (np.asarray(ours, dtype=np.float64), np.asarray(theirs, dtype=np.float64))
        for ours, theirs in zip(first, second, strict=True)
    ]
    value = float(np.mean([probabilities(*pair) for pair in arrays]))
    if not (_suffice(first) and _suffice(second)):
        return Estimate(value)
    draws = zip(
        _resample(first, _RESAMPLES // 10), _resample(second, _RESAMPLES // 10, 1), strict=True
    )
    return _with_quantiles(value, np.mean([probabilities(*pair) for pair in draws], axis=0))


def _suffice(strata: Strata) -> bool:
    """Return True if a bootstrap makes sense."""
    return sum(map(len, strata)) >= _FEWEST


def _resample(strata: Strata, count: int = _RESAMPLES, salt: int = 0) -> list[Any]:
    """Return resamples of the runs of every task, each of shape (count, runs)."""
    import numpy as np

    draws = []
    for place, scores in enumerate(strata):
        generator = np.random.Generator(np.random.PCG64((len(scores), place, salt)))
        runs = np.asarray(scores, dtype=np.float64)
        draws.append(runs[generator.integers(len(runs), size=(count, len(runs)))])
    return draws


def _with_quantiles(value: float, draws: Any) -> Estimate:
    import numpy as np

    low, high = np.quantile(draws, [1 - _TAIL, _TAIL])
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
