"""The episodes of a training run as a curve: against environment steps, or against episodes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, MaxNLocator
from numpy.typing import NDArray

if TYPE_CHECKING:  # a figure needs no environment
    from skillplan.solvers.learning.learner import Episode

WINDOW = 100
"""So many episodes a point of a smoothed curve is the mean of: Moller et al., section 5.1."""
AxisName = Literal["steps", "episodes"]
AXES: tuple[AxisName, ...] = ("steps", "episodes")
"""What a curve may be drawn against; runs of equal length end together on the first."""
Numbers = NDArray[np.float64]


@dataclass(frozen=True)
class RunCurve:
    """What became of the episodes of a run, in order.

    Parameters
    ----------
    label
        What the legend says of the run.
    done
        Environment steps that it has done, >= 0.
    ends
        After how many steps every episode ended, not descending, shape (n,).
    success
        Whether it completed the task, shape (n,).
    costs
        What it cost, in the task's metric, shape (n,).

    Raises
    ------
    ValueError
        If the shapes differ, or episodes end in another order or after the last step.
    """

    label: str
    done: int
    ends: NDArray[np.int64]
    success: NDArray[np.bool_]
    costs: Numbers

    def __post_init__(self) -> None:
        if not self.ends.shape == self.success.shape == self.costs.shape or self.ends.ndim != 1:
            raise ValueError(f"The curve of {self.label!r} has figures of unequal number.")
        if (np.diff(self.ends) < 0).any() or (len(self.ends) and self.ends[-1] > self.done):
            raise ValueError(f"Episodes of {self.label!r} must end one after another.")

    def length(self, against: AxisName) -> int:
        """Return how far the run has got, in steps or episodes."""
        return self.done if against == "steps" else len(self.ends)

    def success_rate(self, at: Numbers, against: AxisName) -> Numbers:
        """Return the share of successes among the last `WINDOW` episodes, or those there are.

        Parameters
        ----------
        at
            Steps or episodes, shape (m,).
        against
            Which of them.

        Returns
        -------
        ndarray
            In [0, 1], shape (m,); NaN before the first episode and beyond the run's end.
        """
        if against == "steps":
            counts = np.searchsorted(self.ends, at, side="right")
        else:
            counts = np.minimum(at, len(self.ends)).astype(np.int64)
        rates = _trailing_mean(self.success.astype(np.float64), counts)
        rates[at > self.length(against)] = np.nan
        return rates

    def successes(self, against: AxisName) -> tuple[Numbers, Numbers, Numbers]:
        """Return where tasks were completed, at what cost, and the mean of the last `WINDOW`.

        Returns
        -------
        tuple
            Steps or episodes from 1, costs, and smoothed costs, each of shape (successes,).
        """
        places = self.ends if against == "steps" else np.arange(1, len(self.ends) + 1)
        costs = self.costs[self.success]
        smooth = _trailing_mean(costs, np.arange(1, len(costs) + 1))
        return places[self.success].astype(np.float64), costs, smooth


def run_curve(run: int, seed: int, episodes: Sequence[Episode], done: int) -> RunCurve:
    """Return the curve of a run.

    Parameters
    ----------
    run, seed
        Its number and its seed, which the legend names.
    episodes
        In order.
    done
        Environment steps that it has done.
    """
    return RunCurve(
        f"run {run}, seed {seed}",
        max(done, episodes[-1].step if episodes else 0),
        np.array([episode.step for episode in episodes], dtype=np.int64),
        np.array([episode.success for episode in episodes], dtype=np.bool_),
        np.array([episode.cost for episode in episodes], dtype=np.float64),
    )


def _trailing_mean(values: Numbers, counts: NDArray[np.int64]) -> Numbers:
    """Return the mean of the last `WINDOW` among the first so many values; NaN of none."""
    sums = np.concatenate([[0.0], np.cumsum(values)])
    first = np.maximum(counts - WINDOW, 0)
    taken = (counts - first).astype(np.float64)
    means = np.full(len(counts), np.nan)
    np.divide(sums[counts] - sums[first], taken, out=means, where=taken > 0)
    return means


def over_runs(
    curves: Sequence[RunCurve], at: Numbers, against: AxisName
) -> tuple[Numbers, Numbers, Numbers]:
    """Return the success rates of all runs, and their mean and standard deviation.

    Returns
    -------
    tuple
        Shapes (runs, m), (m,) and (m,); of runs that have not begun or have ended already, the
        mean and the deviation take no account, and where there is none they are NaN.
    """
    rates = np.stack([curve.success_rate(at, against) for curve in curves])
    known = np.isfinite(rates)
    count = known.sum(axis=0)
    mean = np.full(len(at), np.nan)
    np.divide(np.where(known, rates, 0.0).sum(axis=0), count, out=mean, where=count > 0)
    square = np.where(known, (rates - mean) ** 2, 0.0).sum(axis=0)
    spread = np.full(len(at), np.nan)
    np.divide(square, count, out=spread, where=count > 0)
    return rates, mean, np.sqrt(spread)


def label_axis(axes: Axes, against: AxisName, furthest: int) -> None:
    """Lay out the axis of steps or episodes, from 0 to how far the furthest run has got."""
    thousands: Callable[[float, int | None], str] = lambda value, _: f"{value:,.0f}"  # noqa: E731
    axes.set_xlim(0, furthest)
    axes.xaxis.set_major_locator(MaxNLocator(6, integer=True))
    axes.xaxis.set_major_formatter(FuncFormatter(thousands))
    axes.set_xlabel("environment step [-]" if against == "steps" else "episode [-]")
