"""The elements a tool trajectory is written in: lines, circular arcs and splines.

An element starts where the one before it ends, so that it holds its end only. Coordinates are in
the frame of the bench [m]. An arc is given by a point on it, which leaves no doubt about its side
or its sense.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

Point2 = tuple[float, float]

SAME_POINT_M = 1e-6
"""Distance below which points are equal [m], far below the accuracy of a bench."""

MAX_COORDINATE_M = 1e6
"""Greatest absolute value of a coordinate [m]; up to it rounding stays below 1e-9 m."""

MOST_READ_M = 1e8
"""Greatest absolute value of a coordinate in a file [m], which may be one of a map."""


def on_any_bench(point: Point2) -> bool:
    """Return whether both coordinates are finite and within `MAX_COORDINATE_M`."""
    return all(abs(coordinate) <= MAX_COORDINATE_M for coordinate in point)


def shown(point: Point2) -> str:
    """Return a point [m] as messages show it: ``(0.34, -1.2) m``."""
    return f"({point[0]:.9g}, {point[1]:.9g}) m"


BezierSpan = tuple[Point2, Point2, Point2, Point2]


def bezier_spans(points: Sequence[Point2], *, closed: bool) -> list[BezierSpan]:
    """Return the spans between consecutive points, each as its four control points [m].

    Parameters
    ----------
    points
        At least two, of which no two consecutive ones are the same [m].
    closed
        True if the curve continues smoothly from its last point, which is its first, to its second;
        needs four points or more. Otherwise it continues at either end as if its last span were
        mirrored there, so that the curvature runs out.
    """
    if closed:
        before, after = points[-2], points[1]
    else:
        before, after = _mirrored(points[1], points[0]), _mirrored(points[-2], points[-1])
    padded = [before, *points, after]
    return [
        (b, _handle(a, b, c), _handle(d, c, b), c)
        for a, b, c, d in zip(padded, padded[1:], padded[2:], padded[3:], strict=False)
    ]


def chords_needed(span: BezierSpan, tolerance_m: float) -> int:
    """Return the number of chords, even in the parameter, within the tolerance of a span [m].

    A chord over 1/n of a span is off it by no more than |B''| / (8 n^2), and |B''| is no more
    than 6 times the greatest second difference of the control points (Wang's formula).
    """
    return max(1, math.ceil(math.sqrt(deviation_m(span, 1) / tolerance_m)))


def deviation_m(span: BezierSpan, chords: int) -> float:
    """Return an upper bound of the distance of a span from its chords [m].

    Wang's formula, as in `chords_needed`.
    """
    a, b, c, d = span
    bend = max(_second_difference(a, b, c), _second_difference(b, c, d))
    return 0.75 * bend / chords**2


def point_of(span: BezierSpan, t: float) -> Point2:
    """Return the point of a span at the parameter `t` in [0, 1] [m]."""
    u = 1 - t
    weights = (u * u * u, 3 * u * u * t, 3 * u * t * t, t * t * t)
    x, y = (
        sum(weight * point[axis] for weight, point in zip(weights, span, strict=True))
        for axis in (0, 1)
    )
    return (x, y)


def _handle(a: Point2, b: Point2, c: Point2) -> Point2:
    """Return the control point that follows `b` on the curve from `a` through `b` to `c`."""
    before, after = math.dist(a, b), math.dist(b, c)
    root = math.sqrt(before * after)
    scale = 3 * (before + root)
    back, here, ahead = -after / scale, (2 * before + 3 * root + after) / scale, before / scale
    return (back * a[0] + here * b[0] + ahead * c[0], back * a[1] + here * b[1] + ahead * c[1])


def _mirrored(point: Point2, at: Point2) -> Point2:
    return (2 * at[0] - point[0], 2 * at[1] - point[1])


def _second_difference(a: Point2, b: Point2, c: Point2) -> float:
    return math.hypot(a[0] - 2 * b[0] + c[0], a[1] - 2 * b[1] + c[1])


MIN_CHORD_TOLERANCE_M = 1e-7
"""Finest chord tolerance [m]."""

MAX_CHORDS = 100_000
"""Most chords that one element, or one trajectory, is sampled to."""

FLAT_RAD = 1e-6
"""An arc is a line where the directions to its two other points differ by less [rad]."""

_WIDEST_CHORD_RAD = math.pi / 4


@dataclass(frozen=True, slots=True)
class Line:
    """A straight element.

    Parameters
    ----------
    end
        End point [m].
    """

    end: Point2


@dataclass(frozen=True, slots=True)
class Arc:
    """A circular arc of less than a full turn; a full circle is two of them.

    Parameters
    ----------
    end
        End point [m].
    through
        A point on the arc between its ends [m].
    """

    end: Point2
    through: Point2


@dataclass(frozen=True, slots=True)
class Spline:
    """A centripetal Catmull-Rom curve, closed smoothly if it ends at its start.

    Parameters
    ----------
    through
        The points that it passes through in turn [m], without its start; the last is its end.

    Raises
    ------
    ValueError
        If no point is given.
    """

    through: tuple[Point2, ...]

    def __post_init__(self) -> None:
        if not self.through:
            raise ValueError("A spline needs at least one point, which is its end.")

    @property
    def end(self) -> Point2:
        """End point [m]."""
        return self.through[-1]


Element = Line | Arc | Spline


@dataclass(frozen=True, slots=True)
class ArcCircle:
    """An arc by its circle.

    Parameters
    ----------
    centre
        Its centre [m].
    radius_m
        Its radius, > 0 [m].
    start_rad
        Direction from the centre to the start of the arc [rad].
    sweep_rad
        Angle that the arc turns through: > 0 counter-clockwise, in (-2 pi, 2 pi) [rad].
    """

    centre: Point2
    radius_m: float
    start_rad: float
    sweep_rad: float

    def at(self, fraction: float) -> Point2:
        """Return the point at a fraction in [0, 1] of the arc [m]."""
        angle = self.start_rad + fraction * self.sweep_rad
        return (
            self.centre[0] + self.radius_m * math.cos(angle),
            self.centre[1] + self.radius_m * math.sin(angle),
        )


def circle_of(start: Point2, arc: Arc) -> ArcCircle:
    """Return the circle of an arc that starts at `start` [m].

    Raises
    ------
    ValueError
        If its three points lie on a line or two of them are one.
    """
    points = (start, arc.through, arc.end)
    for point, other in itertools.combinations(points, 2):
        if math.dist(point, other) <= SAME_POINT_M:
            raise ValueError(
                f"Two of the arc's three points are the same, {shown(point)}; give three that "
                "differ, and write a full circle as two arcs."
            )
    ax, ay = arc.through[0] - start[0], arc.through[1] - start[1]
    bx, by = arc.end[0] - start[0], arc.end[1] - start[1]
    a, b = math.hypot(ax, ay), math.hypot(bx, by)
    cross = ax * by - ay * bx
    if abs(cross) <= FLAT_RAD * a * b:
        raise ValueError(
            f"The arc's points {', '.join(map(shown, points))} lie on a line; "
            "move the point between the ends off it, or write a line."
        )
    x = (by * a * a - ay * b * b) / (2 * cross)
    y = (ax * b * b - bx * a * a) / (2 * cross)
    start_rad = math.atan2(-y, -x)
    sweep_rad = (math.atan2(by - y, bx - x) - start_rad) % math.tau
    return ArcCircle(
        centre=(start[0] + x, start[1] + y),
        radius_m=math.hypot(x, y),
        start_rad=start_rad,
        sweep_rad=sweep_rad if cross > 0 else sweep_rad - math.tau,
    )


def points_of(element: Element) -> tuple[Point2, ...]:
    """Return the points an element is written with, in order, without its start [m]."""
    match element:
        case Arc(end, through):
            return (through, end)
        case Spline(points):
            return points
    return (element.end,)


def sample(start: Point2, element: Element, chord_tolerance_m: float) -> list[Point2]:
    """Return points on an element such that the chords between them stay near it.

    Parameters
    ----------
    start
        Start of the element [m].
    element
        Element to sample.
    chord_tolerance_m
        Greatest distance between the element and its chords, >= 1e-7 [m].

    Returns
    -------
    list of Point2
        The points after `start`; the last is the element's end exactly. A line has one, an arc or
        a spline has two or more.

    Raises
    ------
    ValueError
        If the tolerance or a coordinate is out of range, if two consecutive points are the same
        or an arc's points lie on a line, or if more than `MAX_CHORDS` chords were needed.
    """
    refuse_tolerance(chord_tolerance_m)
    for point in (start, *points_of(element)):
        if not on_any_bench(point):
            raise ValueError(
                f"The point {shown(point)} is on no bench; "
                f"give finite coordinates within {MAX_COORDINATE_M:g} m."
            )
    match element:
        case Arc():
            return _sample_arc(circle_of(start, element), element.end, chord_tolerance_m)
        case Spline():
            return _sample_spline(_spans(start, element), chord_tolerance_m)
    _refuse_equal(start, element.end)
    return [element.end]


def sampling_error_m(start: Point2, element: Element, chord_tolerance_m: float) -> float:
    """Return an upper bound of the distance of an element from its sampled chords [m].

    It is exact for an arc, and 0 for a line.

    Parameters
    ----------
    start, element, chord_tolerance_m
        As in `sample`, which accepts them.
    """
    match element:
        case Arc():
            circle = circle_of(start, element)
            step_rad = abs(circle.sweep_rad) / _arc_chords(circle, chord_tolerance_m)
            return 2 * circle.radius_m * math.sin(step_rad / 4) ** 2
        case Spline():
            spans = _spans(start, element)
            counts = _spline_chords(spans, chord_tolerance_m)
            return max(itertools.starmap(deviation_m, zip(spans, counts, strict=True)))
    return 0.0


def measure_m(start: Point2, element: Element) -> float:
    """Return the length of an element, of an arc that of the arc itself [m].

    A spline is integrated span by span (Gauss-Legendre, relative error below 1e-9 unless a span
    has a cusp).

    Raises
    ------
    ValueError
        As `sample`, but coordinates are not checked.
    """
    match element:
        case Arc():
            circle = circle_of(start, element)
            return circle.radius_m * abs(circle.sweep_rad)
        case Spline():
            return math.fsum(map(_measure_span_m, _spans(start, element)))
    return math.dist(start, element.end)


def find_point(start: Point2, element: Line | Arc, share: float) -> Point2:
    """Return the point at a share in [0, 1] of the length of a line or an arc [m]."""
    if isinstance(element, Arc):
        return circle_of(start, element).at(share)
    return (
        start[0] + share * (element.end[0] - start[0]),
        start[1] + share * (element.end[1] - start[1]),
    )


def refuse_tolerance(chord_tolerance_m: float) -> None:
    """Raise a ValueError if curves cannot be sampled to a chord tolerance [m]."""
    if not MIN_CHORD_TOLERANCE_M <= chord_tolerance_m < math.inf:
        raise ValueError(
            f"A chord tolerance of {chord_tolerance_m:g} m cannot be used; "
            f"give {MIN_CHORD_TOLERANCE_M:g} m or more."
        )


def end_directions(start: Point2, element: Element) -> tuple[float, float]:
    """Return the directions of travel at the start and at the end of an element [rad].

    They belong to the element, not to its chords.

    Raises
    ------
    ValueError
        As `sample`, but for the coordinates, which have to be in range.
    """
    match element:
        case Arc():
            circle = circle_of(start, element)
            first = circle.start_rad + math.copysign(math.pi / 2, circle.sweep_rad)
            return first, first + circle.sweep_rad
        case Spline():
            spans = _spans(start, element)
            return _direction(spans[0][0], spans[0][1]), _direction(spans[-1][2], spans[-1][3])
    _refuse_equal(start, element.end)
    direction = _direction(start, element.end)
    return direction, direction


def arc_or_line(start: Point2, end: Point2, through: Point2) -> Arc | Line:
    """Return the arc by three points [m], or a line where it is too flat or small for an arc."""
    arc = Arc(end, through)
    try:
        circle_of(start, arc)
    except ValueError:
        return Line(end)
    return arc


def ending_at(element: Element, end: Point2) -> Element:
    """Return the element led to another end, near its own [m]."""
    match element:
        case Arc():
            return Arc(end, element.through)
        case Spline():
            return Spline((*element.through[:-1], end))
    return Line(end)


def reversed_element(start: Point2, element: Element) -> Element:
    """Return the element that leads from the end of `element` back to its start."""
    match element:
        case Arc():
            return Arc(start, element.through)
        case Spline():
            return Spline((*reversed(element.through[:-1]), start))
    return Line(start)


def _spans(start: Point2, spline: Spline) -> list[BezierSpan]:
    points = (start, *spline.through)
    for point, other in itertools.pairwise(points):
        _refuse_equal(point, other)
    closed = len(points) > 3 and math.dist(start, spline.end) <= SAME_POINT_M
    return bezier_spans(points, closed=closed)


# Nodes and weights of Gauss-Legendre quadrature of order 5 on [-1, 1].
_GAUSS = (
    (0.0, 128 / 225),
    *(
        (
            sign * math.sqrt(5 + root * 2 * math.sqrt(10 / 7)) / 3,
            (322 - root * 13 * math.sqrt(70)) / 900,
        )
        for root in (-1, 1)
        for sign in (-1, 1)
    ),
)
_PARTS_OF_A_SPAN = 8


def _measure_span_m(span: BezierSpan) -> float:
    (ax, ay), (bx, by), (cx, cy), (dx, dy) = span
    total = 0.0
    for part in range(_PARTS_OF_A_SPAN):
        for node, weight in _GAUSS:
            t = (part + (1 + node) / 2) / _PARTS_OF_A_SPAN
            u = 1 - t
            x = u * u * (bx - ax) + 2 * u * t * (cx - bx) + t * t * (dx - cx)
            y = u * u * (by - ay) + 2 * u * t * (cy - by) + t * t * (dy - cy)
            total += weight * math.hypot(x, y)
    return 3 * total / (2 * _PARTS_OF_A_SPAN)


def _arc_chords(circle: ArcCircle, tolerance_m: float) -> int:
    """Return the chords of an arc: one of angle w is off by r (1 - cos w/2) = 2 r sin^2 w/4."""
    widest = 4 * math.asin(min(1.0, math.sqrt(tolerance_m / (2 * circle.radius_m))))
    return max(2, math.ceil(abs(circle.sweep_rad) / min(widest, _WIDEST_CHORD_RAD)))


def _spline_chords(spans: list[BezierSpan], tolerance_m: float) -> list[int]:
    """Return the chords of each span of a spline."""
    fewest = 2 if len(spans) == 1 else 1
    return [max(fewest, chords_needed(span, tolerance_m)) for span in spans]


def _sample_arc(circle: ArcCircle, end: Point2, tolerance_m: float) -> list[Point2]:
    """Sample evenly in the angle."""
    chords = _arc_chords(circle, tolerance_m)
    _refuse_too_many(chords, tolerance_m)
    return [*(circle.at(i / chords) for i in range(1, chords)), end]


def _sample_spline(spans: list[BezierSpan], tolerance_m: float) -> list[Point2]:
    counts = _spline_chords(spans, tolerance_m)
    _refuse_too_many(sum(counts), tolerance_m)
    sampled: list[Point2] = []
    for span, count in zip(spans, counts, strict=True):
        sampled.extend(point_of(span, i / count) for i in range(1, count))
        sampled.append(span[3])
    return sampled


def _direction(a: Point2, b: Point2) -> float:
    return math.atan2(b[1] - a[1], b[0] - a[0])


def _refuse_equal(point: Point2, other: Point2) -> None:
    if math.dist(point, other) <= SAME_POINT_M:
        raise ValueError(
            f"Two consecutive points are the same, {shown(point)}, which makes a segment of zero "
            "length; leave one of them out."
        )


def _refuse_too_many(chords: int, tolerance_m: float) -> None:
    if chords > MAX_CHORDS:
        raise ValueError(
            f"A chord tolerance of {tolerance_m:g} m needs {chords} chords, "
            f"but {MAX_CHORDS} are the most; give a coarser one."
        )
