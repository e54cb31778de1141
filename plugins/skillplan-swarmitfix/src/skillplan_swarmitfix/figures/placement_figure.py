"""Where heads and bases stand along a trajectory.

Veeramani and Muthuswamy 2022, Fig. 11.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from numpy.typing import NDArray

from skillplan.views.figures.figure_request import FigureRequest, Outcome, Run
from skillplan.views.figures.figure_style import (
    GREEN,
    INK,
    MUTED,
    ORANGE,
    PAPER,
    Heading,
    in_house_style,
)
from skillplan_swarmitfix.bench.bench import Bench
from skillplan_swarmitfix.figures.bench_canvas import BenchCanvas, bench_canvas
from skillplan_swarmitfix.figures.placement_labels import draw_labels
from skillplan_swarmitfix.figures.placement_marks import (
    RADIUS,
    BaseGoal,
    HeadMark,
    Point2,
    colours_of,
    holds_of,
    links_m,
    visits_of,
)
from skillplan_swarmitfix.figures.requested_bench import requested_bench

SOLVER = "exact"
_TRAJECTORY = "#3c4043"


@in_house_style
def placement_figure(
    bench: Bench,
    trajectory_m: Sequence[Point2],
    heads: Sequence[HeadMark],
    goals: Sequence[BaseGoal],
    paths: Sequence[Sequence[int]],
    heading: Heading,
    *,
    closed: bool,
) -> Figure:
    """Draw the trajectory, the heads along it, and where the base stands to hold them.

    Parameters
    ----------
    bench
        The lattice.
    trajectory_m
        Points of the trajectory in order [m], at least two.
    heads
        In order along the trajectory.
    goals
        In the order in which the base visits them.
    paths
        Positions of the base on the path to each goal, both ends included.
    heading
        What stands above.
    closed
        Whether the trajectory returns to its start.

    Raises
    ------
    ValueError
        If the trajectory has less than two points, or goals and paths differ in number.
    """
    if len(trajectory_m) < 2:
        raise ValueError("A trajectory has at least two points.")
    if len(goals) != len(paths):
        raise ValueError(f"{len(goals)} goals need as many paths, not {len(paths)}.")
    points_m = np.array([*trajectory_m, *trajectory_m[:1]] if closed else trajectory_m)
    visits = visits_of(goals)
    between = sorted({p for path in paths for p in path[1:-1]} - set(visits))
    home = paths[0][0] if paths and paths[0] else None
    entries = _legend(closed, bool(between), home is not None and home not in visits)
    canvas = bench_canvas(
        bench, heading, legend=[label for _, label in entries], around_m=_around(points_m, heads)
    )
    canvas.draw_lattice(pins=False)
    _draw_trajectory(canvas, points_m)
    _draw_links(canvas, goals)
    _draw_bases(canvas, colours_of(canvas.bench, goals), between, home)
    _draw_heads(canvas, heads)
    draw_labels(canvas, points_m, heads, goals, visits, between, home)
    canvas.add_legend(entries)
    return canvas.figure


def _around(points_m: NDArray[np.float64], heads: Sequence[HeadMark]) -> NDArray[np.float64]:
    return np.concatenate([points_m, *(head.corners_m() for head in heads)])


def _draw_trajectory(canvas: BenchCanvas, points_m: NDArray[np.float64]) -> None:
    canvas.axes.plot(
        *points_m.T, color=_TRAJECTORY, linewidth=2.2, zorder=5, solid_joinstyle="round"
    )[0].set_gid("trajectory")
    # One arrow in the middle of the longest piece says in which direction the tool goes.
    pieces = np.diff(points_m, axis=0)
    longest = int(np.argmax(np.hypot(*pieces.T)))
    begin, along = points_m[longest], pieces[longest]
    canvas.axes.annotate(
        "",
        xy=begin + 0.56 * along,
        xytext=begin + 0.5 * along,
        arrowprops={"arrowstyle": "-|>", "color": _TRAJECTORY, "lw": 1.6, "mutation_scale": 15},
        zorder=5,
    )


def _draw_links(canvas: BenchCanvas, goals: Sequence[BaseGoal]) -> None:
    colours = colours_of(canvas.bench, goals)
    lines = LineCollection(
        links_m(canvas.bench, goals),
        colors=[colours[position] for position, _ in holds_of(goals)],
        linewidths=1.1,
        zorder=3,
    )
    lines.set_gid("links")
    canvas.axes.add_collection(lines)


def _draw_bases(
    canvas: BenchCanvas, goals: Mapping[int, str], between: Sequence[int], home: int | None
) -> None:
    radius_m, name = RADIUS * canvas.bench.pitch_m, canvas.bench.name
    for position, colour in goals.items():
        _ring(canvas, position, radius_m, colour, "-", 2.2, f"goal-{name(position)}")
    for position in between:
        _ring(canvas, position, radius_m, MUTED, "--", 1.0, f"between-{name(position)}")
    if home is not None and home not in goals:
        _ring(canvas, home, radius_m, ORANGE, ":", 2.2, f"home-{canvas.bench.name(home)}")


def _ring(
    canvas: BenchCanvas,
    position: int,
    radius_m: float,
    colour: str,
    dashes: str,
    width_pt: float,
    gid: str,
) -> None:
    x_m, y_m = canvas.bench.centroids_m[position]
    circle = Circle(
        (float(x_m), float(y_m)),
        radius_m,
        facecolor="none",
        edgecolor=colour,
        linestyle=dashes,
        linewidth=width_pt,
        zorder=4,
    )
    circle.set_gid(gid)
    canvas.axes.add_patch(circle)


def _draw_heads(canvas: BenchCanvas, heads: Sequence[HeadMark]) -> None:
    if not heads:
        return
    drawn = PolyCollection(
        [head.corners_m() for head in heads],
        facecolors=[_TRAJECTORY if head.at_vertex else "#f4c95d" for head in heads],
        edgecolors=INK,
        linewidths=0.8,
        zorder=6,
    )
    drawn.set_gid("heads")
    canvas.axes.add_collection(drawn)


def _legend(closed: bool, between: bool, home: bool) -> list[tuple[Artist, str]]:
    def ring(colour: str, dashes: str) -> Circle:
        return Circle((0, 0), 1, facecolor=PAPER, edgecolor=colour, linestyle=dashes, linewidth=2.0)

    def head(colour: str) -> Line2D:
        return Line2D(
            [], [], linestyle="none", marker="^", color=colour, markeredgecolor=INK, markersize=9
        )

    shape = "closed" if closed else "open"
    entries: list[tuple[Artist, str]] = [
        (Line2D([], [], color=_TRAJECTORY, linewidth=2.2), f"trajectory ({shape})"),
        (head(_TRAJECTORY), "head at a vertex (h)"),
        (head("#f4c95d"), "head between vertices (h)"),
        (ring(GREEN, "-"), "goal position of the base (b)"),
        (Line2D([], [], color=GREEN, linewidth=1.1), "supports held from there, in its colour"),
    ]
    if between:
        entries.append((ring(MUTED, "--"), "intermediate position"))
    if home:
        entries.append((ring(ORANGE, ":"), "home position"))
    return entries


def runs(request: FigureRequest) -> Sequence[Run]:
    """Return what has to be solved first: the whole chain."""
    account = request.problem.account({})
    requested_bench(request, account)
    if "workpiece" not in account.document:
        raise request.unfit("the file has no trajectory along which heads are placed")
    return [request.chain_run()]


def draw(request: FigureRequest, outcomes: Sequence[Outcome]) -> Figure:
    """Draw the placements of a solved chain."""
    chain = outcomes[0].chain
    document = chain.account.document
    bench, workpiece = requested_bench(request, chain.account), document["workpiece"]
    heads = [
        HeadMark(
            (entry["position_m"][0], entry["position_m"][1]),
            entry["yaw_rad"],
            entry["side_m"],
            entry["kind"] == "vertex",
        )
        for entry in document["heads"]
    ]
    goals = [
        BaseGoal(
            bench.position(entry["goal"]), tuple((x_m, y_m) for x_m, y_m in entry["support_m"])
        )
        for entry in document["goals"]
    ]
    paths = [[bench.position(name) for name in part.path] for part in chain.main]
    closed = bool(workpiece["closed"])
    points_m = [(x_m, y_m) for x_m, y_m in workpiece["points_m"]]
    makespan = f"{chain.makespan} steps of the base for {len(goals)} goals"
    heading = Heading(
        f"Placement of heads and bases of {chain.name}: {makespan}",
        request.details(outcomes[0].run),
    )
    return placement_figure(bench, points_m, heads, goals, paths, heading, closed=closed)
