"""Success, optimality and learning time of a parameter study, with a panel for every option.

Veeramani and Muthuswamy 2022, Fig. 6.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator, NullLocator
from matplotlib.transforms import ScaledTranslation

from skillplan.errors import OptionError
from skillplan.records.interval import Estimate
from skillplan.records.sweep.plan import (
    GRID,
    ONE_AT_A_TIME,
    SAMPLED,
    Axis,
    format_setting,
    format_value,
    is_same,
)
from skillplan.records.sweep.result import StartSummary, SweepResult
from skillplan.views.figures import figure_style as style

_GREEK = {
    "gamma": "\N{GREEK SMALL LETTER GAMMA}",
    "alpha": "\N{GREEK SMALL LETTER ALPHA}",
    "epsilon": "\N{GREEK SMALL LETTER EPSILON}",
}
_MARKERS = "osD^vP*X"
_MOST_STARTS, _MOST_AXES = len(_MARKERS), 6
# Smallest ratio of the ends of a logarithmic axis.
_WIDE = 30.0
# Largest number of values on a linear axis that are labelled one by one.
_FEW = 5
_TALL_IN, _WIDE_IN, _LEFT_IN, _GAP_IN = 1.5, 3.1, 0.8, 0.3
_SIDE_PT = 2.6


@dataclass(frozen=True, slots=True)
class _Row:
    """A row of panels: a figure of each start, or of all starts together."""

    label: str
    figure: Callable[[StartSummary], Estimate | None]
    percent: bool = False
    together: bool = False


@style.in_house_style
def draw_sweep(result: SweepResult) -> Figure:
    """Draw a study: shares and times by start, against the values of every option.

    Points of different starts stand side by side; bars are 95 % intervals. With the design
    ``grid``, a point is the mean of all settings with its value. If a sampler chose the settings,
    a point is a trial, without bars.

    Raises
    ------
    OptionError
        If no options or too many vary, or there are too many starts.
    """
    plan = result.plan
    if not 1 <= len(plan.axes) <= _MOST_AXES:
        raise OptionError(
            f"A figure shows 1 to {_MOST_AXES} options that vary, not {len(plan.axes)}."
        )
    if len(plan.starts) > _MOST_STARTS:
        raise OptionError(f"A figure shows up to {_MOST_STARTS} starts, not {len(plan.starts)}.")
    rows = _list_rows(result)
    columns = len(plan.axes)
    width_in = max(
        style.LEAST_WIDTH_IN, _LEFT_IN + columns * _WIDE_IN + (columns - 1) * _GAP_IN + 0.25
    )
    wide_in = (width_in - _LEFT_IN - 0.25 - (columns - 1) * _GAP_IN) / columns
    labels = [_start_label(result, name) for name in (start.name for start in plan.starts)]
    legend_cols, legend_in = style.fit_legend(labels, width_in - 0.4)
    heading = style.Heading(
        f"Effect of the options of {plan.solver} on {plan.name}", _describe(result)
    )
    head_in = heading.height_in(width_in - 0.4)
    bottom_in = 0.5 + legend_in
    height_in = head_in - 0.1 + len(rows) * (_TALL_IN + 0.2) + bottom_in
    figure = style.create_sheet(width_in, height_in, heading)
    for r, row in enumerate(rows):
        first: Axes | None = None
        floor_in = bottom_in + (len(rows) - 1 - r) * (_TALL_IN + 0.2)
        for c, axis in enumerate(plan.axes):
            axes = style.add_axes_in(
                figure, _LEFT_IN + c * (wide_in + _GAP_IN), floor_in, wide_in, _TALL_IN
            )
            if first is None:
                first = axes
                axes.set_ylabel(row.label)
            else:
                axes.sharey(first)
                axes.tick_params(axis="y", labelleft=False)
            _lay_out(axes, result, axis, row, wide_in, last=r == len(rows) - 1)
            _draw(figure, axes, result, axis, row)
            if r == len(rows) - 1:
                axes.set_xlabel(_name(axis.option))
    figure.legend(
        [
            Line2D([], [], color=style.PALETTE[number], marker=_MARKERS[number], markersize=3.2)
            for number in range(len(labels))
        ],
        labels,
        loc="lower left",
        bbox_to_anchor=(0.15 / width_in, 0.06 / height_in),
        ncols=legend_cols,
        borderaxespad=0.0,
    )
    return figure


def _list_rows(result: SweepResult) -> list[_Row]:
    known = all(start.optimum is not None for start in result.plan.starts)
    rows = [_Row("arrive [%]", attrgetter("arrived_share"), percent=True)]
    if known:
        rows.append(_Row("arrive at the\noptimum [%]", attrgetter("best_share"), percent=True))
    if result.plan.design == SAMPLED:
        rows.append(_Row("steps", attrgetter("steps")))
        if known:
            unit = f" [{result.plan.cost_unit}]" if result.plan.cost_unit else ""
            rows.append(_Row(f"cost above the\noptimum{unit}", attrgetter("excess")))
    rows.append(_Row("learning [s]", attrgetter("learning_s"), together=result.shared))
    return rows


def _draw(figure: Figure, axes: Axes, result: SweepResult, axis: Axis, row: _Row) -> None:
    plan = result.plan
    places = _find_places(axis)
    along = plan.settings_along(axis)
    names = _list_names(result, row)
    for number, name in enumerate(names):
        points = [
            (place, estimate)
            for place, settings in zip(places, along, strict=True)
            if (estimate := row.figure(result.summary(settings, name))) is not None
        ]
        if not points:
            continue
        # Side by side, as many points of different starts coincide.
        side_in = (number - (len(names) - 1) / 2) * _SIDE_PT / 72
        shift = ScaledTranslation(side_in, 0, figure.dpi_scale_trans)
        factor = 100.0 if row.percent else 1.0
        values = [factor * estimate.value for _, estimate in points]
        colour = style.INK if name is None else style.PALETTE[number]
        bars = [
            [factor * (estimate.value - _or(estimate.low, estimate)) for _, estimate in points],
            [factor * (_or(estimate.high, estimate) - estimate.value) for _, estimate in points],
        ]
        sampled = plan.design == SAMPLED
        axes.errorbar(
            [place for place, _ in points],
            values,
            yerr=None if sampled else bars,
            color=colour,
            marker=_MARKERS[number],
            markersize=3.2,
            linewidth=0.9 if axis.numeric and not sampled else 0.0,
            elinewidth=0.7,
            transform=axes.transData + shift,
        )
    if plan.design == ONE_AT_A_TIME:
        centre = next(
            (
                place
                for place, value in zip(places, axis.values, strict=True)
                if is_same(value, plan.centre[axis.option])
            ),
            None,
        )
        if centre is not None:
            axes.axvline(centre, color=style.MUTED, linewidth=0.8, linestyle=(0, (1, 2)), zorder=0)


def _or(end: float | None, estimate: Estimate) -> float:
    return estimate.value if end is None else end


def _list_names(result: SweepResult, row: _Row) -> list[str | None]:
    return [None] if row.together else [start.name for start in result.plan.starts]


def _lay_out(
    axes: Axes, result: SweepResult, axis: Axis, row: _Row, wide_in: float, *, last: bool
) -> None:
    places = _find_places(axis)
    if _is_logarithmic(axis):
        axes.set_xscale("log")
        low, high = min(places), max(places)
        margin = (high / low) ** 0.06
        axes.set_xlim(low / margin, high * margin)
    else:
        margin = 0.06 * (max(places) - min(places)) or 0.5
        axes.set_xlim(min(places) - margin, max(places) + margin)
    if result.plan.design == SAMPLED and axis.numeric:
        _set_sampled_ticks(axes, axis, wide_in)
    elif _is_logarithmic(axis) or not axis.numeric or len(places) <= _FEW:
        shown = _select_labels(axis, wide_in)
        texts = {places[index]: format_value(axis.values[index]) for index in shown}
        axes.xaxis.set_major_locator(FixedLocator(sorted(texts)))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: _find_text(texts, value)))
    else:
        axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.tick_params(axis="x", labelbottom=last)
    if row.percent:
        axes.set_ylim(-6, 106)
        axes.yaxis.set_major_locator(FixedLocator([0, 25, 50, 75, 100]))
    else:
        _scale_times(axes, result, row)
    axes.grid(axis="y")
    axes.spines[["top", "right"]].set_visible(False)


def _set_sampled_ticks(axes: Axes, axis: Axis, wide_in: float) -> None:
    """Label round values, as sampled values are not round."""
    if not _is_logarithmic(axis):
        axes.xaxis.set_major_locator(MaxNLocator(5, integer=_is_whole(axis)))
        return
    low, high = axes.get_xlim()
    powers = [10.0**n for n in range(math.ceil(math.log10(low)), math.ceil(math.log10(high)))]
    axes.xaxis.set_major_locator(FixedLocator(powers[:: 1 + len(powers) // int(3 * wide_in)]))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def _is_whole(axis: Axis) -> bool:
    return all(isinstance(value, int) for value in axis.values)


def _scale_times(axes: Axes, result: SweepResult, row: _Row) -> None:
    """Give all panels of a row the same axis, logarithmic if values differ much."""
    estimates = [
        estimate
        for axis in result.plan.axes
        for settings in result.plan.settings_along(axis)
        for name in _list_names(result, row)
        if (estimate := row.figure(result.summary(settings, name))) is not None
    ]
    values = [estimate.value for estimate in estimates]
    highest = max((_or(estimate.high, estimate) for estimate in estimates), default=1.0) or 1.0
    if values and 0 < _WIDE * min(values) <= max(values):
        axes.set_yscale("log", nonpositive="clip")
        axes.set_ylim(min(values) / 2, 1.5 * highest)
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.yaxis.set_minor_locator(NullLocator())
    else:
        # A margin below keeps points at 0 whole.
        axes.set_ylim(-0.05 * highest if 0.0 in values else 0.0, 1.08 * highest)


def _find_places(axis: Axis) -> list[float]:
    """Return the places of the values on the axis; words stand at 0, 1, 2, ..."""
    if axis.numeric:
        return [float(value) for value in axis.values if value is not None]
    return [float(index) for index in range(len(axis.values))]


def _is_logarithmic(axis: Axis) -> bool:
    places = _find_places(axis)
    return axis.numeric and min(places) > 0 and max(places) >= _WIDE * min(places)


def _select_labels(axis: Axis, wide_in: float) -> list[int]:
    """Return the values whose labels do not overlap; the ends come first."""
    places = (
        [math.log(place) for place in _find_places(axis)]
        if _is_logarithmic(axis)
        else _find_places(axis)
    )
    low, high = min(places), max(places)
    scale_in = wide_in / 1.12 / ((high - low) or 1.0)
    order = sorted(range(len(places)), key=lambda i: (places[i] not in (low, high), i))
    kept: list[int] = []
    for index in order:
        half_in = style.measure_text_in(format_value(axis.values[index]), style.SMALL_PT) / 2
        if all(
            abs(places[index] - places[other]) * scale_in
            > half_in
            + style.measure_text_in(format_value(axis.values[other]), style.SMALL_PT) / 2
            + 0.09
            for other in kept
        ):
            kept.append(index)
    return kept


def _find_text(texts: dict[float, str], value: float) -> str:
    return next(
        (text for place, text in texts.items() if abs(place - value) <= 1e-9 * abs(place)), ""
    )


def _start_label(result: SweepResult, name: str) -> str:
    optimum = next(start.optimum for start in result.plan.starts if start.name == name)
    if optimum is None:
        return f"from {name}"
    return f"from {name} ({f'optimum {optimum:.6g} {result.plan.cost_unit}'.rstrip()})"


def _name(option: str) -> str:
    return f"{option} {_GREEK[option]}" if option in _GREEK else option


def _describe(result: SweepResult) -> str:
    plan = result.plan
    seeds: Sequence[int] = plan.seeds
    parts = [f"{len(seeds)} runs each, seeds {seeds[0]} to {seeds[-1]}"]
    if plan.design == GRID:
        parts.append("all combinations; a point is the mean of all settings of its value")
    elif plan.design == SAMPLED:
        parts.append(f"a point is one of {len(plan.settings)} trials with any other options")
    else:
        parts.append(f"others at the centre (dotted): {format_setting(plan.centre)}")
    if plan.design != SAMPLED:
        parts.append("bars are 95 % intervals")
    if result.missing or result.failed:
        parts.append(f"{result.missing} runs missing, {len(result.failed)} failed")
    return ",  ".join(parts)
