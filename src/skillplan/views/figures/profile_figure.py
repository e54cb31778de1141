"""Performance profiles of methods, and probabilities of improvement.

Agarwal et al., "Deep reinforcement learning at the edge of the statistical precipice" (2021),
Figs 6 and 9.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from skillplan.records.training.method_comparison import MethodComparison
from skillplan.views.figures import figure_style as style

_LEFT_IN, _WIDE_IN, _RIGHT_IN, _TALL_IN = 0.75, 6.4, 0.35, 3.2
_ROW_IN = 0.3
# Thresholds of a curve.
_POINTS = 601
# Begin of the axis if all complete runs score higher.
_LEAST = 0.9


@style.in_house_style
def draw_profile(comparison: MethodComparison, heading: style.Heading) -> Figure:
    """Draw the share of runs above each score, and below it the probabilities of improvement."""
    labels = [
        f"{method.name}, {method.runs} runs{', deterministic' if method.deterministic else ''}"
        for method in comparison.methods
    ]
    pairs = comparison.improvements
    width_in = _LEFT_IN + _WIDE_IN + _RIGHT_IN
    columns, legend_in = style.fit_legend(labels, width_in - 0.5)
    pairs_in = 0.75 + _ROW_IN * len(pairs) if pairs else 0.0
    bottom_in = 0.55 + legend_in + pairs_in
    height_in = heading.height_in(width_in - 0.4) + 0.1 + _TALL_IN + bottom_in
    figure = style.create_sheet(width_in, height_in, heading)
    axes = style.add_axes_in(figure, _LEFT_IN, bottom_in, _WIDE_IN, _TALL_IN)
    scores = [score for method in comparison.methods for runs in method.scores for score in runs]
    lowest = min((score for score in scores if score > 0), default=0.0)
    first = min(_LEAST, np.floor(lowest * 10) / 10)
    taus = np.linspace(first, 1.0, _POINTS)
    for place, (method, label) in enumerate(zip(comparison.methods, labels, strict=True)):
        colour = style.PALETTE[place % len(style.PALETTE)]
        profile = method.profile(tuple(taus.tolist()))
        if profile.low is not None and profile.high is not None:
            low, high = 100 * np.array(profile.low), 100 * np.array(profile.high)
            axes.fill_between(taus, low, high, color=colour, alpha=0.15, linewidth=0, step="post")
        shares = 100 * np.array(profile.shares)
        line = axes.step(taus, shares, where="post", color=colour, linewidth=1.8, label=label)[0]
        line.set_gid(f"profile {method.name}")
    _label_profiles(axes, first)
    if pairs:
        _draw_improvements(figure, comparison, legend_in)
    figure.legend(
        loc="lower left",
        bbox_to_anchor=(0.15 / width_in, 0.05 / height_in),
        ncols=columns,
        borderaxespad=0.0,
    )
    return figure


def _label_profiles(axes: Axes, first: float) -> None:
    axes.set_xlim(first, 1.0)
    axes.set_ylim(-2, 102)
    axes.set_yticks(range(0, 101, 20))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.0f} %"))
    axes.set_xlabel("score tau: optimum / cost, 0 if not complete [-]")
    axes.set_ylabel("runs that score above tau")
    axes.grid(which="major")
    axes.spines[["top", "right"]].set_visible(False)


def _draw_improvements(figure: Figure, comparison: MethodComparison, legend_in: float) -> None:
    """Draw a row for every pair: the probability and its interval."""
    pairs = comparison.improvements
    names_in = 2.6
    axes = style.add_axes_in(
        figure, _LEFT_IN + names_in, 0.55 + legend_in, _WIDE_IN - names_in, _ROW_IN * len(pairs)
    )
    for row, (first, second, estimate) in enumerate(pairs):
        if estimate.low is not None and estimate.high is not None:
            axes.plot([estimate.low, estimate.high], [row, row], color=style.MUTED, linewidth=3)
        axes.plot([estimate.value], [row], "o", color=style.INK, markersize=5)
        axes.annotate(
            f"P({first.name} > {second.name})  {estimate.value:.2f}",
            (0.0, row),
            xycoords=axes.get_yaxis_transform(),
            xytext=(-8, 0),
            textcoords="offset points",
            ha="right",
            va="center",
            size=style.SMALL_PT,
            color=style.INK,
        )
    axes.axvline(0.5, color=style.MUTED, linewidth=0.8, linestyle=(0, (4, 2)), zorder=1)
    axes.set_xlim(-0.02, 1.02)
    axes.set_ylim(len(pairs) - 0.5, -0.5)
    axes.set_yticks([])
    axes.set_xlabel("P(a run of the first scores above one of the second) [-]")
    axes.spines[["top", "right", "left"]].set_visible(False)
