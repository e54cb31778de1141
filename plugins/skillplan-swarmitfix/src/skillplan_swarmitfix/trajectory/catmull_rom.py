"""Centripetal Catmull-Rom curves as cubic Bezier spans.

The curve passes through all of its points, a point moves no more than the two spans on either
side, and within a span there is neither a cusp nor a loop (C. Yuksel, S. Schaefer, J. Keyser,
"Parameterization and applications of Catmull-Rom curves", Computer-Aided Design 43, 2011).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from skillplan_swarmitfix.trajectory.plane_point import Point2

BezierSpan = tuple[Point2, Point2, Point2, Point2]


def bezier_spans(points: Sequence[Point2], *, closed: bool) -> list[BezierSpan]:
    """Return the spans between consecutive points, each as its four control points [m].

    Parameters
    ----------
    points
        At least two, of which no two consecutive ones are the same [m].
    closed
        Whether the curve goes on smoothly from its last point, which is its first, to its second;
        needs four points or more. Otherwise it goes on at either end as if its last span were
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
    """Return how many chords, even in the parameter, stay as near to a span as the tolerance [m].

    A chord over 1/n of a span is off it by no more than |B''| / (8 n^2), and |B''| is no more
    than 6 times the greatest second difference of the control points (Wang's formula).
    """
    return max(1, math.ceil(math.sqrt(deviation_m(span, 1) / tolerance_m)))


def deviation_m(span: BezierSpan, chords: int) -> float:
    """Return an upper bound of the distance of a span from so many chords [m].

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
    one, two = math.dist(a, b), math.dist(b, c)
    root = math.sqrt(one * two)
    scale = 3 * (one + root)
    back, here, ahead = -two / scale, (2 * one + 3 * root + two) / scale, one / scale
    return (
        back * a[0] + here * b[0] + ahead * c[0],
        back * a[1] + here * b[1] + ahead * c[1],
    )


def _mirrored(point: Point2, at: Point2) -> Point2:
    return (2 * at[0] - point[0], 2 * at[1] - point[1])


def _second_difference(a: Point2, b: Point2, c: Point2) -> float:
    return math.hypot(a[0] - 2 * b[0] + c[0], a[1] - 2 * b[1] + c[1])
