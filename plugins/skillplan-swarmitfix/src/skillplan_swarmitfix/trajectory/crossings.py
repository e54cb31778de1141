"""Where a polyline meets itself.

Chords are compared through a tree of boxes over consecutive chords, which are near each other
anyway; arrays of pairs of boxes go down it together, so that 10,000 chords take milliseconds.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan_swarmitfix.trajectory.plane_point import Point2

TOUCH_M = 1e-9
"""Chords as near as this touch [m]; chords that are compared have to be longer."""

MAX_CROSSINGS = 10_000
"""The search ends when it has found as many."""

_PAIRS_AT_ONCE = 1 << 17

_Floats = NDArray[np.float64]
_Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Crossing:
    """Two chords of a polyline that have a point in common and should not.

    Parameters
    ----------
    first, second
        Indices of the chords, `first` < `second`; chord i leads from point i to the next.
    point
        A common point [m].
    folded
        Whether the chords are neighbours, of which one leads back along the other.
    """

    first: int
    second: int
    point: Point2
    folded: bool


def crossings(points: _Floats, *, closed: bool) -> list[Crossing]:
    """Return where chords of a polyline cross, touch or lie on one another, in their order.

    Neighbours share a point, which is no crossing unless one folds back onto the other.

    Parameters
    ----------
    points
        Shape (n, 2), n >= 2, finite, consecutive ones more than `TOUCH_M` apart [m]. A closed
        polyline does not repeat its first point.
    closed
        Whether a last chord leads back to the first point.

    Returns
    -------
    list of Crossing
        At most `MAX_CROSSINGS`; none only if there are none.
    """
    starts = points if closed else points[:-1]
    ends = np.roll(points, -1, axis=0) if closed else points[1:]
    found = _folds(starts, ends, closed=closed)
    count = len(starts)
    for first, second in _near_pairs(starts, ends):
        apart = second > first + 1
        if closed:
            apart &= (first > 0) | (second < count - 1)
        first, second = first[apart], second[apart]
        both = _on_both_sides(starts[first], ends[first], starts[second], ends[second])
        first, second = first[both], second[both]
        place = _common_points(starts[first], ends[first], starts[second], ends[second])
        for i in np.flatnonzero(np.isfinite(place[:, 0])):
            point = (float(place[i, 0]), float(place[i, 1]))
            found.append(Crossing(int(first[i]), int(second[i]), point, folded=False))
        if len(found) > MAX_CROSSINGS:
            break
    found.sort(key=lambda crossing: (crossing.first, crossing.second))
    return found[:MAX_CROSSINGS]


def _folds(starts: _Floats, ends: _Floats, *, closed: bool) -> list[Crossing]:
    """Return the chords on which the next one leads back."""
    first = np.arange(len(starts) if closed and len(starts) > 2 else len(starts) - 1)
    second = (first + 1) % len(starts)
    onto = _distance(ends[second], starts[first], ends[first]) <= TOUCH_M
    under = _distance(starts[first], starts[second], ends[second]) <= TOUCH_M
    found = []
    for i in np.flatnonzero(onto | under):
        low, high = sorted((int(first[i]), int(second[i])))
        point = (float(ends[first[i], 0]), float(ends[first[i], 1]))
        found.append(Crossing(low, high, point, folded=True))
    return found


def _near_pairs(starts: _Floats, ends: _Floats) -> Iterator[tuple[_Indices, _Indices]]:
    """Yield pairs of different chords, the lower index first, whose boxes overlap."""
    axes = _axes(ends - starts)
    low = np.minimum(starts @ axes, ends @ axes) - TOUCH_M
    high = np.maximum(starts @ axes, ends @ axes) + TOUCH_M
    levels = [(low, high)]
    while len(low) > 1:
        pairs = np.arange(0, len(low), 2)
        low = np.minimum.reduceat(low, pairs)
        high = np.maximum.reduceat(high, pairs)
        levels.append((low, high))
    root = np.zeros(1, dtype=np.int64)
    waiting = [(len(levels) - 1, root, root)]
    while waiting:
        level, one, other = waiting.pop()
        if level == 0:
            different = one < other
            yield one[different], other[different]
            continue
        level -= 1
        low, high = levels[level]
        one = np.repeat(2 * one, 4) + np.tile(np.array([0, 0, 1, 1]), len(one))
        other = np.repeat(2 * other, 4) + np.tile(np.array([0, 1, 0, 1]), len(other))
        keep = (one <= other) & (other < len(low))
        one, other = one[keep], other[keep]
        keep = ((low[one] <= high[other]) & (low[other] <= high[one])).all(axis=1)
        one, other = one[keep], other[keep]
        for begin in reversed(range(0, len(one), _PAIRS_AT_ONCE)):
            part = slice(begin, begin + _PAIRS_AT_ONCE)
            waiting.append((level, one[part], other[part]))


def _axes(along: _Floats) -> _Floats:
    """Return the four directions in which boxes are measured, shape (2, 4).

    The first is the direction of most of the length, in either sense: then boxes of slanting
    parallels do not overlap.
    """
    x, y = along[:, 0], along[:, 1]
    most = 0.5 * np.arctan2((2 * x * y).sum(), (x * x - y * y).sum())
    angles = most + np.arange(4) * (np.pi / 4)
    return np.stack((np.cos(angles), np.sin(angles)))


def _on_both_sides(a: _Floats, b: _Floats, c: _Floats, d: _Floats) -> NDArray[np.bool_]:
    """Whether neither of the chords ab and cd is to one side of the other: most pairs are."""
    maybe = np.ones(len(a), dtype=np.bool_)
    for start, end, one, other in ((a, b, c, d), (c, d, a, b)):
        along = end - start
        reach = TOUCH_M * np.hypot(along[:, 0], along[:, 1])
        of_one, of_other = _cross(along, one - start), _cross(along, other - start)
        maybe &= (np.minimum(of_one, of_other) <= reach) & (np.maximum(of_one, of_other) >= -reach)
    return maybe


def _common_points(a: _Floats, b: _Floats, c: _Floats, d: _Floats) -> _Floats:
    """Return a common point of each chord ab and cd, (n, 2); nan where they have none."""
    place = np.full_like(a, np.nan)
    along, across = b - a, d - c
    # On which side of the one chord the ends of the other lie.
    of_c, of_d = _cross(along, c - a), _cross(along, d - a)
    of_a, of_b = _cross(across, a - c), _cross(across, b - c)
    proper = (of_c * of_d < 0) & (of_a * of_b < 0)
    share = of_a[proper] / (of_a[proper] - of_b[proper])
    place[proper] = a[proper] + share[:, None] * along[proper]
    for point, start, end in ((c, a, b), (d, a, b), (a, c, d), (b, c, d)):
        touching = ~proper & (_distance(point, start, end) <= TOUCH_M)
        place[touching] = point[touching]
    return place


def _distance(points: _Floats, starts: _Floats, ends: _Floats) -> _Floats:
    """Return how far each point is from its chord [m]."""
    along = ends - starts
    share = ((points - starts) * along).sum(axis=1) / (along * along).sum(axis=1)
    nearest = starts + np.clip(share, 0.0, 1.0)[:, None] * along
    gap = points - nearest
    return np.asarray(np.hypot(gap[:, 0], gap[:, 1]))


def _cross(one: _Floats, other: _Floats) -> _Floats:
    return np.asarray(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0])
