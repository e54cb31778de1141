"""Several trainings in one figure: a colour and an entry of the legend for each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter

from skillplan.task.task import Metric
from skillplan.views.figures.colours import INK, PALETTE
from skillplan.views.figures.figure_style import (
    Heading,
    axes_in,
    in_house_style,
    legend_columns,
    sheet,
)
from skillplan.views.figures.training.run_curve import (
    AxisName,
    RunCurve,
    label_axis,
    over_runs,
)

Trainings = Mapping[str, Sequence[RunCurve]]
_LEFT_IN, _WIDE_IN, _TALL_IN, _RIGHT_IN = 0.75, 6.4, 3.6, 0.35
_POINTS = 600


@in_house_style
def success_of_trainings(
    trainings: Trainings, heading: Heading, *, against: AxisName = "steps"
) -> Figure:
    """Draw the mean success of each training's runs, in a band of one standard deviation.

    Parameters
    ----------
    trainings
        What the legend says of a training, to the curves of its runs; at least one has ended an
        episode.
    heading
        What stands above.
    against
        What the rates are drawn against.

    Raises
    ------
    ValueError
        If no run has ended an episode.
    """
    figure, axes, furthest = _sheet(trainings, heading, against)
    at = np.unique(np.linspace(1, furthest, min(furthest, _POINTS)).round())
    for (label, curves), colour in zip(trainings.items(), _colours(trainings), strict=True):
        _, mean, spread = over_runs(curves, at, against)
        low, high = np.clip(mean - spread, 0, 1), np.clip(mean + spread, 0, 1)
        axes.fill_between(at, 100 * low, 100 * high, color=colour, alpha=0.18, linewidth=0)
        line = axes.plot(at, 100 * mean, color=colour, linewidth=1.8, label=label, zorder=4)[0]
        line.set_gid(f"mean {label}")
    axes.set_ylim(-2, 102)
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.0f} %"))
    axes.set_ylabel("success of the last 100 episodes")
    return figure


@in_house_style
def distances_of_trainings(
    trainings: Trainings,
    metric: Metric,
    heading: Heading,
    *,
    against: AxisName = "steps",
    optimum: float | None = None,
) -> Figure:
    """Draw what completed sequences cost: of each run the mean of the last 100.

    Parameters
    ----------
    trainings
        What the legend says of a training, to the curves of its runs; at least one has completed
        the task.
    metric
        What costs are.
    heading
        What stands above.
    against
        What costs are drawn against.
    optimum
        The proved optimum, drawn as a line; None where none is proved.

    Raises
    ------
    ValueError
        If no run has completed the task.
    """
    if not any(curve.success.any() for curves in trainings.values() for curve in curves):
        raise ValueError("There is no completed sequence to draw.")
    figure, axes, _ = _sheet(trainings, heading, against)
    for (label, curves), colour in zip(trainings.items(), _colours(trainings), strict=True):
        for place, curve in enumerate(curves):
            x, _, smooth = curve.successes(against)
            line = axes.plot(x, smooth, color=colour, linewidth=1.1, alpha=0.8, zorder=3)[0]
            line.set_gid(f"smoothed {label}, run {place}")
    if optimum is not None:
        axes.axhline(optimum, color=INK, linewidth=1.0, linestyle=(0, (5, 2)), zorder=4).set_gid(
            "optimum"
        )
    axes.set_ylabel(
        metric.heading.replace(metric.name, f"{metric.name} of a completed sequence", 1)
    )
    return figure


def _colours(trainings: Trainings) -> list[str]:
    return [PALETTE[number % len(PALETTE)] for number in range(len(trainings))]


def _sheet(trainings: Trainings, heading: Heading, against: AxisName) -> tuple[Figure, Axes, int]:
    """Return a sheet with axes and a legend of all trainings, and how far the furthest has got."""
    every = [curve for curves in trainings.values() for curve in curves]
    if not any(len(curve.ends) for curve in every):
        raise ValueError("There is no episode to draw.")
    furthest = max(curve.length(against) for curve in every)
    width_in = _LEFT_IN + _WIDE_IN + _RIGHT_IN
    columns, legend_in = legend_columns(list(trainings), width_in - 0.4)
    bottom_in = 0.55 + legend_in
    height_in = heading.height_in(width_in - 0.4) + 0.1 + _TALL_IN + bottom_in
    figure = sheet(width_in, height_in, heading)
    axes = axes_in(figure, _LEFT_IN, bottom_in, _WIDE_IN, _TALL_IN)
    label_axis(axes, against, furthest)
    axes.grid(which="major")
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(
        handles=[
            Line2D([], [], color=colour, linewidth=1.8, label=label)
            for label, colour in zip(trainings, _colours(trainings), strict=True)
        ],
        loc="lower left",
        bbox_to_anchor=(0.15 / width_in, 0.05 / height_in),
        ncols=columns,
        borderaxespad=0.0,
    )
    return figure, axes, furthest
