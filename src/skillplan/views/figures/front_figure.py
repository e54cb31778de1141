"""The Pareto front of two costs: a point for each plan, and the region that they dominate."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from matplotlib.figure import Figure

from skillplan.records.front import Front
from skillplan.views.figures import figure_style as style

_LEFT_IN, _WIDE_IN, _RIGHT_IN = 0.8, 5.4, 0.3
_TALL_IN, _BOTTOM_IN = 3.4, 0.6
# Margin around the points, as a share of their extent, and of a single value.
_MARGIN, _LONE_MARGIN = 0.15, 0.02


@style.in_house_style
def draw_front(
    points: Sequence[tuple[float, float, bool]], labels: tuple[str, str], heading: style.Heading
) -> Figure:
    """Draw the plans of a front, numbered in the order of the table.

    Parameters
    ----------
    points
        Both costs of each plan in ascending order of the first, and True if it is proved.
    labels
        Names of the costs with their units.
    """
    width_in = _LEFT_IN + _WIDE_IN + _RIGHT_IN
    height_in = heading.height_in(width_in - 0.4) + 0.1 + _TALL_IN + _BOTTOM_IN
    figure = style.create_sheet(width_in, height_in, heading)
    axes = style.add_axes_in(figure, _LEFT_IN, _BOTTOM_IN, _WIDE_IN, _TALL_IN)
    (left, right), (low, high) = (_find_limits([p[i] for p in points]) for i in (0, 1))
    axes.set_xlim(left, right)
    axes.set_ylim(low, high)
    if points:
        # Every plan is in the shaded region or on its edge.
        steps = [(points[0][0], high), (points[0][0], points[0][1])]
        for before, after in pairwise(points):
            steps += [(after[0], before[1]), (after[0], after[1])]
        steps.append((right, points[-1][1]))
        xs, ys = zip(*steps, strict=True)
        axes.fill_between(xs, ys, high, color=style.BLUE, alpha=0.08, linewidth=0)
        axes.plot(xs, ys, color=style.FAINT, linewidth=1.2)
    for number, (first, second, proved) in enumerate(points, start=1):
        face = style.BLUE if proved else style.PAPER
        axes.plot([first], [second], "o", color=style.BLUE, markerfacecolor=face, markersize=7)
        axes.annotate(
            str(number),
            (first, second),
            xytext=(6, 5),
            textcoords="offset points",
            size=style.SMALL_PT,
            color=style.INK,
        )
    axes.set_xlabel(labels[0])
    axes.set_ylabel(labels[1])
    axes.grid(which="major")
    axes.spines[["top", "right"]].set_visible(False)
    return figure


def draw_front_of(front: Front) -> Figure:
    """Draw a front under the names of its task and its back ends."""
    labels = [
        f"{name} [{metric.unit}]" if metric.unit else name
        for name, metric in zip(front.names, front.metrics, strict=True)
    ]
    details = f"{len(front.points)} points, proved by {', '.join(front.proved_by)}"
    heading = style.Heading(f"{front.task}: Pareto front", details)
    points = [(*point.costs, point.proved) for point in front.points]
    return draw_front(points, (labels[0], labels[1]), heading)


def _find_limits(values: Sequence[float]) -> tuple[float, float]:
    """Return the ends of an axis, with a margin."""
    if not values:
        return 0.0, 1.0
    low, high = min(values), max(values)
    margin = _MARGIN * (high - low) or _LONE_MARGIN * max(abs(high), 1e-9)
    return low - margin, high + margin
