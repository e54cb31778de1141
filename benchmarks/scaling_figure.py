"""The picture of scaling: time to proof over the size of boards, and above it the gap at the limit.

A line that leaves the lower part of a panel through the top, the time limit, goes on in the upper
part: from there on nothing is proved in time, and what counts is how small the gap is.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator
from PIL import Image
from scaling_results import Showing, Size

from skillplan.views.figures.figure_file import render_figure
from skillplan.views.figures.figure_style import (
    BLUE,
    FAINT,
    GREEN,
    GREY,
    INK,
    MUTED,
    ORANGE,
    SMALL_PT,
    Heading,
    add_axes_in,
    create_sheet,
    darken_colour,
    in_house_style,
)

# Name, colour and marker of a solver: distinct without colour, too.
LOOKS = {
    "exhaustive": ("brute force", GREY, "s"),
    "exact": ("exact", ORANGE, "^"),
    "auto": ("auto", BLUE, "o"),
    "cp-sat": ("cp-sat", GREEN, "D"),
}
OTHER = (INK, "v")
COUNTS = {1: "one", 2: "two", 3: "three"}
LEFT_IN, WIDE_IN, BETWEEN_IN, RIGHT_IN = 0.75, 2.65, 1.6, 1.2
TIMES_IN, GAPS_IN, SEAM_IN, BELOW_IN, ROW_IN = 1.35, 1.2, 0.07, 0.55, 0.46
LABEL_PT = SMALL_PT
LEAST_S = 0.003
# Gaps are drawn from here [%]; what is smaller stands at the edge.
LEAST_GAP = 0.01
NO_PLAN_AT = 250.0
DPI = 150
COLOURS = 96


@in_house_style
def scaling_figure(
    found: Mapping[Size, Mapping[str, Showing]],
    solvers: Sequence[str],
    limit_s: float,
    seeds: int,
    by_cpu: bool,
) -> Figure:
    """Draw a panel for every density and number of tools.

    Parameters
    ----------
    found
        What the solvers made of each size.
    solvers
        In which order they are drawn, the last on top.
    limit_s
        The time limit [s].
    seeds
        How many boards of each size there are.
    by_cpu
        Whether times are those that processes computed.
    """
    densities = sorted({size.density for size in found})
    tools = sorted({size.tools for size in found})
    parts = sorted({size.parts for size in found})
    clock = "s of CPU time" if by_cpu else "s"
    boards = "one board of each size" if seeds == 1 else f"medians over {seeds} boards of each size"
    heading = Heading(
        "Time to a proven optimum, and the gap where there is no proof in time",
        f"Generated boards, {boards}; every solver has {limit_s:g} {clock} on one core. "
        "Filled: proved. Open: gap at the limit. Crosses: no plan at all.",
    )
    width_in = LEFT_IN + len(tools) * (WIDE_IN + BETWEEN_IN) - BETWEEN_IN + RIGHT_IN
    panel_in = TIMES_IN + SEAM_IN + GAPS_IN + ROW_IN
    head_in = heading.height_in(width_in - 0.4)
    height_in = head_in + len(densities) * panel_in + BELOW_IN
    figure = create_sheet(width_in, height_in, heading)
    for row, density in enumerate(densities):
        bottom_in = BELOW_IN + (len(densities) - 1 - row) * panel_in
        for column, count in enumerate(tools):
            left_in = LEFT_IN + column * (WIDE_IN + BETWEEN_IN)
            times = add_axes_in(figure, left_in, bottom_in, WIDE_IN, TIMES_IN)
            above_in = bottom_in + TIMES_IN + SEAM_IN
            gaps = add_axes_in(figure, left_in, above_in, WIDE_IN, GAPS_IN)
            _lay_out(times, gaps, parts, limit_s)
            gaps.set_title(
                f"{COUNTS.get(count, count)} tool{'s' * (count > 1)}, "
                f"{100 * density:g} % of the pairs ordered",
                loc="left",
                pad=5,
            )
            if column == 0:
                times.set_ylabel("time to proof")
                gaps.set_ylabel("gap")
            if row == len(densities) - 1:
                times.set_xlabel("parts")
            mine = {
                size.parts: found[size]
                for size in sorted(found, key=lambda size: size.parts)
                if (size.density, size.tools) == (density, count)
            }
            labels: dict[Axes, list[tuple[float, str, str]]] = {times: [], gaps: []}
            for layer, solver in enumerate(solvers):
                line = {n: showings[solver] for n, showings in mine.items() if solver in showings}
                if line:
                    _draw(times, gaps, solver, line, layer, labels)
            _label(times, labels[times], TIMES_IN)
            _label(gaps, labels[gaps], GAPS_IN)
    return figure


def _lay_out(times: Axes, gaps: Axes, parts: Sequence[int], limit_s: float) -> None:
    for axes in (times, gaps):
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlim(parts[0] / 1.15, parts[-1] * 1.15)
        axes.xaxis.set_minor_locator(NullLocator())
        axes.yaxis.set_minor_locator(NullLocator())
        axes.xaxis.set_major_locator(FixedLocator([float(n) for n in parts]))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.0f}"))
        axes.grid(which="major")
        axes.spines[["top", "right"]].set_visible(False)
    times.set_ylim(LEAST_S, limit_s * 1.06)
    ticks_s = [tick for tick in (0.01, 0.1, 1.0, 10.0, 100.0) if tick < limit_s]
    times.yaxis.set_major_locator(FixedLocator([*ticks_s, limit_s]))
    times.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g} s"))
    times.axhline(limit_s, color=MUTED, linewidth=1.0, zorder=1)
    gaps.set_ylim(LEAST_GAP / 1.25, NO_PLAN_AT * 1.5)
    gaps.yaxis.set_major_locator(FixedLocator([0.01, 0.1, 1.0, 10.0, 100.0]))
    gaps.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g} %"))
    gaps.tick_params(axis="x", length=0, labelbottom=False)
    gaps.spines["bottom"].set_color(FAINT)


def _draw(
    times: Axes,
    gaps: Axes,
    solver: str,
    line: Mapping[int, Showing],
    layer: int,
    labels: dict[Axes, list[tuple[float, str, str]]],
) -> None:
    name, colour, marker = LOOKS.get(solver, (solver, *OTHER))
    style: dict[str, Any] = {"color": colour, "linewidth": 1.3, "zorder": 3 + layer}
    dashes = {**style, "linestyle": (0, (3, 1.5))}
    for (n, one), (m, other) in pairwise(sorted(line.items())):
        pair = (one.taken_s is not None, other.taken_s is not None)
        if all(pair):
            times.plot([n, m], [_level_s(one), _level_s(other)], **style)
        elif not any(pair):
            gaps.plot([n, m], [_height(one), _height(other)], **dashes)
        else:
            # Out of the one part, into the other.
            halfway, top_s, floor = (n * m) ** 0.5, times.get_ylim()[1], gaps.get_ylim()[0]
            (low_n, low), (high_n, high) = ((n, one), (m, other))[:: 1 if pair[0] else -1]
            times.plot([low_n, halfway], [_level_s(low), top_s], **dashes)
            gaps.plot([halfway, high_n], [floor, _height(high)], **dashes)
    for n, one in line.items():
        if one.taken_s is not None:
            times.plot([n], [_level_s(one)], marker=marker, markersize=4.5, **style)
            continue
        gaps.plot(
            [n],
            [_height(one)],
            marker="x" if one.gap is None else marker,
            markersize=5,
            markerfacecolor="white",
            markeredgewidth=1.2,
            linestyle="none",
            clip_on=False,
            **{**style, "zorder": 6 + layer},
        )
    n, end = max(line.items())
    ink = darken_colour(colour)
    if end.taken_s is not None:
        labels[times].append((_level_s(end), f"{name} {end.cell()}", ink))
    elif end.gap is None:
        labels[gaps].append((NO_PLAN_AT, f"{name}: no plan", ink))
    else:
        labels[gaps].append((_height(end), f"{name} {end.cell()}", ink))


def _level_s(showing: Showing) -> float:
    """Return where a time to proof is drawn [s]."""
    return max(LEAST_S, showing.taken_s or 0.0)


def _height(showing: Showing) -> float:
    """Return where a gap is drawn [%]."""
    return NO_PLAN_AT if showing.gap is None else max(LEAST_GAP, 100 * showing.gap)


def _label(axes: Axes, wanted: Sequence[tuple[float, str, str]], tall_in: float) -> None:
    """Write at the right end of lines what they are, one above the other."""
    to_paper = axes.transData + axes.transAxes.inverted()
    step = 1.35 * LABEL_PT / 72 / tall_in
    heights = sorted(
        (float(to_paper.transform((1.0, value))[1]), text, ink) for value, text, ink in wanted
    )
    placed: list[float] = []
    for height, _, _ in heights:
        placed.append(height if not placed else max(height, placed[-1] + step))
    # What was pushed out at the top goes down again, and what is below with it.
    ceiling = 1.04
    for index in reversed(range(len(placed))):
        placed[index] = min(placed[index], ceiling)
        ceiling = placed[index] - step
    for y, (_, text, ink) in zip(placed, heights, strict=True):
        axes.text(1.03, y, text, transform=axes.transAxes, size=LABEL_PT, color=ink, va="center")


def save(
    found: Mapping[Size, Mapping[str, Showing]],
    solvers: Sequence[str],
    limit_s: float,
    seeds: int,
    by_cpu: bool,
    path: Path,
) -> None:
    """Draw to a PNG or SVG file, a PNG with few colours, as it is kept with the source.

    Parameters
    ----------
    found, solvers, limit_s, seeds, by_cpu
        As for `scaling_figure`.
    path
        Of the file.
    """
    content = render_figure(
        scaling_figure(found, solvers, limit_s, seeds, by_cpu), path.suffix, DPI
    )
    if path.suffix == ".png":
        packed = io.BytesIO()
        image = Image.open(io.BytesIO(content)).convert("RGB").quantize(COLOURS)
        image.save(packed, "PNG", optimize=True)
        content = packed.getvalue()
    path.write_bytes(content)
