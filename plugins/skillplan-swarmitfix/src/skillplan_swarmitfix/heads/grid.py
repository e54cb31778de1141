"""The heads to choose from along a segment, and which of them may follow which.

Only consecutive heads must not overlap: other heads are not below the sheet at the same time. The
heads at the vertices are given, and may overlap on a short segment.
"""

from __future__ import annotations

import bisect
import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from skillplan_swarmitfix.heads.heads import (
    THIRD_RAD,
    Head,
    HeadKind,
    HeadRules,
    normal_yaw,
    same_yaw,
)
from skillplan_swarmitfix.trajectory.path_elements import Point2
from skillplan_swarmitfix.trajectory.workpiece import Segment

_TOUCH_M = 1e-9


class SupportedStretch:
    """The stretch of a segment within the triangle of a head.

    On a curve it is the connected piece around the centre of the head, followed chord by chord.

    Parameters
    ----------
    segment
        The segment.
    rules
        The side of the head.
    """

    def __init__(self, segment: Segment, rules: HeadRules) -> None:
        self._segment = segment
        self._inradius_m = rules.inradius_m
        steps = itertools.starmap(math.dist, itertools.pairwise(segment.points))
        self._travelled = list(itertools.accumulate(steps, initial=0.0))

    def at(self, distance_m: float, yaw_rad: float) -> tuple[float, float]:
        """Return start and end of the stretch, as distances along the segment [m].

        Parameters
        ----------
        distance_m
            Position of the head's centre, in [0, length of the segment] [m].
        yaw_rad
            Orientation of the head [rad].
        """
        points = self._segment.points
        centre = self._segment.point_at(distance_m)
        after = bisect.bisect_right(self._travelled, distance_m)
        before = bisect.bisect_left(self._travelled, distance_m)
        ahead_m = self._inside(centre, yaw_rad, itertools.islice(points, after, None))
        back_m = self._inside(centre, yaw_rad, (points[i] for i in range(before - 1, -1, -1)))
        return max(0.0, distance_m - back_m), min(self._segment.length_m, distance_m + ahead_m)

    def _inside(self, centre: Point2, yaw_rad: float, path: Iterable[Point2]) -> float:
        """Return the length of the path from the centre within the triangle [m]."""
        normals = [yaw_rad + math.pi / 3 + k * THIRD_RAD for k in range(3)]
        length_m, here, heights = 0.0, centre, [0.0, 0.0, 0.0]
        for point in path:
            x_m, y_m = point[0] - centre[0], point[1] - centre[1]
            reached = [x_m * math.cos(n) + y_m * math.sin(n) for n in normals]
            share = min(
                (self._inradius_m - low) / (high - low) if high > self._inradius_m else 1.0
                for low, high in zip(heights, reached, strict=True)
            )
            length_m += share * math.dist(here, point)
            if max(reached) > self._inradius_m:
                break
            here, heights = point, reached
        return length_m


class HeadShapes:
    """Triangles of heads, to find pairs that do not overlap.

    Two triangles do not overlap exactly if a line along a side of one of them separates them
    (separating axis theorem); touching heads do not overlap.

    Parameters
    ----------
    positions
        Centres, shape (n, 2) [m].
    yaws_rad
        Shape (n,) [rad].
    rules
        The side of the head.
    """

    def __init__(
        self, positions: Sequence[Point2], yaws_rad: Sequence[float], rules: HeadRules
    ) -> None:
        self._inradius_m = rules.inradius_m
        self._centres = np.array(positions, dtype=np.float64).reshape(-1, 2)
        angles = np.array(yaws_rad, dtype=np.float64)[:, None] + THIRD_RAD * np.arange(3)
        corners = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        # The side opposite to a corner has the opposite normal.
        self._normals = -corners
        self._corners = self._centres[:, None] + 2 * self._inradius_m * corners

    def apart(self, head: int, others: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Return a mask of the other heads that do not overlap with a head, shape as `others`."""
        least_m = self._inradius_m - _TOUCH_M
        mine = (self._corners[others] - self._centres[head]) @ self._normals[head].T
        theirs = np.einsum(
            "nkc,nac->nka",
            self._corners[head] - self._centres[others][:, None],
            self._normals[others],
        )
        separated: NDArray[np.bool_] = (mine.min(axis=1) >= least_m).any(axis=1)
        separated |= (theirs.min(axis=1) >= least_m).any(axis=1)
        return separated


def overlap(head: Head, other: Head, rules: HeadRules) -> bool:
    """Return whether two heads overlap; touching does not count."""
    shapes = HeadShapes([head.position, other.position], [head.yaw_rad, other.yaw_rad], rules)
    return not shapes.apart(0, np.array([1]))[0]


MOST_HEADS = 2_000
"""More heads than this to choose from are too many for one task."""

_TOLERANCE_M = 1e-9


@dataclass(frozen=True)
class HeadGrid:
    """The heads to choose from, numbered along the segment from 0, the first, to `last`.

    Parameters
    ----------
    segment
        Segment to support.
    start, end
        The given heads at its start and its end.
    rules
        Rules for placing heads.
    holdable
        Returns whether a base can hold a head at a point; None if that is not required. The heads
        at the ends are given and not checked.
    """

    segment: Segment
    start: Head
    end: Head
    rules: HeadRules
    holdable: Callable[[Point2], bool] | None = None

    @cached_property
    def cells(self) -> int:
        """Equal parts of the segment, between which heads may lie."""
        return max(1, math.ceil(self.segment.length_m / self.rules.step_m - 1e-9))

    @cached_property
    def headings(self) -> tuple[float, ...]:
        """Yaws to try [rad]: evenly spaced from the direction of travel, then those at both ends.

        With the latter, heads need not turn where those at the vertices do not.
        """
        rules = self.rules
        along = self.segment.heading_at(self.segment.length_m / 2, rules.side_m)
        tried = [along + THIRD_RAD * o / rules.orientations for o in range(rules.orientations)]
        yaws: list[float] = []
        for yaw in (*tried, self.start.yaw_rad, self.end.yaw_rad):
            if not any(same_yaw(yaw, known) for known in yaws):
                yaws.append(normal_yaw(yaw))
        return tuple(yaws)

    @cached_property
    def last(self) -> int:
        """The number of the head at the end."""
        return (self.cells - 1) * len(self.headings) + 1

    def key(self, node: int) -> tuple[int, int]:
        """Return the grid point, from 1, and the number of the heading of a head between."""
        point, heading = divmod(node - 1, len(self.headings))
        return point + 1, heading

    def distance_m(self, node: int) -> float:
        """Return the position of a head along the segment [m]."""
        if node in (0, self.last):
            return 0.0 if node == 0 else self.segment.length_m
        return self.segment.length_m * self.key(node)[0] / self.cells

    def yaw_rad(self, node: int) -> float:
        """Return the yaw of a head [rad]."""
        if node in (0, self.last):
            return (self.start if node == 0 else self.end).yaw_rad
        return self.headings[self.key(node)[1]]

    def head(self, node: int) -> Head:
        """Return one of the heads between the vertices."""
        distance_m = self.distance_m(node)
        return Head(
            self.segment.point_at(distance_m),
            self.yaw_rad(node),
            HeadKind.INTERMEDIATE,
            self.segment.index,
            distance_m,
        )

    @cached_property
    def stretches(self) -> NDArray[np.float64]:
        """Start and end of the stretch supported by each head, shape (heads, 2) [m]."""
        supported = SupportedStretch(self.segment, self.rules)
        nodes = range(self.last + 1)
        return np.array([supported.at(self.distance_m(n), self.yaw_rad(n)) for n in nodes])

    @cached_property
    def shapes(self) -> HeadShapes:
        """The triangles of all heads."""
        nodes = range(self.last + 1)
        positions = [self.segment.point_at(self.distance_m(n)) for n in nodes]
        return HeadShapes(positions, [self.yaw_rad(n) for n in nodes], self.rules)

    def after(self, node: int) -> NDArray[np.intp]:
        """Return the heads further along that do not overlap with one."""
        ahead = 1 if node == 0 else self.key(node)[0] * len(self.headings) + 1
        others = np.arange(ahead, self.last + 1, dtype=np.intp)
        apart = self.shapes.apart(node, others)
        if node == 0:
            apart[-1] = True  # Both are given.
        return others[apart]

    def gaps_m(self, node: int, others: NDArray[np.intp]) -> NDArray[np.float64]:
        """Return the unsupported length between a head and each later head [m]."""
        bare: NDArray[np.float64] = self.stretches[others, 0] - self.stretches[node, 1]
        return np.maximum(bare, 0.0)

    @cached_property
    def arrows(self) -> dict[int, dict[int, float]]:
        """Unsupported length [m] by head and next head, for heads on a path from first to last."""
        limit_m = self.rules.max_gap_m + _TOLERANCE_M
        following: dict[int, dict[int, float]] = {}
        reached = {0}
        for node in range(self.last):
            if node not in reached:
                continue
            others = self.after(node)
            bare_m = self.gaps_m(node, others)
            near = (bare_m <= limit_m) & self._allowed[others]
            following[node] = dict(zip(others[near].tolist(), bare_m[near].tolist(), strict=True))
            reached |= following[node].keys()
        useful = {self.last}
        for node in sorted(following, reverse=True):
            following[node] = {n: bare for n, bare in following[node].items() if n in useful}
            if following[node]:
                useful.add(node)
        return {node: ahead for node, ahead in following.items() if ahead}

    @cached_property
    def _allowed(self) -> NDArray[np.bool_]:
        """The heads that a base can hold, and those at the ends, shape (heads,)."""
        allowed = np.ones(self.last + 1, dtype=np.bool_)
        if self.holdable is not None:
            for node in range(1, self.last, len(self.headings)):
                held = self.holdable(self.segment.point_at(self.distance_m(node)))
                allowed[node : node + len(self.headings)] = held
            allowed[self.last] = True
        return allowed

    @cached_property
    def fault(self) -> str | None:
        """Why the segment cannot be supported."""
        label = f"segment {self.segment.index + 1}, {self.segment.length_m:.3f} m long,"
        if self.last - 1 > MOST_HEADS:
            return (
                f"{label} would have {self.last - 1:,} heads to choose from, more than "
                f"{MOST_HEADS:,}; make step_m longer than {self.rules.step_m:g} m."
            )
        if self.arrows:
            return None
        least_m = math.ceil(self._least_gap_m() * 1e4) / 1e4
        return (
            f"{label} cannot be supported: heads on a grid of {self.rules.step_m:g} m leave "
            f"{least_m:.4f} m bare at best, and max_gap_m allows {self.rules.max_gap_m:g}. Raise "
            "max_gap_m, or make step_m finer."
        )

    def _least_gap_m(self) -> float:
        """Return the longest bare stretch of the heads that keep it shortest [m]."""
        least_m = np.full(self.last + 1, np.inf)
        least_m[0] = 0.0
        for node in range(self.last):
            others = self.after(node)
            widest_m = np.maximum(least_m[node], self.gaps_m(node, others))
            least_m[others] = np.minimum(least_m[others], widest_m)
        return float(least_m[self.last])

    def cost(self, node: int, other: int) -> float:
        """Return the cost of placing a head after another: 1 unless it is the last, plus a turn."""
        same = same_yaw(self.yaw_rad(node), self.yaw_rad(other))
        return (other != self.last) + (0.0 if same else self.rules.reorientation_cost)

    def cheapest(self) -> tuple[int, ...]:
        """Return the heads of least cost from the first, without it, to the last.

        Dynamic programming. Of equals it takes the fewest heads, then the least sum of squares
        of the stretches that lie bare.
        """
        # Rounded, so that sums are equal in any order, and equal for an arc and its chords.
        digits = 5 if self.segment.is_resampled else 9
        to_go = {self.last: (0.0, 0, 0.0)}
        following: dict[int, int] = {}
        for node in sorted(self.arrows, reverse=True):
            paths = []
            for other, bare_m in self.arrows[node].items():
                cost, count, uneven = to_go[other]
                cost = round(cost + self.cost(node, other), 9)
                uneven = round(uneven + bare_m**2, digits)
                paths.append(((cost, count + 1, uneven), other))
            to_go[node], following[node] = min(paths)
        nodes, node = [], 0
        while node != self.last:
            node = following[node]
            nodes.append(node)
        return tuple(nodes)
