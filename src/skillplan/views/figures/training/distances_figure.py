"""What the completed sequences of every training run cost, beside the proved optimum.

Moller et al., Fig. 8 and section 5.2.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from skillplan.task.task import Metric
from skillplan.views.figures.colours import INK, PALETTE
from skillplan.views.figures.figure_style import (
    SMALL_PT,
    Heading,
    axes_in,
    in_house_style,
    legend_columns,
    sheet,
)
from skillplan.views.figures.training.run_curve import AxisName, Numbers, RunCurve, label_axis

_LEFT_IN, _WIDE_IN, _TALL_IN, _RIGHT_IN = 0.75, 6.4, 3.8, 0.35
# Points closer than this share of an axis are drawn once.
_CELLS_X, _CELLS_Y = 400, 240
_DASHES: tuple[Any, ...] = ("-", (0, (4, 1.5)), (0, (1.2, 1.2)), (0, (6, 1.5, 1.2, 1.5)))


@in_house_style
def distances_figure(
    curves: Sequence[RunCurve],
    metric: Metric,
    heading: Heading,
    *,
    against: AxisName = "steps",
    optimum: float | None = None,
    chance: bool = False,
) -> Figure:
    """Draw what every completed sequence cost: points, and a line of the mean of the last 100.

    Parameters
    ----------
    curves
        One for every run; each has a colour of its own, and from the ninth on a dash.
    metric
        What costs are.
    heading
        What stands above.
    against
        What costs are drawn against.
    optimum
        The proved optimum, drawn as a line; None where none is proved.
    chance
        Whether it is what the best policy costs on average, which a sequence may undercut.

    Raises
    ------
    ValueError
        If no run has completed the task.
    """
    if not any(curve.success.any() for curve in curves):
        raise ValueError("There is no completed sequence to draw.")
    furthest = max(curve.length(against) for curve in curves)
    labels = [_label(curve) for curve in curves]
    width_in = _LEFT_IN + _WIDE_IN + _RIGHT_IN
    columns, legend_in = legend_columns(labels, width_in - 0.5)
    bottom_in = 0.55 + legend_in
    height_in = heading.height_in(width_in - 0.4) + 0.1 + _TALL_IN + bottom_in
    figure = sheet(width_in, height_in, heading)
    axes = axes_in(figure, _LEFT_IN, bottom_in, _WIDE_IN, _TALL_IN)
    low, high = _range(curves, optimum)
    handles = []
    for number, (curve, label) in enumerate(zip(curves, labels, strict=True)):
        colour = PALETTE[number % len(PALETTE)]
        dashes = _DASHES[number // len(PALETTE) % len(_DASHES)]
        handles.append(Line2D([], [], color=colour, linestyle=dashes, label=label))
        places, costs, smooth = curve.successes(against)
        x, y = _thinned(places, costs, furthest, high - low)
        axes.plot(x, y, ".", color=colour, markersize=4.5, markeredgewidth=0, alpha=0.6, zorder=2)
        line = axes.plot(places, smooth, color=colour, linestyle=dashes, linewidth=1.2, zorder=3)
        line[0].set_gid(f"smoothed {label}")
    label_axis(axes, against, furthest)
    axes.set_ylim(low, high)
    axes.set_ylabel(
        metric.heading.replace(metric.name, f"{metric.name} of a completed sequence", 1)
    )
    axes.grid(which="major")
    axes.spines[["top", "right"]].set_visible(False)
    if optimum is not None:
        _draw_optimum(axes, optimum, metric, chance=chance)
    figure.legend(
        handles=handles,
        loc="lower left",
        bbox_to_anchor=(0.15 / width_in, 0.05 / height_in),
        ncols=columns,
        borderaxespad=0.0,
    )
    return figure


def _label(curve: RunCurve) -> str:
    return curve.label if curve.success.any() else f"{curve.label}: none"


def _range(curves: Sequence[RunCurve], optimum: float | None) -> tuple[float, float]:
    """Return the ends of the axis of costs, with room below for what the optimum is called."""
    costs = np.concatenate([curve.costs[curve.success] for curve in curves])
    least = min(float(costs.min()), float(costs.min()) if optimum is None else optimum)
    most = float(costs.max())
    room = (most - least) or max(abs(most), 1.0) * 0.1
    return least - 0.09 * room, most + 0.04 * room


def _thinned(
    places: Numbers, costs: Numbers, furthest: int, height: float
) -> tuple[Numbers, Numbers]:
    """Return the points without those that would fall onto another one."""
    cells = np.stack(
        [np.floor(places / furthest * _CELLS_X), np.floor(costs / height * _CELLS_Y)], axis=1
    )
    _, first = np.unique(cells, axis=0, return_index=True)
    first.sort()
    return places[first], costs[first]


def _draw_optimum(axes: Axes, optimum: float, metric: Metric, *, chance: bool) -> None:
    what = "least expected" if chance else "proved optimum"
    axes.axhline(optimum, color=INK, linewidth=1.0, linestyle=(0, (5, 2)), zorder=4).set_gid(
        "optimum"
    )
    axes.annotate(
        f"{what} {metric.text(optimum)}",
        (1.0, optimum),
        xycoords=axes.get_yaxis_transform(),
        xytext=(-2, -3),
        textcoords="offset points",
        ha="right",
        va="top",
        size=SMALL_PT,
        color=INK,
    )
