"""The geometry of triangular heads: what they support of a segment, and which of them overlap."""

from __future__ import annotations

import bisect
import itertools
import math
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from skillplan_swarmitfix.heads.heads import THIRD_RAD, Head, HeadRules
from skillplan_swarmitfix.trajectory.plane_point import Point2
from skillplan_swarmitfix.trajectory.workpiece import Segment

_TOUCH_M = 1e-9


class SupportedStretch:
    """Which stretch of a segment a head supports: what of it lies within the triangle.

    Of a curve it is the connected piece around the centre of the head, followed chord by chord.

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
        """Return where the stretch begins and ends, as distances along the segment [m].

        Parameters
        ----------
        distance_m
            Of the head's centre, in [0, length of the segment] [m].
        yaw_rad
            Of the head [rad].
        """
        points = self._segment.points
        centre = self._segment.point_at(distance_m)
        after = bisect.bisect_right(self._travelled, distance_m)
        before = bisect.bisect_left(self._travelled, distance_m)
        ahead_m = self._inside(centre, yaw_rad, itertools.islice(points, after, None))
        back_m = self._inside(centre, yaw_rad, (points[i] for i in range(before - 1, -1, -1)))
        return max(0.0, distance_m - back_m), min(self._segment.length_m, distance_m + ahead_m)

    def _inside(self, centre: Point2, yaw_rad: float, path: Iterable[Point2]) -> float:
        """Return how long the path from the centre stays within the triangle."""
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
    """The triangles of some heads, to find which of them lie apart.

    Two triangles lie apart exactly where a line along a side of one of them separates them
    (separating axis theorem); heads that touch lie apart.

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

    def apart(self, one: int, others: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Return which of the other heads do not overlap with one, shape as `others`."""
        least_m = self._inradius_m - _TOUCH_M
        mine = (self._corners[others] - self._centres[one]) @ self._normals[one].T
        theirs = np.einsum(
            "nkc,nac->nka",
            self._corners[one] - self._centres[others][:, None],
            self._normals[others],
        )
        separated: NDArray[np.bool_] = (mine.min(axis=1) >= least_m).any(axis=1)
        separated |= (theirs.min(axis=1) >= least_m).any(axis=1)
        return separated


def overlap(one: Head, other: Head, rules: HeadRules) -> bool:
    """Whether two heads overlap; touching is none."""
    shapes = HeadShapes([one.position, other.position], [one.yaw_rad, other.yaw_rad], rules)
    return not shapes.apart(0, np.array([1]))[0]
