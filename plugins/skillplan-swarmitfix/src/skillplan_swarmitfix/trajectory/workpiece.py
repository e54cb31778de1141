"""The workpiece module: a tool trajectory split into segments, with its vertices.

It runs once for each trajectory and finds the segments, the vertices with their angles and types,
and how many there are of each (Veeramani and Muthuswamy 2022, Sec. 4.1.1). An element of the
trajectory is a segment, curved or straight; where two of them meet is a vertex. If heads are
planned, elements that meet nearly in line are one segment: an arc needs as many heads as the lines
that a program writes instead of it.
"""

from __future__ import annotations

import bisect
import itertools
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Self

from skillplan.errors import Issue
from skillplan_swarmitfix.trajectory.faults import faults, joined
from skillplan_swarmitfix.trajectory.path_elements import (
    SAME_POINT_M,
    Element,
    Point2,
    end_directions,
    measure_m,
    sample,
)

__all__ = [
    "ANGLE_TOLERANCE_RAD",
    "Corner",
    "Segment",
    "Vertex",
    "VertexKind",
    "Workpiece",
    "faults",
]

ANGLE_TOLERANCE_RAD = math.radians(0.1)
"""Angles as near as this to a straight or a right one count as such [rad]."""

CORNER_RAD = math.radians(20)
"""A joint of two elements that turns by more is a corner [rad]."""


class VertexKind(StrEnum):
    """Kind of turn at a vertex."""

    END = "end"
    """An open trajectory starts or ends here."""
    SMOOTH = "smooth"
    """It goes straight on: two lines in a row, or a curve that leaves along its tangent."""
    CONVEX = "convex"
    """Closed trajectory: the interior angle is less than pi."""
    REFLEX = "reflex"
    """Closed trajectory: the interior angle is more than pi."""
    LEFT = "left"
    """Open trajectory: it turns to the left."""
    RIGHT = "right"
    """Open trajectory: it turns to the right."""


class Corner(StrEnum):
    """Angle between the two segments at a vertex, on the narrower side."""

    ACUTE = "acute"
    RIGHT = "right"
    OBTUSE = "obtuse"
    STRAIGHT = "straight"


@dataclass(frozen=True, slots=True)
class Vertex:
    """A vertex between two segments, or an end of an open trajectory.

    Parameters
    ----------
    position
        Position [m].
    angle_rad
        The vertex angle, in (0, 2 pi): between the tangents, on the inside of a closed trajectory
        and to the left of an open one. pi is straight on, and is given to an end [rad].
    kind
        Kind of turn.

    Raises
    ------
    ValueError
        If the angle is out of range.
    """

    position: Point2
    angle_rad: float
    kind: VertexKind

    def __post_init__(self) -> None:
        if not 0 < self.angle_rad < math.tau:
            raise ValueError(f"A vertex angle is within (0, 2 pi), not {self.angle_rad!r}.")

    @property
    def corner(self) -> Corner:
        """Angle of the corner on its narrower side."""
        narrower = min(self.angle_rad, math.tau - self.angle_rad)
        if math.pi - narrower <= ANGLE_TOLERANCE_RAD:
            return Corner.STRAIGHT
        if abs(narrower - math.pi / 2) <= ANGLE_TOLERANCE_RAD:
            return Corner.RIGHT
        return Corner.ACUTE if narrower < math.pi / 2 else Corner.OBTUSE


@dataclass(frozen=True, slots=True)
class Segment:
    """A trajectory between two vertices.

    Parameters
    ----------
    index
        Its number along the trajectory, from 0: that of its element. A line that closes the
        trajectory comes last.
    points
        Its start and its end; on a curve also the sampled points between them [m].
    curve_m
        Length of the curve that the chords stand for [m]; None for that of the chords.
    is_resampled
        True if its headings must not depend on how it was written.

    Raises
    ------
    ValueError
        If there are fewer than two points, or two consecutive ones are equal.
    """

    index: int
    points: tuple[Point2, ...]
    curve_m: float | None = None
    is_resampled: bool = False
    _travelled: tuple[float, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if len(self.points) < 2:
            raise ValueError(f"Segment {self.index} needs two points or more.")
        steps = list(itertools.starmap(math.dist, itertools.pairwise(self.points)))
        if not all(step > 0 for step in steps):
            raise ValueError(f"Segment {self.index} has two consecutive points that are equal.")
        object.__setattr__(self, "_travelled", (0.0, *itertools.accumulate(steps)))

    @property
    def start(self) -> Point2:
        """Start [m]."""
        return self.points[0]

    @property
    def end(self) -> Point2:
        """End [m]."""
        return self.points[-1]

    @property
    def is_curved(self) -> bool:
        """Return whether it bends."""
        return len(self.points) > 2

    @property
    def length_m(self) -> float:
        """Its length along its chords, by which points on it are given [m]."""
        return self._travelled[-1]

    @property
    def true_length_m(self) -> float:
        """Length of the curve itself [m]."""
        return self.length_m if self.curve_m is None else self.curve_m

    def halves(self) -> tuple[Segment, Segment]:
        """Return the two halves of its length; the second one has the next index."""
        middle_m = self.length_m / 2
        chord = bisect.bisect_left(self._travelled, middle_m - 1e-9 * self.length_m)
        rest = self.points[chord:]
        middle = self.point_at(middle_m)
        if self._travelled[chord] - middle_m <= 1e-9 * self.length_m:
            middle, rest = self.points[chord], self.points[chord + 1 :]
        half_m = self.true_length_m / 2
        return (
            Segment(self.index, (*self.points[:chord], middle), half_m, self.is_resampled),
            Segment(self.index + 1, (middle, *rest), half_m, self.is_resampled),
        )

    def point_at(self, distance_m: float) -> Point2:
        """Return the point a distance in [0, `length_m`] from the start along the chords [m].

        Raises
        ------
        ValueError
            If the segment does not reach that far, by more than rounding.
        """
        chord, (ax, ay), (bx, by) = self._chord(distance_m)
        begin, end = self._travelled[chord], self._travelled[chord + 1]
        share = min(1.0, max(0.0, (distance_m - begin) / (end - begin)))
        # Weighing both ends gives either of them back exactly.
        return ((1 - share) * ax + share * bx, (1 - share) * ay + share * by)

    def direction_at(self, distance_m: float) -> float:
        """Return the direction of travel on the chord at a distance [m], in (-pi, pi] [rad].

        At a joint of two chords the next one counts. Raises like `point_at`.
        """
        _, (ax, ay), (bx, by) = self._chord(distance_m)
        return math.atan2(by - ay, bx - ax)

    def heading_at(self, distance_m: float, window_m: float) -> float:
        """Return the direction of travel for a head at a distance, in (-pi, pi] [rad].

        On a resampled curve it is that of the secant over a window, which does not depend on the
        chords; otherwise it is `direction_at`. The window ends at the ends of the segment, and is
        as long on either side unless the distance is that of an end. Raises like `point_at`.
        """
        if not (self.is_resampled and self.is_curved):
            return self.direction_at(distance_m)
        before_m = min(distance_m, window_m / 2)
        after_m = min(self.length_m - distance_m, window_m / 2)
        if min(before_m, after_m) > 1e-9:
            before_m = after_m = min(before_m, after_m)
        (ax, ay), (bx, by) = (
            self.point_at(distance_m - before_m),
            self.point_at(distance_m + after_m),
        )
        if math.dist((ax, ay), (bx, by)) <= SAME_POINT_M:
            return self.direction_at(distance_m)
        return math.atan2(by - ay, bx - ax)

    def _chord(self, distance_m: float) -> tuple[int, Point2, Point2]:
        slack = 1e-9 * max(1.0, self.length_m)
        if not -slack <= distance_m <= self.length_m + slack:
            raise ValueError(
                f"Segment {self.index} is {self.length_m:g} m long; it has no point "
                f"{distance_m:g} m from its start."
            )
        chord = bisect.bisect_right(self._travelled, distance_m) - 1
        chord = min(max(chord, 0), len(self.points) - 2)
        return chord, self.points[chord], self.points[chord + 1]


@dataclass(frozen=True)
class Workpiece:
    """A tool trajectory as the planner needs it.

    Parameters
    ----------
    closed
        True if it ends at its start.
    vertices
        In order along the trajectory. Segment i leads from vertex i to the next, of a closed one
        the last one back to vertex 0.
    segments
        In order along the trajectory.
    clockwise
        The sense in which a closed trajectory runs round its inside; None of an open one.

    Raises
    ------
    ValueError
        If the parts do not fit together.
    """

    closed: bool
    vertices: tuple[Vertex, ...]
    segments: tuple[Segment, ...]
    clockwise: bool | None

    def __post_init__(self) -> None:
        if len(self.vertices) != len(self.segments) + (not self.closed) or not self.segments:
            raise ValueError(
                f"{len(self.segments)} segments do not fit {len(self.vertices)} vertices."
            )
        if (self.clockwise is None) == self.closed:
            raise ValueError("A closed trajectory has a sense, an open one has none.")
        # Beyond the last vertex a closed trajectory goes on with the first.
        around = itertools.cycle(vertex.position for vertex in self.vertices)
        for segment, (start, end) in zip(self.segments, itertools.pairwise(around), strict=False):
            if (segment.start, segment.end) != (start, end):
                raise ValueError(f"Segment {segment.index} does not join its vertices.")

    @classmethod
    def from_elements(
        cls,
        start: Point2,
        elements: Sequence[Element],
        *,
        closed: bool,
        chord_tolerance_m: float,
        corner_rad: float | None = None,
    ) -> Self:
        """Split a trajectory at the joints of its elements.

        Parameters
        ----------
        start
            Start of the first element, in the frame of the bench [m].
        elements
            Its elements in order along the trajectory.
        closed
            True if a line leads back to the start, unless the last element does already.
        chord_tolerance_m
            Greatest distance between a curve and the chords that stand for it, >= 1e-7 [m].
        corner_rad
            Only joints that turn by more than this are vertices, and the start [rad]. A
            closed trajectory has another vertex in its middle if it has none else. None: every
            joint is a vertex.

        Raises
        ------
        ValueError
            If there are `faults`, with all of them, a line each.
        """
        problems = faults(start, elements, closed, chord_tolerance_m, outline=None)
        if problems:
            issues = (Issue(message, _within_elements(path)) for message, path in problems)
            raise ValueError("\n".join(map(str, issues)))
        whole = joined(start, elements, closed=closed)
        starts = [start, *(element.end for element in whole)]
        parts = [
            Segment(
                i, (begin, *sample(begin, element, chord_tolerance_m)), measure_m(begin, element)
            )
            for i, (begin, element) in enumerate(zip(starts, whole, strict=False))
        ]
        tangents = [end_directions(*pair) for pair in zip(starts, whole, strict=False)]
        turns = []
        for i, part in enumerate(parts):
            before = parts[i - 1]
            turn = _turn(tangents[i - 1][1], tangents[i][0])
            if math.pi - abs(turn) <= 1e-6:
                # The tangents at the tip of a cusp do not determine the inside.
                turn = _turn(before.direction_at(before.length_m), part.direction_at(0.0))
            turns.append(turn)
        clockwise = _signed_area(parts) < 0 if closed else None
        segments, turns = _fused(parts, turns, corner_rad, closed=closed)
        vertices = [
            Vertex(segment.start, math.pi, VertexKind.END)
            if i == 0 and not closed
            else _vertex(segment.start, turns[i], clockwise)
            for i, segment in enumerate(segments)
        ]
        if not closed:
            vertices.append(Vertex(segments[-1].end, math.pi, VertexKind.END))
        return cls(closed, tuple(vertices), tuple(segments), clockwise)

    @property
    def length_m(self) -> float:
        """Length of the whole trajectory, of curves that of the curves themselves [m]."""
        return math.fsum(segment.true_length_m for segment in self.segments)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """The smallest rectangle around it: x low, y low, x high, y high [m]."""
        xs, ys = zip(*(point for segment in self.segments for point in segment.points), strict=True)
        return (min(xs), min(ys), max(xs), max(ys))

    @property
    def vertex_counts(self) -> dict[VertexKind, int]:
        """Number of vertices of each kind, without absent kinds."""
        counts = Counter(vertex.kind for vertex in self.vertices)
        return {kind: counts[kind] for kind in VertexKind if counts[kind]}


def _fused(
    parts: Sequence[Segment], turns: Sequence[float], corner_rad: float | None, *, closed: bool
) -> tuple[list[Segment], list[float]]:
    """Return segments from corner to corner, and the turn at the start of each."""
    if corner_rad is None:
        return list(parts), list(turns)
    begins = [i for i, turn in enumerate(turns) if i == 0 or abs(turn) > corner_rad]
    segments = []
    for index, (begin, end) in enumerate(itertools.pairwise([*begins, len(parts)])):
        run = parts[begin:end]
        points = [run[0].start, *itertools.chain.from_iterable(part.points[1:] for part in run)]
        length_m = math.fsum(part.true_length_m for part in run)
        segments.append(Segment(index, tuple(points), length_m, is_resampled=True))
    heads = [turns[i] for i in begins]
    if closed and len(segments) == 1:
        return list(segments[0].halves()), [heads[0], 0.0]
    return segments, heads


def _vertex(position: Point2, turn_rad: float, clockwise: bool | None) -> Vertex:
    angle = math.pi + turn_rad if clockwise else math.pi - turn_rad
    if abs(turn_rad) <= ANGLE_TOLERANCE_RAD:
        kind = VertexKind.SMOOTH
    elif clockwise is None:
        kind = VertexKind.LEFT if turn_rad > 0 else VertexKind.RIGHT
    else:
        kind = VertexKind.CONVEX if angle < math.pi else VertexKind.REFLEX
    return Vertex(position, angle, kind)


def _within_elements(path: tuple[str | int, ...]) -> tuple[str | int, ...]:
    return ("elements", *path) if path and isinstance(path[0], int) else path


def _turn(before_rad: float, after_rad: float) -> float:
    """Return the change of direction: > 0 to the left, in [-pi, pi]."""
    return math.remainder(after_rad - before_rad, math.tau)


def _signed_area(segments: Sequence[Segment]) -> float:
    """Return the enclosed area, > 0 if it lies to the left [m^2]."""
    x, y = segments[0].start
    return 0.5 * math.fsum(
        (ax - x) * (by - y) - (bx - x) * (ay - y)
        for segment in segments
        for (ax, ay), (bx, by) in itertools.pairwise(segment.points)
    )
