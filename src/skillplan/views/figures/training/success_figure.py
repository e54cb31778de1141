"""How often training completes the task: mean and standard deviation over runs.

Moller et al., Fig. 7 and section 5.1.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from skillplan.views.figures.colours import BLUE, INK, MUTED, RED
from skillplan.views.figures.figure_style import (
    SMALL_PT,
    Heading,
    axes_in,
    in_house_style,
    legend_columns,
    sheet,
)
from skillplan.views.figures.training.run_curve import AxisName, RunCurve, label_axis, over_runs

_LEFT_IN, _WIDE_IN, _TALL_IN, _RIGHT_IN = 0.75, 6.4, 3.4, 0.35
_POINTS = 600


@in_house_style
def success_figure(
    curves: Sequence[RunCurve],
    heading: Heading,
    *,
    against: AxisName = "steps",
    published: float | None = None,
) -> Figure:
    """Draw the share of successes among the last 100 episodes.

    Parameters
    ----------
    curves
        One for every run.
    heading
        What stands above.
    against
        What the rates are drawn against: environment steps, of which all runs do as many, or
        episodes, as in the paper, of which a run that fails early does more.
    published
        What the paper reports, in [0, 1]; None for another task than the paper's.

    Raises
    ------
    ValueError
        If no run has ended an episode.
    """
    furthest = max((curve.length(against) for curve in curves), default=0)
    if not any(len(curve.ends) for curve in curves):
        raise ValueError("There is no episode to draw.")
    several = len(curves) > 1
    labels = [f"mean of {len(curves)} runs", "± standard deviation", "single runs"]
    labels = labels if several else ["success rate"]
    width_in = _LEFT_IN + _WIDE_IN + _RIGHT_IN
    columns, legend_in = legend_columns(labels, width_in - 0.4)
    bottom_in = 0.55 + legend_in
    height_in = heading.height_in(width_in - 0.4) + 0.1 + _TALL_IN + bottom_in
    figure = sheet(width_in, height_in, heading)
    axes = axes_in(figure, _LEFT_IN, bottom_in, _WIDE_IN, _TALL_IN)
    at = np.unique(np.linspace(1, furthest, min(furthest, _POINTS)).round())
    rates, mean, spread = over_runs(curves, at, against)
    if several:
        low, high = np.clip(mean - spread, 0, 1), np.clip(mean + spread, 0, 1)
        axes.plot(at, 100 * rates.T, color=BLUE, alpha=0.4, linewidth=0.7, zorder=2)
        axes.fill_between(
            at, 100 * low, 100 * high, color=BLUE, alpha=0.18, linewidth=0, label=labels[1]
        )
        axes.lines[0].set_label(labels[2])
    line = axes.plot(at, 100 * mean, color=BLUE, linewidth=1.8, label=labels[0], zorder=4)[0]
    line.set_gid("mean")
    _lay_out(axes, against, furthest)
    if several:
        _mark_first_end(axes, curves, against, furthest)
    if published is not None:
        _draw_published(axes, published)
    handles, names = axes.get_legend_handles_labels()
    order = sorted(range(len(names)), key=lambda index: labels.index(names[index]))
    figure.legend(
        [handles[index] for index in order],
        [names[index] for index in order],
        loc="lower left",
        bbox_to_anchor=(0.15 / width_in, 0.05 / height_in),
        ncols=columns,
        borderaxespad=0.0,
    )
    return figure


def _lay_out(axes: Axes, against: AxisName, furthest: int) -> None:
    label_axis(axes, against, furthest)
    axes.set_ylim(-2, 102)
    axes.set_yticks(range(0, 101, 20))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.0f} %"))
    axes.set_ylabel("success of the last 100 episodes")
    axes.grid(which="major")
    axes.spines[["top", "right"]].set_visible(False)


def _mark_first_end(
    axes: Axes, curves: Sequence[RunCurve], against: AxisName, furthest: int
) -> None:
    """Mark where the mean begins to be of fewer runs than all."""
    first = min(curve.length(against) for curve in curves)
    if first >= 0.99 * furthest:
        return
    axes.axvline(first, color=MUTED, linewidth=0.8, linestyle=(0, (4, 2)), zorder=1)
    right = first < 0.7 * furthest
    axes.annotate(
        "beyond, of the runs that went on",
        (first, 1.0),
        xycoords=axes.get_xaxis_transform(),
        xytext=(4 if right else -4, 2),
        textcoords="offset points",
        ha="left" if right else "right",
        va="bottom",
        size=SMALL_PT - 0.5,
        color=MUTED,
    )


def _draw_published(axes: Axes, published: float) -> None:
    axes.axhline(100 * published, color=RED, linewidth=0.9, linestyle=(0, (5, 2)), zorder=3)
    axes.annotate(
        f"Moller et al.: about {100 * published:.0f} %",
        (1.0, 100 * published),
        xycoords=axes.get_yaxis_transform(),
        xytext=(-4, 3),
        textcoords="offset points",
        ha="right",
        va="bottom",
        size=SMALL_PT,
        color=INK,
        bbox={"facecolor": "white", "alpha": 0.75, "pad": 0.8, "edgecolor": "none"},
        zorder=5,
    ).set_gid("published")
