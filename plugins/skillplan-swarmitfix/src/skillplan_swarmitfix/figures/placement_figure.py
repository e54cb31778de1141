"""Heads and bases along a trajectory.

Veeramani and Muthuswamy 2022, Fig. 11.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.artist import Artist
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from numpy.typing import NDArray

from skillplan.views.figures import figure_style as style
from skillplan.views.figures.figure_request import FigureRequest, Outcome, Run
from skillplan.views.figures.label_placement import LabelPlacer
from skillplan_swarmitfix.bench.bench import Bench
from skillplan_swarmitfix.figures.bench_canvas import (
    BenchCanvas,
    get_requested_bench,
    open_bench_canvas,
)

Point2 = tuple[float, float]
RADIUS = 0.2
"""Radius of the circle that marks a base, in pitches."""
_COLOURS = (style.GREEN, style.BLUE, style.RED, style.PURPLE, style.OLIVE, style.SKY)


@dataclass(frozen=True, slots=True)
class HeadMark:
    """The mark of a head.

    Parameters
    ----------
    position_m
        Centroid [m].
    yaw_rad
        Heading of its first corner, counter-clockwise from x [rad].
    side_m
        Side of the equilateral triangle [m], > 0.
    at_vertex
        True for a head at a vertex of the trajectory.

    Raises
    ------
    ValueError
        If the side is not > 0.
    """

    position_m: Point2
    yaw_rad: float
    side_m: float
    at_vertex: bool

    def __post_init__(self) -> None:
        if not self.side_m > 0:
            raise ValueError(f"A head's side must be > 0, not {self.side_m} m.")

    def corners_m(self) -> NDArray[np.float64]:
        """Return its corners [m], shape (3, 2)."""
        angles = self.yaw_rad + np.arange(3) * (2 * math.pi / 3)
        radius_m = self.side_m / math.sqrt(3)
        return np.array(self.position_m) + radius_m * np.stack(
            [np.cos(angles), np.sin(angles)], axis=1
        )


@dataclass(frozen=True, slots=True)
class BaseGoal:
    """A goal position of the base with the supports that it holds (x, y) [m]."""

    position: int
    supports_m: tuple[Point2, ...]


def find_visits(goals: Sequence[BaseGoal]) -> dict[int, list[int]]:
    """Return the numbers of the goals, from 1, by position."""
    visits: dict[int, list[int]] = {}
    for number, goal in enumerate(goals, start=1):
        visits.setdefault(goal.position, []).append(number)
    return visits


def assign_colours(bench: Bench, goals: Sequence[BaseGoal]) -> dict[int, str]:
    """Return a colour by position of goals; goals of the same colour are far from each other."""
    colours: dict[int, str] = {}
    for position in find_visits(goals):
        at_m = bench.centroids_m[position]
        nearest_m = dict.fromkeys(_COLOURS, math.inf)
        for other, colour in colours.items():
            nearest_m[colour] = min(nearest_m[colour], math.dist(at_m, bench.centroids_m[other]))
        colours[position] = max(_COLOURS, key=nearest_m.__getitem__)
    return colours


def format_ranges(numbers: Sequence[int]) -> str:
    """Return ascending numbers as text, such as ``1, 3-5``."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][1] + 1:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    return ", ".join(
        str(first) if first == last else f"{first}\N{EN DASH}{last}" for first, last in runs
    )


def find_holds(goals: Sequence[BaseGoal]) -> list[tuple[int, Point2]]:
    """Return the positions of goals with the supports held from there, without duplicates [m]."""
    return list(dict.fromkeys((goal.position, at) for goal in goals for at in goal.supports_m))


def find_links_m(bench: Bench, goals: Sequence[BaseGoal]) -> list[tuple[Point2, Point2]]:
    """Return the lines from the circles of goals to the supports that they hold [m]."""
    lines = []
    for position, (x_m, y_m) in find_holds(goals):
        from_x, from_y = map(float, bench.centroids_m[position])
        long_m = math.dist((from_x, from_y), (x_m, y_m))
        share = min(1.0, RADIUS * bench.pitch_m / long_m) if long_m else 1.0
        edge = (from_x + share * (x_m - from_x), from_y + share * (y_m - from_y))
        lines.append((edge, (x_m, y_m)))
    return lines


def draw_labels(
    canvas: BenchCanvas,
    points_m: NDArray[np.float64],
    heads: Sequence[HeadMark],
    goals: Sequence[BaseGoal],
    visits: Mapping[int, Sequence[int]],
    between: Sequence[int],
    home: int | None,
) -> None:
    """Write names into the circles, and numbers near them and near the heads.

    Parameters
    ----------
    canvas
        Canvas with everything but labels.
    points_m
        Points of the trajectory [m], shape (n, 2).
    heads, goals
        Heads in order along the trajectory, and goals.
    visits
        Numbers of the goals by position.
    between
        Positions that the base passes.
    home
        First position of the base; None for none.
    """
    bench = canvas.bench
    name_pt, number_pt = canvas.font_pt(6.4, 8.0), canvas.font_pt(5.6, 7.0)
    if name_pt is None:
        return
    number_pt = number_pt or style.LEAST_PT
    placer = _make_placer(canvas, points_m, heads, goals)
    radius_in = RADIUS * canvas.pitch_in
    rings = sorted({*visits, *between, *(() if home is None else (home,))})
    centres = {position: canvas.to_inches(bench.centroids_m[position]) for position in rings}
    inside = {p for p in rings if placer.is_free(centres[p], bench.name(p), name_pt)}
    for position in rings:
        if position in inside:
            x_m, y_m = bench.centroids_m[position].tolist()
            _write(canvas, (x_m, y_m), bench.name(position), name_pt, style.INK, bold=True)
    for centre in centres.values():
        placer.avoid_disc(centre, radius_in + 0.02)
    distances_in = [radius_in + extra for extra in (0.04, 0.1, 0.18, 0.28)]
    for position in rings:
        if position not in inside:
            name = bench.name(position)
            place = placer.place(centres[position], name, name_pt, distances_in)
            _write(canvas, canvas.to_metres(place), name, name_pt, style.INK, bold=True)
    colours = assign_colours(canvas.bench, goals)
    for position, numbers in sorted(visits.items()):
        text = f"b{format_ranges(numbers)}"
        place = placer.place(centres[position], text, number_pt, distances_in)
        _write(
            canvas, canvas.to_metres(place), text, number_pt, style.darken_colour(colours[position])
        )
    if home is not None and home not in visits:
        place = placer.place(centres[home], "home", number_pt, distances_in)
        _write(canvas, canvas.to_metres(place), "home", number_pt, "#8a5a00")
    _number_heads(canvas, placer, np.mean(points_m, axis=0), heads, number_pt)


def _number_heads(
    canvas: BenchCanvas,
    placer: LabelPlacer,
    middle_m: NDArray[np.float64],
    heads: Sequence[HeadMark],
    size_pt: float,
) -> None:
    """Write the numbers of the heads, outside the trajectory if there is room."""
    for number, head in enumerate(heads, start=1):
        distances_in = [
            _measure_corner_in(canvas, head) + extra for extra in (0.03, 0.08, 0.15, 0.25)
        ]
        outward = np.array(head.position_m) - middle_m
        angle_rad = math.atan2(outward[1], outward[0])
        anchor, text = canvas.to_inches(head.position_m), f"h{number}"
        place = placer.place(anchor, text, size_pt, distances_in, angle_rad)
        _write(canvas, canvas.to_metres(place), text, size_pt, style.MUTED)


def _make_placer(
    canvas: BenchCanvas,
    points_m: NDArray[np.float64],
    heads: Sequence[HeadMark],
    goals: Sequence[BaseGoal],
) -> LabelPlacer:
    """Return a placer that avoids the trajectory, the heads and the lines to them."""
    placer = LabelPlacer(*canvas.size_in)
    placer.avoid_line([canvas.to_inches(point) for point in points_m.tolist()])
    for link in find_links_m(canvas.bench, goals):
        placer.avoid_line([canvas.to_inches(end) for end in link])
    for head in heads:
        placer.avoid_disc(canvas.to_inches(head.position_m), _measure_corner_in(canvas, head))
    return placer


def _measure_corner_in(canvas: BenchCanvas, head: HeadMark) -> float:
    """Return the distance of the corners of a head from its centroid on paper [in]."""
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


SOLVER = "exact"
_TRAJECTORY = "#3c4043"


@style.in_house_style
def draw_placement(
    bench: Bench,
    trajectory_m: Sequence[Point2],
    heads: Sequence[HeadMark],
    goals: Sequence[BaseGoal],
    paths: Sequence[Sequence[int]],
    heading: style.Heading,
    *,
    closed: bool,
) -> Figure:
    """Draw the trajectory, the heads along it, and the goals of the base that holds them.

    Parameters
    ----------
    trajectory_m
        Points of the trajectory in order [m], at least two.
    heads
        Heads in order along the trajectory.
    goals
        Goals in the order of the base.
    paths
        Positions of the base on the path to each goal, both ends included.
    closed
        True if the trajectory returns to its start.

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
    visits = find_visits(goals)
    between = sorted({p for path in paths for p in path[1:-1]} - set(visits))
    home = paths[0][0] if paths and paths[0] else None
    entries = _list_legend(closed, bool(between), home is not None and home not in visits)
    canvas = open_bench_canvas(
        bench,
        heading,
        legend=[label for _, label in entries],
        around_m=_collect_points(points_m, heads),
    )
    canvas.draw_lattice(pins=False)
    _draw_trajectory(canvas, points_m)
    _draw_links(canvas, goals)
    _draw_bases(canvas, assign_colours(canvas.bench, goals), between, home)
    _draw_heads(canvas, heads)
    draw_labels(canvas, points_m, heads, goals, visits, between, home)
    canvas.add_legend(entries)
    return canvas.figure


def _collect_points(
    points_m: NDArray[np.float64], heads: Sequence[HeadMark]
) -> NDArray[np.float64]:
    return np.concatenate([points_m, *(head.corners_m() for head in heads)])


def _draw_trajectory(canvas: BenchCanvas, points_m: NDArray[np.float64]) -> None:
    canvas.axes.plot(
        *points_m.T, color=_TRAJECTORY, linewidth=2.2, zorder=5, solid_joinstyle="round"
    )[0].set_gid("trajectory")
    # An arrow in the middle of the longest piece shows the direction of the tool.
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
    colours = assign_colours(canvas.bench, goals)
    lines = LineCollection(
        find_links_m(canvas.bench, goals),
        colors=[colours[position] for position, _ in find_holds(goals)],
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
        _draw_ring(canvas, position, radius_m, colour, "-", 2.2, f"goal-{name(position)}")
    for position in between:
        _draw_ring(canvas, position, radius_m, style.MUTED, "--", 1.0, f"between-{name(position)}")
    if home is not None and home not in goals:
        _draw_ring(
            canvas, home, radius_m, style.ORANGE, ":", 2.2, f"home-{canvas.bench.name(home)}"
        )


def _draw_ring(
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
        edgecolors=style.INK,
        linewidths=0.8,
        zorder=6,
    )
    drawn.set_gid("heads")
    canvas.axes.add_collection(drawn)


def _list_legend(closed: bool, between: bool, home: bool) -> list[tuple[Artist, str]]:
    def ring(colour: str, dashes: str) -> Circle:
        return Circle(
            (0, 0), 1, facecolor=style.PAPER, edgecolor=colour, linestyle=dashes, linewidth=2.0
        )

    def head(colour: str) -> Line2D:
        return Line2D(
            [],
            [],
            linestyle="none",
            marker="^",
            color=colour,
            markeredgecolor=style.INK,
            markersize=9,
        )

    shape = "closed" if closed else "open"
    entries: list[tuple[Artist, str]] = [
        (Line2D([], [], color=_TRAJECTORY, linewidth=2.2), f"trajectory ({shape})"),
        (head(_TRAJECTORY), "head at a vertex (h)"),
        (head("#f4c95d"), "head between vertices (h)"),
        (ring(style.GREEN, "-"), "goal position of the base (b)"),
        (
            Line2D([], [], color=style.GREEN, linewidth=1.1),
            "supports held from there, in its colour",
        ),
    ]
    if between:
        entries.append((ring(style.MUTED, "--"), "intermediate position"))
    if home:
        entries.append((ring(style.ORANGE, ":"), "home position"))
    return entries


def runs(request: FigureRequest) -> Sequence[Run]:
    """Return the run that solves the whole chain."""
    account = request.problem.account({})
    get_requested_bench(request, account)
    if "workpiece" not in account.document:
        raise request.unfit("the file has no trajectory along which heads are placed")
    return [request.chain_run()]


def draw(request: FigureRequest, outcomes: Sequence[Outcome]) -> Figure:
    """Draw the placements of a solved chain."""
    chain = outcomes[0].chain
    document = chain.account.document
    bench, workpiece = get_requested_bench(request, chain.account), document["workpiece"]
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
    heading = style.Heading(
        f"Placement of heads and bases of {chain.name}: {makespan}",
        request.details(outcomes[0].run),
    )
    return draw_placement(bench, points_m, heads, goals, paths, heading, closed=closed)
