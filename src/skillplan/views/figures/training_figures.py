"""Figures of training runs: success rate and cost against environment steps or episodes.

Moller et al., Fig. 7 and 8, sections 5.1 and 5.2.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, MaxNLocator
from numpy.typing import NDArray

from skillplan.task.task import Metric
from skillplan.views.figures import figure_style as style

if TYPE_CHECKING:  # a figure needs no environment
    from skillplan.solvers.learning.learner import Episode

WINDOW = 100
"""Number of episodes that a smoothed curve averages over: Moller et al., section 5.1."""
AxisName = Literal["steps", "episodes"]
AXES: tuple[AxisName, ...] = ("steps", "episodes")
"""Quantities on the x axis. Runs of equal length end at the same step."""
Numbers = NDArray[np.float64]

_LEFT_IN, _WIDE_IN, _RIGHT_IN = 0.75, 6.4, 0.35
_POINTS = 600
# Points closer than this share of an axis are drawn once.
_CELLS_X, _CELLS_Y = 400, 240
_DASHES: tuple[Any, ...] = ("-", (0, (4, 1.5)), (0, (1.2, 1.2)), (0, (6, 1.5, 1.2, 1.5)))


@dataclass(frozen=True)
class RunCurve:
    """The episodes of a run, in order.

    Parameters
    ----------
    done
        Environment steps of the run, >= 0.
    ends
        Step at which each episode ended, ascending, shape (n,).
    success
        True for each episode that completed the task, shape (n,).
    costs
        Cost of each episode in the task's metric, shape (n,).

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
        """Return the length of the run in steps or episodes."""
        return self.done if against == "steps" else len(self.ends)

    def success_rate(self, at: Numbers, against: AxisName) -> Numbers:
        """Return the share of successes among the last `WINDOW` episodes.

        Parameters
        ----------
        at
            Steps or episodes, shape (m,).

        Returns
        -------
        ndarray
            In [0, 1], shape (m,); NaN before the first episode and after the end of the run.
        """
        if against == "steps":
            counts = np.searchsorted(self.ends, at, side="right")
        else:
            counts = np.minimum(at, len(self.ends)).astype(np.int64)
        rates = _average_trailing(self.success.astype(np.float64), counts)
        rates[at > self.length(against)] = np.nan
        return rates

    def successes(self, against: AxisName) -> tuple[Numbers, Numbers, Numbers]:
        """Return the completed episodes.

        Returns
        -------
        tuple
            Steps or episodes from 1, costs, and costs averaged over the last `WINDOW` successes,
            each of shape (successes,).
        """
        places = self.ends if against == "steps" else np.arange(1, len(self.ends) + 1)
        costs = self.costs[self.success]
        smooth = _average_trailing(costs, np.arange(1, len(costs) + 1))
        return places[self.success].astype(np.float64), costs, smooth


def run_curve(run: int, seed: int, episodes: Sequence[Episode], done: int) -> RunCurve:
    """Return the curve of a run that has done a number of environment steps."""
    return RunCurve(
        f"run {run}, seed {seed}",
        max(done, episodes[-1].step if episodes else 0),
        np.array([episode.step for episode in episodes], dtype=np.int64),
        np.array([episode.success for episode in episodes], dtype=np.bool_),
        np.array([episode.cost for episode in episodes], dtype=np.float64),
    )


def _average_trailing(values: Numbers, counts: NDArray[np.int64]) -> Numbers:
    """Return the mean of the last `WINDOW` of the first `counts` values; NaN if there are none."""
    sums = np.concatenate([[0.0], np.cumsum(values)])
    first = np.maximum(counts - WINDOW, 0)
    taken = (counts - first).astype(np.float64)
    means = np.full(len(counts), np.nan)
    np.divide(sums[counts] - sums[first], taken, out=means, where=taken > 0)
    return means


def average_runs(
    curves: Sequence[RunCurve], at: Numbers, against: AxisName
) -> tuple[Numbers, Numbers, Numbers]:
    """Return the success rates of all runs, and their mean and standard deviation.

    Returns
    -------
    tuple
        Shapes (runs, m), (m,) and (m,). Mean and deviation cover the runs that have begun and not
        ended; they are NaN if there is no such run.
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


@style.in_house_style
def draw_success(
    curves: Sequence[RunCurve],
    heading: style.Heading,
    *,
    against: AxisName = "steps",
    published: float | None = None,
) -> Figure:
    """Draw the share of successes among the last 100 episodes: mean and deviation over runs.

    Parameters
    ----------
    against
        Quantity on the x axis. The paper uses episodes; a run that fails early has more of them.
    published
        Published success rate, in [0, 1]; None if the task is not the paper's.

    Raises
    ------
    ValueError
        If no run has ended an episode.
    """
    furthest = _find_furthest(curves, against)
    several = len(curves) > 1
    labels = [f"mean of {len(curves)} runs", "± standard deviation", "single runs"]
    labels = labels if several else ["success rate"]
    figure, axes, columns = _open_axes(heading, labels, 3.4, against, furthest)
    at = _sample_axis(furthest)
    rates, mean, spread = average_runs(curves, at, against)
    if several:
        low, high = np.clip(mean - spread, 0, 1), np.clip(mean + spread, 0, 1)
        axes.plot(at, 100 * rates.T, color=style.BLUE, alpha=0.4, linewidth=0.7, zorder=2)
        axes.fill_between(
            at, 100 * low, 100 * high, color=style.BLUE, alpha=0.18, linewidth=0, label=labels[1]
        )
        axes.lines[0].set_label(labels[2])
    line = axes.plot(at, 100 * mean, color=style.BLUE, linewidth=1.8, label=labels[0], zorder=4)[0]
    line.set_gid("mean")
    _label_success(axes)
    axes.set_yticks(range(0, 101, 20))
    if several:
        _mark_first_end(axes, curves, against, furthest)
    if published is not None:
        _draw_published(axes, published)
    handles, names = axes.get_legend_handles_labels()
    by_name = dict(zip(names, handles, strict=True))
    _add_legend(figure, [(by_name[label], label) for label in labels if label in by_name], columns)
    return figure


def _mark_first_end(
    axes: Axes, curves: Sequence[RunCurve], against: AxisName, furthest: int
) -> None:
    """Mark the end of the shortest run: from there on the mean covers fewer runs."""
    first = min(curve.length(against) for curve in curves)
    if first >= 0.99 * furthest:
        return
    axes.axvline(first, color=style.MUTED, linewidth=0.8, linestyle=(0, (4, 2)), zorder=1)
    right = first < 0.7 * furthest
    axes.annotate(
        "beyond, of the runs that went on",
        (first, 1.0),
        xycoords=axes.get_xaxis_transform(),
        xytext=(4 if right else -4, 2),
        textcoords="offset points",
        ha="left" if right else "right",
        va="bottom",
        size=style.SMALL_PT - 0.5,
        color=style.MUTED,
    )


def _draw_published(axes: Axes, published: float) -> None:
    axes.axhline(100 * published, color=style.RED, linewidth=0.9, linestyle=(0, (5, 2)), zorder=3)
    axes.annotate(
        f"Moller et al.: about {100 * published:.0f} %",
        (1.0, 100 * published),
        xycoords=axes.get_yaxis_transform(),
        xytext=(-4, 3),
        textcoords="offset points",
        ha="right",
        va="bottom",
        size=style.SMALL_PT,
        color=style.INK,
        bbox={"facecolor": "white", "alpha": 0.75, "pad": 0.8, "edgecolor": "none"},
        zorder=5,
    ).set_gid("published")


@style.in_house_style
def draw_distances(
    curves: Sequence[RunCurve],
    metric: Metric,
    heading: style.Heading,
    *,
    against: AxisName = "steps",
    optimum: float | None = None,
    chance: bool = False,
) -> Figure:
    """Draw the cost of every completed episode as points, and the mean of the last 100 as a line.

    Parameters
    ----------
    curves
        One curve for every run. Each has its own colour, from the ninth on also its own dash.
    optimum
        Proved optimum, drawn as a line; None if none is proved.
    chance
        True if the optimum is an expected cost, which a single episode may undercut.

    Raises
    ------
    ValueError
        If no run has completed the task.
    """
    if not any(curve.success.any() for curve in curves):
        raise ValueError("No completed sequence to draw.")
    furthest = max(curve.length(against) for curve in curves)
    labels = [curve.label if curve.success.any() else f"{curve.label}: none" for curve in curves]
    figure, axes, columns = _open_axes(heading, labels, 3.8, against, furthest)
    low, high = _find_cost_range(curves, optimum)
    entries = []
    for number, (curve, label) in enumerate(zip(curves, labels, strict=True)):
        colour = style.PALETTE[number % len(style.PALETTE)]
        dashes = _DASHES[number // len(style.PALETTE) % len(_DASHES)]
        entries.append((Line2D([], [], color=colour, linestyle=dashes), label))
        places, costs, smooth = curve.successes(against)
        x, y = _thin_out(places, costs, furthest, high - low)
        axes.plot(x, y, ".", color=colour, markersize=4.5, markeredgewidth=0, alpha=0.6, zorder=2)
        line = axes.plot(places, smooth, color=colour, linestyle=dashes, linewidth=1.2, zorder=3)
        line[0].set_gid(f"smoothed {label}")
    axes.set_ylim(low, high)
    _label_costs(axes, metric)
    if optimum is not None:
        _draw_optimum(axes, optimum)
        axes.annotate(
            f"{'least expected' if chance else 'proved optimum'} {metric.text(optimum)}",
            (1.0, optimum),
            xycoords=axes.get_yaxis_transform(),
            xytext=(-2, -3),
            textcoords="offset points",
            ha="right",
            va="top",
            size=style.SMALL_PT,
            color=style.INK,
        )
    _add_legend(figure, entries, columns)
    return figure


def _find_cost_range(curves: Sequence[RunCurve], optimum: float | None) -> tuple[float, float]:
    """Return the ends of the cost axis, with room below for the name of the optimum."""
    costs = np.concatenate([curve.costs[curve.success] for curve in curves])
    low = min(float(costs.min()), float(costs.min()) if optimum is None else optimum)
    high = float(costs.max())
    room = (high - low) or max(abs(high), 1.0) * 0.1
    return low - 0.09 * room, high + 0.04 * room


def _thin_out(
    places: Numbers, costs: Numbers, furthest: int, height: float
) -> tuple[Numbers, Numbers]:
    """Return the points that do not cover each other."""
    cells = np.stack(
        [np.floor(places / furthest * _CELLS_X), np.floor(costs / height * _CELLS_Y)], axis=1
    )
    _, first = np.unique(cells, axis=0, return_index=True)
    first.sort()
    return places[first], costs[first]


Trainings = Mapping[str, Sequence[RunCurve]]
"""The curves of the runs of several trainings, by legend entry."""


@style.in_house_style
def draw_success_of_trainings(
    trainings: Trainings, heading: style.Heading, *, against: AxisName = "steps"
) -> Figure:
    """Draw the mean success rate of each training in a band of one standard deviation.

    Raises
    ------
    ValueError
        If no run has ended an episode.
    """
    figure, axes, furthest = _open_trainings(trainings, heading, against)
    at = _sample_axis(furthest)
    for (label, curves), colour in zip(trainings.items(), _assign_colours(trainings), strict=True):
        _, mean, spread = average_runs(curves, at, against)
        low, high = np.clip(mean - spread, 0, 1), np.clip(mean + spread, 0, 1)
        axes.fill_between(at, 100 * low, 100 * high, color=colour, alpha=0.18, linewidth=0)
        line = axes.plot(at, 100 * mean, color=colour, linewidth=1.8, label=label, zorder=4)[0]
        line.set_gid(f"mean {label}")
    _label_success(axes)
    return figure


@style.in_house_style
def draw_distances_of_trainings(
    trainings: Trainings,
    metric: Metric,
    heading: style.Heading,
    *,
    against: AxisName = "steps",
    optimum: float | None = None,
) -> Figure:
    """Draw the cost of completed episodes, averaged over the last 100, for each run.

    Parameters
    ----------
    optimum
        Proved optimum, drawn as a line; None if none is proved.

    Raises
    ------
    ValueError
        If no run has completed the task.
    """
    if not any(curve.success.any() for curves in trainings.values() for curve in curves):
        raise ValueError("No completed sequence to draw.")
    figure, axes, _ = _open_trainings(trainings, heading, against)
    for (label, curves), colour in zip(trainings.items(), _assign_colours(trainings), strict=True):
        for number, curve in enumerate(curves):
            x, _, smooth = curve.successes(against)
            line = axes.plot(x, smooth, color=colour, linewidth=1.1, alpha=0.8, zorder=3)[0]
            line.set_gid(f"smoothed {label}, run {number}")
    if optimum is not None:
        _draw_optimum(axes, optimum)
    _label_costs(axes, metric)
    return figure


def _assign_colours(trainings: Trainings) -> list[str]:
    return [style.PALETTE[number % len(style.PALETTE)] for number in range(len(trainings))]


def _open_trainings(
    trainings: Trainings, heading: style.Heading, against: AxisName
) -> tuple[Figure, Axes, int]:
    """Return a sheet with axes and a legend of all trainings, and the length of the x axis."""
    furthest = _find_furthest([curve for runs in trainings.values() for curve in runs], against)
    figure, axes, columns = _open_axes(heading, list(trainings), 3.6, against, furthest)
    entries = [
        (Line2D([], [], color=colour, linewidth=1.8), label)
        for label, colour in zip(trainings, _assign_colours(trainings), strict=True)
    ]
    _add_legend(figure, entries, columns)
    return figure, axes, furthest


def _find_furthest(curves: Sequence[RunCurve], against: AxisName) -> int:
    """Return the length of the longest run; some run must have ended an episode."""
    if not any(len(curve.ends) for curve in curves):
        raise ValueError("No episode to draw.")
    return max(curve.length(against) for curve in curves)


def _sample_axis(furthest: int) -> Numbers:
    return np.unique(np.linspace(1, furthest, min(furthest, _POINTS)).round())


def _open_axes(
    heading: style.Heading, labels: list[str], tall_in: float, against: AxisName, furthest: int
) -> tuple[Figure, Axes, int]:
    """Return a sheet, its axes, and the number of columns of the legend that fits below them."""
    width_in = _LEFT_IN + _WIDE_IN + _RIGHT_IN
    columns, legend_in = style.fit_legend(labels, width_in - 0.5)
    bottom_in = 0.55 + legend_in
    height_in = heading.height_in(width_in - 0.4) + 0.1 + tall_in + bottom_in
    figure = style.create_sheet(width_in, height_in, heading)
    axes = style.add_axes_in(figure, _LEFT_IN, bottom_in, _WIDE_IN, tall_in)
    thousands: Callable[[float, int | None], str] = lambda value, _: f"{value:,.0f}"  # noqa: E731
    axes.set_xlim(0, furthest)
    axes.xaxis.set_major_locator(MaxNLocator(6, integer=True))
    axes.xaxis.set_major_formatter(FuncFormatter(thousands))
    axes.set_xlabel("environment step [-]" if against == "steps" else "episode [-]")
    axes.grid(which="major")
    axes.spines[["top", "right"]].set_visible(False)
    return figure, axes, columns


def _add_legend(figure: Figure, entries: Sequence[tuple[Any, str]], columns: int) -> None:
    width_in, height_in = figure.get_size_inches()
    figure.legend(
        [handle for handle, _ in entries],
        [label for _, label in entries],
        loc="lower left",
        bbox_to_anchor=(0.15 / width_in, 0.05 / height_in),
        ncols=columns,
        borderaxespad=0.0,
    )


def _label_success(axes: Axes) -> None:
    axes.set_ylim(-2, 102)
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.0f} %"))
    axes.set_ylabel("success of the last 100 episodes")


def _label_costs(axes: Axes, metric: Metric) -> None:
    axes.set_ylabel(
        metric.heading.replace(metric.name, f"{metric.name} of a completed sequence", 1)
    )


def _draw_optimum(axes: Axes, optimum: float) -> None:
    line = axes.axhline(optimum, color=style.INK, linewidth=1.0, linestyle=(0, (5, 2)), zorder=4)
    line.set_gid("optimum")
