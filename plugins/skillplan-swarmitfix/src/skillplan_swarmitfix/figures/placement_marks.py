"""What a figure of placements shows: heads, goals of the base, and the lines between them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan.views.figures.figure_style import BLUE, GREEN, OLIVE, PURPLE, RED, SKY
from skillplan_swarmitfix.bench.bench import Bench

Point2 = tuple[float, float]
RADIUS = 0.2
"""Radius of the circle that marks a base, in pitches."""
_COLOURS = (GREEN, BLUE, RED, PURPLE, OLIVE, SKY)


@dataclass(frozen=True, slots=True)
class HeadMark:
    """A head on paper.

    Parameters
    ----------
    position_m
        Its centroid [m].
    yaw_rad
        Heading of its first corner, counter-clockwise from x [rad].
    side_m
        Side of the equilateral triangle [m], > 0.
    at_vertex
        Whether it stands at a vertex of the trajectory.

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
    """A goal position of the base, and the supports that it holds (x, y) [m]."""

    position: int
    supports_m: tuple[Point2, ...]


def visits_of(goals: Sequence[BaseGoal]) -> dict[int, list[int]]:
    """Return the numbers of the goals, from 1, by the position where they are."""
    visits: dict[int, list[int]] = {}
    for number, goal in enumerate(goals, start=1):
        visits.setdefault(goal.position, []).append(number)
    return visits


def colours_of(bench: Bench, goals: Sequence[BaseGoal]) -> dict[int, str]:
    """Return a colour by the position of goals; those of one colour are far from each other."""
    found: dict[int, str] = {}
    for position in visits_of(goals):
        at_m = bench.centroids_m[position]
        apart_m = dict.fromkeys(_COLOURS, math.inf)
        for other, colour in found.items():
            apart_m[colour] = min(apart_m[colour], math.dist(at_m, bench.centroids_m[other]))
        found[position] = max(_COLOURS, key=apart_m.__getitem__)
    return found


def ranges_text(numbers: Sequence[int]) -> str:
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


def holds_of(goals: Sequence[BaseGoal]) -> list[tuple[int, Point2]]:
    """Return the positions of goals, each with the supports held from there, once each [m]."""
    return list(dict.fromkeys((goal.position, at) for goal in goals for at in goal.supports_m))


def links_m(bench: Bench, goals: Sequence[BaseGoal]) -> list[tuple[Point2, Point2]]:
    """Return the lines from the circles of goals to the supports that they hold [m]."""
    lines = []
    for position, (x_m, y_m) in holds_of(goals):
        from_x, from_y = map(float, bench.centroids_m[position])
        long_m = math.dist((from_x, from_y), (x_m, y_m))
        share = min(1.0, RADIUS * bench.pitch_m / long_m) if long_m else 1.0
        edge = (from_x + share * (x_m - from_x), from_y + share * (y_m - from_y))
        lines.append((edge, (x_m, y_m)))
    return lines
