"""Faults of a tool trajectory, each with its element."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan_swarmitfix.trajectory.path_elements import (
    MAX_CHORDS,
    SAME_POINT_M,
    Element,
    Line,
    Point2,
    ending_at,
    on_any_bench,
    points_of,
    refuse_tolerance,
    sample,
    shown,
)

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
        True if the chords are neighbours and one leads back along the other.
    """

    first: int
    second: int
    point: Point2
    folded: bool


def crossings(points: _Floats, *, closed: bool) -> list[Crossing]:
    """Find the places where chords of a polyline cross, touch or overlap, in their order.

    Neighbours share a point; this is not a crossing unless one folds back onto the other.

    Parameters
    ----------
    points
        Shape (n, 2), n >= 2, finite, with consecutive distances above `TOUCH_M` [m]. A closed
        polyline does not repeat its first point.
    closed
        True if a last chord leads back to the first point.

    Returns
    -------
    list of Crossing
        At most `MAX_CROSSINGS`; none only if there are none.
    """
    starts = points if closed else points[:-1]
    ends = np.roll(points, -1, axis=0) if closed else points[1:]
    folds = _folds(starts, ends, closed=closed)
    count = len(starts)
    for first, second in near_pairs(starts, ends):
        apart = second > first + 1
        if closed:
            apart &= (first > 0) | (second < count - 1)
        first, second = first[apart], second[apart]
        both = _on_both_sides(starts[first], ends[first], starts[second], ends[second])
        first, second = first[both], second[both]
        place = _common_points(starts[first], ends[first], starts[second], ends[second])
        for i in np.flatnonzero(np.isfinite(place[:, 0])):
            point = (float(place[i, 0]), float(place[i, 1]))
            folds.append(Crossing(int(first[i]), int(second[i]), point, folded=False))
        if len(folds) > MAX_CROSSINGS:
            break
    folds.sort(key=lambda crossing: (crossing.first, crossing.second))
    return folds[:MAX_CROSSINGS]


def _folds(starts: _Floats, ends: _Floats, *, closed: bool) -> list[Crossing]:
    """Return the chords on which the next one leads back."""
    first = np.arange(len(starts) if closed and len(starts) > 2 else len(starts) - 1)
    second = (first + 1) % len(starts)
    onto = _distance(ends[second], starts[first], ends[first]) <= TOUCH_M
    under = _distance(starts[first], starts[second], ends[second]) <= TOUCH_M
    folds = []
    for i in np.flatnonzero(onto | under):
        low, high = sorted((int(first[i]), int(second[i])))
        point = (float(ends[first[i], 0]), float(ends[first[i], 1]))
        folds.append(Crossing(low, high, point, folded=True))
    return folds


def near_pairs(starts: _Floats, ends: _Floats) -> Iterator[tuple[_Indices, _Indices]]:
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
        level, first, second = waiting.pop()
        if level == 0:
            different = first < second
            yield first[different], second[different]
            continue
        level -= 1
        low, high = levels[level]
        first = np.repeat(2 * first, 4) + np.tile(np.array([0, 0, 1, 1]), len(first))
        second = np.repeat(2 * second, 4) + np.tile(np.array([0, 1, 0, 1]), len(second))
        keep = (first <= second) & (second < len(low))
        first, second = first[keep], second[keep]
        keep = ((low[first] <= high[second]) & (low[second] <= high[first])).all(axis=1)
        first, second = first[keep], second[keep]
        for begin in reversed(range(0, len(first), _PAIRS_AT_ONCE)):
            part = slice(begin, begin + _PAIRS_AT_ONCE)
            waiting.append((level, first[part], second[part]))


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
    """Return whether neither of the chords ab and cd lies on one side of the other."""
    maybe = np.ones(len(a), dtype=np.bool_)
    for start, end, near, far in ((a, b, c, d), (c, d, a, b)):
        along = end - start
        reach = TOUCH_M * np.hypot(along[:, 0], along[:, 1])
        of_one, of_other = _cross(along, near - start), _cross(along, far - start)
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
    """Compute the distance of each point from its chord [m]."""
    along = ends - starts
    share = ((points - starts) * along).sum(axis=1) / (along * along).sum(axis=1)
    nearest = starts + np.clip(share, 0.0, 1.0)[:, None] * along
    gap = points - nearest
    return np.asarray(np.hypot(gap[:, 0], gap[:, 1]))


def _cross(vector: _Floats, other: _Floats) -> _Floats:
    return np.asarray(vector[:, 0] * other[:, 1] - vector[:, 1] * other[:, 0])


Outline = tuple[float, float, float, float]
Fault = tuple[str, tuple[str | int, ...]]

MOST_LISTED = 10
"""So many crossings are listed one by one; of the rest only the number."""


def joined(start: Point2, elements: Sequence[Element], *, closed: bool) -> list[Element]:
    """Return the elements, closed exactly at the start if the trajectory is closed.

    If they end within `SAME_POINT_M` of it, the last element is extended to it; otherwise a line is
    added.
    """
    whole = list(elements)
    if not closed or not whole:
        return whole
    if not math.dist(whole[-1].end, start) <= SAME_POINT_M:
        return [*whole, Line(start)]
    whole[-1] = ending_at(whole[-1], start)
    return whole


def faults(
    start: Point2,
    elements: Sequence[Element],
    closed: bool,
    chord_tolerance_m: float,
    outline: Outline | None,
) -> list[Fault]:
    """Return everything that is wrong with a trajectory.

    Parameters
    ----------
    start
        Start of the first element [m].
    elements
        In order along the trajectory.
    closed
        True if the trajectory leads back to its start, if necessary by a line.
    chord_tolerance_m
        Greatest distance between a curve and its chords [m].
    outline
        The bench: x low, y low, x high, y high [m]. None for no check against it.

    Returns
    -------
    list of (message, path)
        The path is ``(i,)`` for element i, from 0, which messages call segment i + 1, as tasks
        and tables do; ``("start",)`` for the start; ``("chord_tolerance_m",)`` for the
        tolerance; ``()`` for the trajectory as a whole and for the line that closes it. Crossings
        are looked for once nothing else, the bench aside, is wrong.
    """
    try:
        refuse_tolerance(chord_tolerance_m)
    except ValueError as error:
        return [(str(error), ("chord_tolerance_m",))]
    if not elements:
        message = "The trajectory has no segment; give at least one element after the start."
        return [(message, ())]
    problems: list[Fault] = []
    if not on_any_bench(start):
        problems.append(
            (f"The start {shown(start)} is on no bench; give finite metres.", ("start",))
        )
    sampled: list[list[Point2]] = []
    position = start
    for i, element in enumerate(joined(start, elements, closed=closed)):
        try:
            sampled.append(sample(position, element, chord_tolerance_m))
        except ValueError as error:
            # An element that starts where another one has gone wrong is not to blame.
            if on_any_bench(position) and i < len(elements):
                problems.append((str(error), (i,)))
            sampled.append([point for point in points_of(element) if on_any_bench(point)])
        position = element.end
    problems += _too_few(elements, sampled, closed=closed)
    if not problems:
        problems += _crossings(start, sampled, len(elements), closed=closed)
    if outline is not None:
        problems += _off_bench(start, sampled, outline, len(elements))
    return problems


def _too_few(
    elements: Sequence[Element], sampled: Sequence[Sequence[Point2]], *, closed: bool
) -> Iterator[Fault]:
    chords = sum(map(len, sampled))
    if chords > MAX_CHORDS:
        message = (
            f"The trajectory is sampled to {chords} chords, but {MAX_CHORDS} are the most; "
            "give a coarser chord tolerance, or split it."
        )
        yield message, ()
    if closed and len(sampled) < 3 and all(isinstance(element, Line) for element in elements):
        message = (
            f"A closed trajectory of lines needs 3 vertices, but this one has {len(sampled)}; "
            "add one, or leave it open."
        )
        yield message, ()


def _off_bench(
    start: Point2, sampled: Sequence[Sequence[Point2]], outline: Outline, given: int
) -> Iterator[Fault]:
    """Yield the start and, of every element, the point that is farthest off the bench."""
    x_low, y_low, x_high, y_high = outline

    def excess_m(point: Point2) -> float:
        x, y = point
        return max(x_low - x, x - x_high, y_low - y, y - y_high)

    paths: list[tuple[str | int, ...]] = [("start",), *((i,) for i in range(given)), ()]
    for path, points in zip(paths, [[start], *sampled], strict=False):
        farthest = max(filter(on_any_bench, points), key=excess_m, default=None)
        if farthest is not None and excess_m(farthest) > SAME_POINT_M:
            message = (
                f"The point {shown(farthest)} is off the bench, whose outline is "
                f"x {x_low:.9g} to {x_high:.9g} m, y {y_low:.9g} to {y_high:.9g} m; "
                "move it onto the bench."
            )
            yield message, path


def _crossings(
    start: Point2, sampled: Sequence[Sequence[Point2]], given: int, *, closed: bool
) -> Iterator[Fault]:
    """Yield a fault for every place in which the trajectory folds back onto itself."""
    distinct, owner = _meetings(start, sampled, closed=closed)
    end = sampled[-1][-1]
    if not closed and _same(start, end):
        message = (
            f"The trajectory ends at its start, {shown(start)}, but is declared open; "
            "declare it closed."
        )
        yield message, ()
    folds = [crossing for crossing in distinct if crossing.folded]
    for crossing in folds[:MOST_LISTED]:
        first, other = owner[crossing.first], owner[crossing.second]
        rest = "itself" if first == other else f"segment {first + 1}"
        name = f"Segment {other + 1}" if other < given else "The line that closes the trajectory"
        message = (
            f"{name} folds back onto {rest} at {shown(crossing.point)}; lead one of them along "
            "another path, or split the trajectory into two."
        )
        yield message, (other,) if other < given else ()
    if len(folds) > MOST_LISTED:
        yield f"The trajectory folds back {len(folds) - MOST_LISTED} times more at least.", ()


def find_meetings(
    start: Point2, elements: Sequence[Element], chord_tolerance_m: float, *, closed: bool
) -> list[Point2]:
    """Return the points at which a faultless trajectory crosses or touches itself [m].

    At most `MAX_CROSSINGS`. Parameters as in `faults`.
    """
    whole = joined(start, elements, closed=closed)
    starts = [start, *(element.end for element in whole)]
    sampled = [
        sample(begin, element, chord_tolerance_m)
        for begin, element in zip(starts, whole, strict=False)
    ]
    return [crossing.point for crossing in _meetings(start, sampled, closed=closed)[0]]


def _meetings(
    start: Point2, sampled: Sequence[Sequence[Point2]], *, closed: bool
) -> tuple[list[Crossing], list[int]]:
    """Return the distinct crossings of chords, and the element that each chord belongs to."""
    points = [start, *itertools.chain.from_iterable(sampled)]
    owner = [i for i, part in enumerate(sampled) for _ in part]
    if closed:
        points.pop()
    return _distinct(crossings(np.array(points, dtype=np.float64), closed=closed), owner), owner


def _distinct(known: Sequence[Crossing], owner: Sequence[int]) -> list[Crossing]:
    """Return one crossing for each place and each two segments.

    Touching a joint of chords is found twice, and lines that lie on one another at both ends.
    """
    kept: list[Crossing] = []
    pairs: set[tuple[int, int]] = set()
    places: set[tuple[int, int]] = set()
    for crossing in known:
        pair = (owner[crossing.first], owner[crossing.second])
        x, y = crossing.point
        place = (round(x / SAME_POINT_M), round(y / SAME_POINT_M))
        if pair not in pairs and place not in places:
            kept.append(crossing)
        pairs.add(pair)
        places.add(place)
    return kept


def _same(first: Point2, other: Point2) -> bool:
    return math.dist(first, other) <= SAME_POINT_M
