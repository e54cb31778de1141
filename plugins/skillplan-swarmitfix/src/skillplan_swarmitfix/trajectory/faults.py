"""What is wrong with a tool trajectory: every fault, with the element it is in."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np

from skillplan_swarmitfix.trajectory.crossings import Crossing, crossings
from skillplan_swarmitfix.trajectory.path_elements import (
    MAX_CHORDS,
    Element,
    Line,
    ending_at,
    points_of,
    refuse_tolerance,
    sample,
)
from skillplan_swarmitfix.trajectory.plane_point import (
    SAME_POINT_M,
    Point2,
    on_any_bench,
    shown,
)

Outline = tuple[float, float, float, float]
Fault = tuple[str, tuple[str | int, ...]]

MOST_LISTED = 10
"""So many crossings are listed one by one; of the rest only the number."""


def joined(start: Point2, elements: Sequence[Element], *, closed: bool) -> list[Element]:
    """Return the elements such that those of a closed trajectory end at its start exactly.

    Where they end within `SAME_POINT_M` of it, the last one is led there; elsewhere a line is
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
        Where the first element starts [m].
    elements
        In order along the trajectory.
    closed
        Whether the trajectory leads back to its start, by a line where it is not there yet.
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
    found: list[Fault] = []
    if not on_any_bench(start):
        found.append((f"The start {shown(start)} is on no bench; give finite metres.", ("start",)))
    sampled: list[list[Point2]] = []
    position = start
    for i, element in enumerate(joined(start, elements, closed=closed)):
        try:
            sampled.append(sample(position, element, chord_tolerance_m))
        except ValueError as error:
            # An element that starts where another one has gone wrong is not to blame.
            if on_any_bench(position) and i < len(elements):
                found.append((str(error), (i,)))
            sampled.append([point for point in points_of(element) if on_any_bench(point)])
        position = element.end
    found += _too_few(elements, sampled, closed=closed)
    if not found:
        found += _crossings(start, sampled, len(elements), closed=closed)
    if outline is not None:
        found += _off_bench(start, sampled, outline, len(elements))
    return found


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
    """Yield a fault for every place in which the trajectory meets itself."""
    points = [start, *itertools.chain.from_iterable(sampled)]
    owner = [i for i, part in enumerate(sampled) for _ in part]
    if closed:
        points.pop()
    found = _distinct(crossings(np.array(points, dtype=np.float64), closed=closed), owner)
    for crossing in found[:MOST_LISTED]:
        one, other = owner[crossing.first], owner[crossing.second]
        place = shown(crossing.point)
        if not closed and _same(crossing.point, start) and _same(crossing.point, points[-1]):
            message = (
                f"The trajectory ends where it starts, at {place}, but is said to be open; "
                "say that it is closed."
            )
            yield message, ()
            continue
        rest = "itself" if one == other else f"segment {one + 1}"
        verb = "folds back onto" if crossing.folded else "crosses or touches"
        name = f"Segment {other + 1}" if other < given else "The line that closes the trajectory"
        message = (
            f"{name} {verb} {rest} at {place}; lead one of them along another path, "
            "or split the trajectory into two."
        )
        yield message, (other,) if other < given else ()
    if len(found) > MOST_LISTED:
        yield f"The trajectory meets itself {len(found) - MOST_LISTED} times more at least.", ()


def _distinct(found: Sequence[Crossing], owner: Sequence[int]) -> list[Crossing]:
    """Return one crossing for each place and each two segments.

    Touching a joint of chords is found twice, and lines that lie on one another at both ends.
    """
    kept: list[Crossing] = []
    pairs: set[tuple[int, int]] = set()
    places: set[tuple[int, int]] = set()
    for crossing in found:
        pair = (owner[crossing.first], owner[crossing.second])
        x, y = crossing.point
        place = (round(x / SAME_POINT_M), round(y / SAME_POINT_M))
        if pair not in pairs and place not in places:
            kept.append(crossing)
        pairs.add(pair)
        places.add(place)
    return kept


def _same(one: Point2, other: Point2) -> bool:
    return math.dist(one, other) <= SAME_POINT_M
