"""The bench with the recommended action of a policy in every position.

Veeramani and Muthuswamy 2022, Fig. 9.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.colorbar import Colorbar
from matplotlib.colors import BoundaryNorm, LinearSegmentedColormap, ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrow
from matplotlib.ticker import FixedLocator
from numpy.typing import NDArray

from skillplan.views.figures.figure_request import FigureRequest, Outcome, Run
from skillplan.views.figures.figure_style import (
    BLUE,
    GREEN,
    INK,
    LINE_IN,
    MUTED,
    RED,
    Heading,
    add_axes_in,
    in_house_style,
)
from skillplan_swarmitfix.bench.bench import Bench
from skillplan_swarmitfix.figures.bench_canvas import (
    BenchCanvas,
    get_requested_bench,
    open_bench_canvas,
)

SOLVER = "sarsa"
_SHADES = LinearSegmentedColormap.from_list("steps", ["#f2f7fb", "#8fb8d8"])
_LOST = "#f3e3dc"
_RIGHT_IN = 0.95


@in_house_style
def draw_policy(
    bench: Bench,
    recommended: Mapping[int, int],
    goal: int,
    heading: Heading,
    *,
    start: int | None = None,
) -> Figure:
    """Draw a policy: an arrow in every position towards the end of its action.

    Positions are shaded by the number of steps that the policy takes from there to the goal.

    Parameters
    ----------
    recommended
        Actions by position, both from 0; positions without an action stay empty.
    start
        Position whose path to the goal is outlined; None for none.

    Raises
    ------
    ValueError
        If a position or action does not exist, or an action leaves the bench.
    """
    ends = _find_ends(bench, recommended)
    steps = count_steps_to(goal, ends, bench.n_positions)
    path = [] if start is None else _find_path(start, goal, ends)
    has_rings = any(end == here for here, end in ends.items() if here != goal)
    has_lost = bool((steps < 0).any())
    entries = _list_legend(len(path) > 1, has_rings, has_lost)
    canvas = open_bench_canvas(
        bench, heading, legend=[label for _, label in entries], right_in=_RIGHT_IN
    )
    most = max(1, int(steps.max()))
    colours = [_SHADES(step / most) if step >= 0 else _LOST for step in steps.tolist()]
    canvas.draw_lattice(colours)
    for position in path:
        canvas.outline(position, facecolor="none", edgecolor=RED, linewidth=2.0, zorder=3)
    canvas.outline(goal, facecolor="#d8f0e6", edgecolor=GREEN, linewidth=2.4, zorder=3)
    _draw_arrows(canvas, ends, goal)
    _draw_names(canvas, recommended)
    canvas.add_legend(entries)
    _draw_scale(canvas, most)
    return canvas.figure


def count_steps_to(goal: int, ends: Mapping[int, int], n_positions: int) -> NDArray[np.int64]:
    """Return the steps of a policy from every position to the goal; -1 if it never gets there.

    Parameters
    ----------
    ends
        End of the recommended action by position.
    """
    steps = np.full(n_positions, -1, dtype=np.int64)
    before: dict[int, list[int]] = {}
    for here, end in ends.items():
        before.setdefault(end, []).append(here)
    steps[goal] = 0
    frontier = [goal]
    while frontier:
        following = [here for end in frontier for here in before.get(end, []) if steps[here] < 0]
        for end in frontier:
            for here in before.get(end, []):
                if steps[here] < 0:
                    steps[here] = steps[end] + 1
        frontier = following
    return steps


def _find_ends(bench: Bench, recommended: Mapping[int, int]) -> dict[int, int]:
    ends = {}
    for here, action in recommended.items():
        name = bench.name(here)
        if not 0 <= action < bench.actions:
            raise ValueError(
                f"Action {action} does not exist; the actions are B0 to B{bench.actions - 1}."
            )
        end = int(bench.successors[here, action])
        if end < 0:
            raise ValueError(f"B{action} leaves the bench in {name}.")
        ends[here] = end
    return ends


def _find_path(start: int, goal: int, ends: Mapping[int, int]) -> list[int]:
    """Return the positions from start to goal; none if the policy does not get there."""
    path = [start]
    while path[-1] != goal:
        following = ends.get(path[-1])
        if following is None or following in path:
            return []
        path.append(following)
    return path


def _draw_arrows(canvas: BenchCanvas, ends: Mapping[int, int], goal: int) -> None:
    bench, pitch_m = canvas.bench, canvas.bench.pitch_m
    moving = [(here, end) for here, end in sorted(ends.items()) if here != end and here != goal]
    resting = [here for here, end in sorted(ends.items()) if here == end and here != goal]
    towards_apex = np.where(np.arange(bench.n_positions) % 2 == 0, 1.0, -1.0)
    middles = bench.centroids_m + np.stack(
        [np.zeros(bench.n_positions), 0.045 * pitch_m * towards_apex], axis=1
    )
    if moving:
        here, there = (np.array(column) for column in zip(*moving, strict=True))
        along = bench.centroids_m[there] - bench.centroids_m[here]
        along *= 0.34 * pitch_m / np.linalg.norm(along, axis=1, keepdims=True)
        arrows = canvas.axes.quiver(
            *middles[here].T,
            *along.T,
            pivot="middle",
            angles="xy",
            scale_units="xy",
            scale=1.0,
            units="inches",
            width=min(0.028, 0.03 * canvas.pitch_in),
            headwidth=4.2,
            headlength=4.6,
            headaxislength=4.2,
            minlength=0.0,
            color=INK,
            zorder=6,
        )
        arrows.set_gid("policy-arrows")
    if resting:
        canvas.axes.scatter(
            middles[resting, 0],
            middles[resting, 1],
            s=(0.16 * canvas.pitch_in * 72) ** 2,
            facecolors="none",
            edgecolors=INK,
            linewidths=1.3,
            zorder=6,
        ).set_gid("policy-stays")
    x_m, y_m = middles[goal]
    canvas.axes.scatter(
        [x_m],
        [y_m],
        s=(0.26 * canvas.pitch_in * 72) ** 2,
        marker="*",
        color=GREEN,
        linewidths=0,
        zorder=6,
    ).set_gid("goal")


def _draw_names(canvas: BenchCanvas, recommended: Mapping[int, int]) -> None:
    """Write position and action at the wide side of each triangle."""
    bench, pitch_m = canvas.bench, canvas.bench.pitch_m
    size_pt = canvas.font_pt(5.6, 7.0)
    if size_pt is None:
        return
    gap_m = 0.03 * pitch_m
    for position, (x_m, y_m) in enumerate(bench.centroids_m.tolist()):
        wide_m = y_m + (-0.2 if bench.is_up(position) else 0.2) * pitch_m
        action = recommended.get(position)
        common: dict[str, Any] = {"va": "center_baseline", "size": size_pt, "zorder": 7}
        if action is None:
            canvas.axes.text(
                x_m, wide_m, bench.name(position), ha="center", weight="bold", **common
            )
            continue
        canvas.axes.text(
            x_m - gap_m, wide_m, bench.name(position), ha="right", weight="bold", **common
        )
        canvas.axes.text(x_m + gap_m, wide_m, f"B{action}", ha="left", color=BLUE, **common)


def _list_legend(path: bool, rings: bool, lost: bool) -> list[tuple[Artist, str]]:
    def mark(marker: str, **style: Any) -> Line2D:
        return Line2D([], [], linestyle="none", marker=marker, **style)

    entries: list[tuple[Artist, str]] = [
        (FancyArrow(0, 0, 1, 0, color=INK), "recommended action, towards where it leads"),
        (mark("*", color=GREEN, markersize=11), "goal"),
    ]
    if path:
        outline = mark("^", markerfacecolor="none", markeredgecolor=RED, markersize=10)
        outline.set_markeredgewidth(1.8)
        entries.append((outline, "path from the start"))
    if rings:
        ring = mark("o", markerfacecolor="none", markeredgecolor=INK, markersize=8)
        entries.append((ring, "B0: stay"))
    if lost:
        patch = mark("s", markerfacecolor=_LOST, markeredgecolor=MUTED, markersize=10)
        entries.append((patch, "never gets to the goal"))
    return entries


def _draw_scale(canvas: BenchCanvas, most: int) -> None:
    """Draw the scale of steps to the goal on the right."""
    figure = canvas.figure
    width_in, height_in = figure.get_size_inches()
    place = canvas.axes.get_position()
    tall_in = min(place.height * height_in, 3.4)
    bottom_in = (place.y0 + place.height / 2) * height_in - tall_in / 2
    axes = add_axes_in(figure, width_in - _RIGHT_IN, bottom_in, 0.16, tall_in)
    colours = ListedColormap([_SHADES(step / most) for step in range(most + 1)])
    norm = BoundaryNorm(np.arange(-0.5, most + 1.5), most + 1)
    bar = Colorbar(axes, cmap=colours, norm=norm)
    every = -(-(most + 1) // max(2, int(tall_in / (1.2 * LINE_IN))))
    bar.ax.yaxis.set_major_locator(FixedLocator(list(range(0, most + 1, every))))
    bar.ax.yaxis.set_minor_locator(FixedLocator([]))
    bar.set_label("steps to the goal")


def runs(request: FigureRequest) -> Sequence[Run]:
    """Return the run that solves the task of walking."""
    get_requested_bench(request)
    return [Run(request.walk())]


def draw(request: FigureRequest, outcomes: Sequence[Outcome]) -> Figure:
    """Draw the policy that a solver found.

    Raises
    ------
    OptionError
        If the solver gave a plan but no policy.
    """
    bench, task, result = get_requested_bench(request), request.walk(), outcomes[0].result
    if result.policy is None:
        raise request.unfit(
            f"{result.solver} plans a sequence, not a policy; name a solver such as sarsa or "
            "policy-iteration by --solver"
        )
    recommended = {}
    for state, skill in result.policy.items():
        places = task.places_in(state)
        if len(places) == 1:
            recommended[bench.position(places[0].name)] = int(skill.parameters["action"][1:])
    start, goal = request.ends(task)
    recommended.pop(bench.position(goal), None)
    heading = Heading(
        f"Policy of {task.name}: from {start} to {goal}", request.details(outcomes[0].run)
    )
    return draw_policy(
        bench, recommended, bench.position(goal), heading, start=bench.position(start)
    )
