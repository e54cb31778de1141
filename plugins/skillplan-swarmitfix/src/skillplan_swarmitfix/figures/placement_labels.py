"""Names of positions, goals and heads in a figure of placements, where they cover nothing."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from skillplan.views.figures.figure_style import INK, LEAST_PT, MUTED, text_colour
from skillplan.views.figures.label_placement import LabelPlacer
from skillplan_swarmitfix.figures.bench_canvas import BenchCanvas
from skillplan_swarmitfix.figures.placement_marks import (
    RADIUS,
    BaseGoal,
    HeadMark,
    Point2,
    colours_of,
    links_m,
    ranges_text,
)


def draw_labels(
    canvas: BenchCanvas,
    points_m: NDArray[np.float64],
    heads: Sequence[HeadMark],
    goals: Sequence[BaseGoal],
    visits: Mapping[int, Sequence[int]],
    between: Sequence[int],
    home: int | None,
) -> None:
    """Write names into the circles, and numbers beside them and beside the heads.

    Parameters
    ----------
    canvas
        Where everything else is drawn already.
    points_m
        Points of the trajectory [m], shape (n, 2).
    heads, goals
        The heads in order along the trajectory, and the goals.
    visits
        The numbers of the goals by position.
    between
        Positions that the base passes.
    home
        Where the base is at first; None if it is nowhere.
    """
    bench = canvas.bench
    name_pt, number_pt = canvas.font_pt(6.4, 8.0), canvas.font_pt(5.6, 7.0)
    if name_pt is None:
        return
    number_pt = number_pt or LEAST_PT
    placer = _placer(canvas, points_m, heads, goals)
    radius_in = RADIUS * canvas.pitch_in
    rings = sorted({*visits, *between, *(() if home is None else (home,))})
    centres = {position: canvas.to_inches(bench.centroids_m[position]) for position in rings}
    inside = {p for p in rings if placer.is_free(centres[p], bench.name(p), name_pt)}
    for position in rings:
        if position in inside:
            x_m, y_m = bench.centroids_m[position].tolist()
            _write(canvas, (x_m, y_m), bench.name(position), name_pt, INK, bold=True)
    for centre in centres.values():
        placer.avoid_disc(centre, radius_in + 0.02)
    beside_in = [radius_in + extra for extra in (0.04, 0.1, 0.18, 0.28)]
    for position in rings:
        if position not in inside:
            name = bench.name(position)
            place = placer.place(centres[position], name, name_pt, beside_in)
            _write(canvas, canvas.to_metres(place), name, name_pt, INK, bold=True)
    colours = colours_of(canvas.bench, goals)
    for position, numbers in sorted(visits.items()):
        text = f"b{ranges_text(numbers)}"
        place = placer.place(centres[position], text, number_pt, beside_in)
        _write(canvas, canvas.to_metres(place), text, number_pt, text_colour(colours[position]))
    if home is not None and home not in visits:
        place = placer.place(centres[home], "home", number_pt, beside_in)
        _write(canvas, canvas.to_metres(place), "home", number_pt, "#8a5a00")
    _number_heads(canvas, placer, np.mean(points_m, axis=0), heads, number_pt)


def _number_heads(
    canvas: BenchCanvas,
    placer: LabelPlacer,
    middle_m: NDArray[np.float64],
    heads: Sequence[HeadMark],
    size_pt: float,
) -> None:
    """Write the numbers of the heads, outside of the trajectory where there is room."""
    for number, head in enumerate(heads, start=1):
        beside_in = [_corner_in(canvas, head) + extra for extra in (0.03, 0.08, 0.15, 0.25)]
        outward = np.array(head.position_m) - middle_m
        angle_rad = math.atan2(outward[1], outward[0])
        anchor, text = canvas.to_inches(head.position_m), f"h{number}"
        place = placer.place(anchor, text, size_pt, beside_in, angle_rad)
        _write(canvas, canvas.to_metres(place), text, size_pt, MUTED)


def _placer(
    canvas: BenchCanvas,
    points_m: NDArray[np.float64],
    heads: Sequence[HeadMark],
    goals: Sequence[BaseGoal],
) -> LabelPlacer:
    """Return what keeps labels off the trajectory, the heads and the lines to them."""
    placer = LabelPlacer(*canvas.size_in)
    placer.avoid_line([canvas.to_inches(point) for point in points_m.tolist()])
    for link in links_m(canvas.bench, goals):
        placer.avoid_line([canvas.to_inches(end) for end in link])
    for head in heads:
        placer.avoid_disc(canvas.to_inches(head.position_m), _corner_in(canvas, head))
    return placer


def _corner_in(canvas: BenchCanvas, head: HeadMark) -> float:
    """Return how far the corners of a head are from its centroid, on paper [in]."""
    return head.side_m / math.sqrt(3) * canvas.inch_per_m


def _write(
    canvas: BenchCanvas,
    point_m: Point2,
    text: str,
    size_pt: float,
    colour: str,
    *,
    bold: bool = False,
) -> None:
    canvas.axes.text(
        *point_m,
        text,
        ha="center",
        va="center_baseline",
        size=size_pt,
        color=colour,
        weight="bold" if bold else "normal",
        zorder=8,
    )
