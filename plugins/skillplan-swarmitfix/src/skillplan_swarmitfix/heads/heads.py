"""Heads: the equilateral triangles that support the sheet from below along a tool trajectory.

Veeramani and Muthuswamy 2022, section 4.1.2: heads at the vertices first, then heads between them.
The centre of a head lies on the trajectory. A third of a turn leaves a head as it was, so that
yaws are in [0, 2 pi / 3). A yaw is the direction from the centre to a corner.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum

from skillplan_swarmitfix.trajectory.path_elements import Point2
from skillplan_swarmitfix.trajectory.workpiece import Segment, VertexKind, Workpiece

THIRD_RAD = math.tau / 3
"""A turn that leaves a head as it was [rad]."""

_SAME_RAD = 1e-9


class HeadKind(StrEnum):
    """Place of a head: at a vertex, or between two."""

    VERTEX = "vertex"
    INTERMEDIATE = "intermediate"


@dataclass(frozen=True, slots=True)
class HeadRules:
    """Rules for placing heads.

    Parameters
    ----------
    side_m
        Side of the triangular head, > 0 [m].
    max_gap_m
        Longest stretch of the trajectory between two heads that may lie bare, >= 0 [m].
    step_m
        Intermediate heads lie on a grid along the segment no coarser than this, > 0 [m].
    orientations
        Headings tried, evenly over a third of a turn from the direction of travel, >= 1.
    reorientation_cost
        Weight of turning the head, in supports, in [0, 1).

    Raises
    ------
    ValueError
        If a figure is out of its range or not finite.
    """

    side_m: float = 0.10
    max_gap_m: float = 0.20
    step_m: float = 0.02
    orientations: int = 2
    reorientation_cost: float = 0.1

    def __post_init__(self) -> None:
        for name in ("side_m", "step_m"):
            if not 0 < getattr(self, name) < math.inf:
                raise ValueError(
                    f"HeadRules {name} must be finite and > 0, not {getattr(self, name)}."
                )
        if not 0 <= self.max_gap_m < math.inf:
            raise ValueError(f"HeadRules max_gap_m must be finite and >= 0, not {self.max_gap_m}.")
        if self.orientations < 1:
            raise ValueError(f"HeadRules orientations must be >= 1, not {self.orientations}.")
        if not 0 <= self.reorientation_cost < 1:
            raise ValueError(
                f"HeadRules reorientation_cost must be in [0, 1), not {self.reorientation_cost}."
            )

    @property
    def inradius_m(self) -> float:
        """From a head's centre to the middle of a side [m]."""
        return self.side_m / (2 * math.sqrt(3))


@dataclass(frozen=True, slots=True)
class Head:
    """A head below the sheet.

    Parameters
    ----------
    position
        Its centre, on the trajectory [m].
    yaw_rad
        Direction from its centre to a corner, in [0, 2 pi / 3) [rad].
    kind
        Place of the head: at a vertex, or between two.
    segment
        Index of its segment; at a vertex the segment that starts there.
    distance_m
        From the start of that segment along it, >= 0 [m].

    Raises
    ------
    ValueError
        If the yaw or the distance is out of range.
    """

    position: Point2
    yaw_rad: float
    kind: HeadKind
    segment: int
    distance_m: float

    def __post_init__(self) -> None:
        if not 0 <= self.yaw_rad < THIRD_RAD:
            raise ValueError(f"Head yaw_rad must be in [0, 2 pi / 3), not {self.yaw_rad}.")
        if not 0 <= self.distance_m < math.inf:
            raise ValueError(f"Head distance_m must be finite and >= 0, not {self.distance_m}.")


def normal_yaw(yaw_rad: float) -> float:
    """Return the yaw in [0, 2 pi / 3) that stands for the same triangle [rad]."""
    yaw_rad %= THIRD_RAD
    return 0.0 if THIRD_RAD - yaw_rad <= _SAME_RAD else yaw_rad


def same_yaw(one_rad: float, other_rad: float) -> bool:
    """Return whether two yaws give the same triangle."""
    return abs(math.remainder(one_rad - other_rad, THIRD_RAD)) <= _SAME_RAD


def vertex_heads(workpiece: Workpiece, rules: HeadRules) -> tuple[Head, ...]:
    """Return a head for every vertex, in order along the trajectory.

    An axis of symmetry of the head lies on the bisector of the vertex, so that it supports as much
    of the one segment as of the other. Of its two directions the one is taken that supports more:
    a corner into the vertex angle where that is below 60 degrees, and a side otherwise. At
    an end of an open trajectory a corner points along its only segment.
    """
    heads = []
    segments = workpiece.segments
    for i, vertex in enumerate(workpiece.vertices):
        ending = i == len(segments)
        segment = segments[i - 1] if ending else segments[i]
        distance_m = segment.length_m if ending else 0.0
        if vertex.kind is VertexKind.END:
            yaw = segment.heading_at(distance_m, rules.side_m) + (math.pi if ending else 0.0)
        else:
            before = segments[i - 1]
            back = before.heading_at(before.length_m, rules.side_m) + math.pi
            yaw = _bisecting_yaw(back, segment.heading_at(0.0, rules.side_m), vertex.kind)
        heads.append(
            Head(vertex.position, normal_yaw(yaw), HeadKind.VERTEX, segment.index, distance_m)
        )
    return tuple(heads)


def _bisecting_yaw(back_rad: float, ahead_rad: float, kind: VertexKind) -> float:
    """Return the yaw of a head between the two directions in which a trajectory leaves it."""
    half = math.remainder(ahead_rad - back_rad, math.tau) / 2
    if kind is VertexKind.SMOOTH:
        # Straight on: which side the bisector is on would be a matter of rounding.
        return ahead_rad + math.pi / 2
    bisector = back_rad + half
    return bisector if abs(half) < math.pi / 6 else bisector + math.pi


def even_heads(segment: Segment, subdivisions: int) -> tuple[Head, ...]:
    """Return the heads that divide a segment into equal parts, each with a corner ahead.

    Parameters
    ----------
    segment
        Segment to divide.
    subdivisions
        Number of parts, >= 1; there is one head fewer.

    Raises
    ------
    ValueError
        If there is less than one part.
    """
    if subdivisions < 1:
        raise ValueError(f"A segment has at least 1 subdivision, not {subdivisions}.")
    heads = []
    for part in range(1, subdivisions):
        distance_m = segment.length_m * part / subdivisions
        yaw = normal_yaw(segment.direction_at(distance_m))
        position = segment.point_at(distance_m)
        heads.append(Head(position, yaw, HeadKind.INTERMEDIATE, segment.index, distance_m))
    return tuple(heads)


def path_between(workpiece: Workpiece, heads: Sequence[Head]) -> Callable[[int, float], Point2]:
    """Return a function that gives points of the trajectory between consecutive heads.

    Parameters
    ----------
    workpiece
        The trajectory.
    heads
        In order along the trajectory, with one at every vertex.

    Returns
    -------
    Callable
        Maps the number of the first of two consecutive heads, from 0, and the share in [0, 1]
        of the path to the next, to the point [m].
    """

    def point(number: int, share: float) -> Point2:
        head, following = heads[number], heads[(number + 1) % len(heads)]
        segment = workpiece.segments[head.segment]
        same = following.segment == head.segment and following.distance_m > head.distance_m
        end_m = following.distance_m if same else segment.length_m
        return segment.point_at(head.distance_m + share * (end_m - head.distance_m))

    return point
