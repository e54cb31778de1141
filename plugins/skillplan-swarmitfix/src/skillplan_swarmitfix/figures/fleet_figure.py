"""Paths of several bases on one bench, with their parallel steps."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import chain, pairwise
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch

from skillplan.views.figures import figure_style as style
from skillplan.views.figures.figure_request import FigureRequest, Outcome, Run
from skillplan.views.figures.label_placement import LabelPlacer
from skillplan_swarmitfix.bench.bench import Bench
from skillplan_swarmitfix.figures.bench_canvas import (
    BenchCanvas,
    get_requested_bench,
    open_bench_canvas,
)

SOLVER = "fleet"
_ASIDE = 0.095
_MARK_PT = 8.0


@style.in_house_style
def draw_fleet(
    bench: Bench,
    starts: Mapping[str, int],
    schedule: Sequence[Sequence[tuple[str, int]]],
    heading: style.Heading,
) -> Figure:
    """Draw the path of every robot: a square at its start, a star at its end, steps between.

    Parameters
    ----------
    starts
        Start positions by robot, at least one.
    schedule
        Moves of every parallel step: robot and new position.

    Raises
    ------
    ValueError
        If robots are missing, or a robot moves that has no start.
    """
    paths = find_paths(starts, schedule)
    entries = _list_legend(paths)
    canvas = open_bench_canvas(bench, heading, legend=[label for _, label in entries])
    canvas.draw_lattice(pins=False)
    placer = LabelPlacer(*canvas.size_in)
    names_pt = canvas.font_pt(4.8, 6.0)
    points = {
        robot: _place_points(canvas, number, len(paths), path)
        for number, (robot, path) in enumerate(paths.items())
    }
    for number, (robot, path) in enumerate(paths.items()):
        _draw_path(canvas, placer, number, points[robot], [position for _, position in path])
    if names_pt is not None:
        _draw_names(canvas, placer, names_pt)
    size_pt = canvas.font_pt(5.6, 7.0) or style.LEAST_PT
    for number, (robot, path) in enumerate(paths.items()):
        for (step, _), point in list(zip(path, points[robot], strict=True))[1:]:
            place = placer.place(
                canvas.to_inches(point), str(step), size_pt, (0.06, 0.1, 0.15, 0.21, 0.28)
            )
            canvas.axes.text(
                *canvas.to_metres(place),
                str(step),
                ha="center",
                va="center_baseline",
                size=size_pt,
                weight="bold",
                color=style.darken_colour(style.PALETTE[number % len(style.PALETTE)]),
                zorder=8,
            )
    canvas.add_legend(entries)
    return canvas.figure


def find_paths(
    starts: Mapping[str, int], schedule: Sequence[Sequence[tuple[str, int]]]
) -> dict[str, list[tuple[int, int]]]:
    """Return the steps and positions of each robot; step 0 is the start.

    Raises
    ------
    ValueError
        If robots are missing, or a robot moves that has no start.
    """
    if not starts:
        raise ValueError("A fleet has at least one robot.")
    paths = {robot: [(0, position)] for robot, position in starts.items()}
    for step, moves in enumerate(schedule, start=1):
        for robot, position in moves:
            if robot not in paths:
                raise ValueError(f"Robot {robot!r} moves, but has no start.")
            paths[robot].append((step, position))
    return paths


def _place_points(
    canvas: BenchCanvas, number: int, count: int, path: Sequence[tuple[int, int]]
) -> list[tuple[float, float]]:
    """Return the points of a path [m], shifted a little for each robot."""
    angle = 2 * math.pi * number / max(1, count) + math.pi / 4
    aside_m = _ASIDE * canvas.bench.pitch_m if count > 1 else 0.0
    shift = aside_m * np.array([math.cos(angle), math.sin(angle)])
    return [
        (float(x_m), float(y_m))
        for x_m, y_m in (canvas.bench.centroids_m[position] + shift for _, position in path)
    ]


def _draw_path(
    canvas: BenchCanvas,
    placer: LabelPlacer,
    number: int,
    points: Sequence[tuple[float, float]],
    positions: Sequence[int],
) -> None:
    colour = style.PALETTE[number % len(style.PALETTE)]
    for begin, end in pairwise(points):
        arrow = FancyArrowPatch(
            begin,
            end,
            arrowstyle="-|>",
            mutation_scale=min(11.0, 9.0 * canvas.pitch_in),
            shrinkA=2.0,
            shrinkB=2.5,
            color=colour,
            linewidth=1.8,
            linestyle="-",
            zorder=5,
        )
        canvas.axes.add_patch(arrow)
    scale = min(1.0, canvas.pitch_in)
    for point, marker, size_pt in (
        *((point, "o", 4.0) for point in points[1:-1]),
        (points[0], "s", _MARK_PT),
        *(((points[-1], "*", 1.7 * _MARK_PT),) if len(points) > 1 else ()),
    ):
        canvas.axes.plot(
            *point,
            marker=marker,
            markersize=size_pt * scale,
            markerfacecolor=style.PAPER if marker == "s" else colour,
            markeredgecolor=colour if marker == "s" else style.PAPER,
            markeredgewidth=2.0 if marker == "s" else 0.6,
            zorder=6,
        )
        placer.avoid_disc(canvas.to_inches(point), size_pt * scale / 72 / 2)
    on_paper = [canvas.to_inches(point) for point in points]
    placer.avoid_line(on_paper)
    for begin, end in pairwise(on_paper):
        # The arrow head is wider than its line.
        share = 1 - 0.1 / max(0.1, math.dist(begin, end))
        at = (begin[0] + share * (end[0] - begin[0]), begin[1] + share * (end[1] - begin[1]))
        placer.avoid_disc(at, 0.06)


def _draw_names(canvas: BenchCanvas, placer: LabelPlacer, size_pt: float) -> None:
    """Write the name of every position at the wide side of its triangle."""
    bench = canvas.bench
    for position, (x_m, y_m) in enumerate(bench.centroids_m.tolist()):
        wide_m = y_m + (-0.235 if bench.is_up(position) else 0.235) * bench.pitch_m
        name = bench.name(position)
        place = canvas.to_inches((x_m, wide_m))
        for aside_in in (0.0, 0.16, -0.16, 0.28, -0.28):
            moved = (place[0] + aside_in * canvas.pitch_in, place[1])
            if placer.is_free(moved, name, size_pt):
                break
        else:
            moved = place
        placer.avoid_box(moved, 0.08 * len(name) * size_pt / 7, 1.25 * size_pt / 72)
        canvas.axes.text(
            *canvas.to_metres(moved),
            name,
            ha="center",
            va="center_baseline",
            size=size_pt,
            color=style.MUTED,
            zorder=7,
        )


def _list_legend(paths: Mapping[str, Sequence[tuple[int, int]]]) -> list[tuple[Artist, str]]:
    entries: list[tuple[Artist, str]] = [
        (
            Line2D([], [], color=style.PALETTE[number % len(style.PALETTE)], linewidth=2.2),
            f"{robot}: {len(path) - 1} {'swing' if len(path) == 2 else 'swings'}",
        )
        for number, (robot, path) in enumerate(paths.items())
    ]

    def mark(marker: str, size_pt: float, face: str) -> Line2D:
        return Line2D(
            [],
            [],
            linestyle="none",
            marker=marker,
            markersize=size_pt,
            markerfacecolor=face,
            markeredgecolor=style.INK,
        )

    entries.append((mark("s", 7, style.PAPER), "start"))
    entries.append((mark("*", 11, style.INK), "goal"))
    entries.append((mark("o", 4, style.INK), "end of a swing, and its step"))
    return entries


def runs(request: FigureRequest) -> Sequence[Run]:
    """Return the run that solves the task of the fleet.

    Raises
    ------
    OptionError
        If the file has no robots that share a bench.
    """
    get_requested_bench(request)
    tasks = request.problem.tasks
    task = tasks[-1] if request.part is None else request.problem.part(request.part)
    if len(task.places_in(task.initial)) < 2:
        raise request.unfit("it shows several bases, but the file has no key robots")
    return [Run(task)]


def draw(request: FigureRequest, outcomes: Sequence[Outcome]) -> Figure:
    """Draw the schedule of a solver, or else the schedule of its plan."""
    result = outcomes[0].result
    bench = get_requested_bench(request)
    plan = [step.skill for step in result.steps]
    account = request.problem.account({result.task: plan})
    schedule = result.trace.get("schedule") or account.document["schedule"]
    steps = [[(robot, bench.position(end)) for robot, _, _, end in moves] for moves in schedule]
    starts = {
        entry["robot"]: bench.position(entry["start"]) for entry in account.document["robots"]
    }
    swings = sum(len(moves) for moves in steps)
    whole_s = sum(_measure_steps_s(account.document, schedule))
    heading = style.Heading(
        f"Paths of {len(starts)} bases of {request.problem.name}: {swings} swings in "
        f"{len(steps)} parallel steps, {whole_s:.1f} s",
        request.details(outcomes[0].run),
    )
    return draw_fleet(bench, starts, steps, heading)


def _measure_steps_s(
    known: Mapping[str, Any], schedule: Sequence[Sequence[Sequence[str]]]
) -> list[float]:
    """Return the durations of the steps of a schedule with the same swings as the known one [s]."""
    swings = zip(chain.from_iterable(known["schedule"]), chain(*known["swings_s"]), strict=True)
    swing_s = {tuple(move): time_s for move, time_s in swings}
    return [max(swing_s[tuple(move)] for move in moves) for moves in schedule]
