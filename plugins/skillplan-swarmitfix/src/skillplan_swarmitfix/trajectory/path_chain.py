"""Pieces of paths, in any order and sense, joined end to end to contours."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from skillplan_swarmitfix.trajectory.faults import near_pairs
from skillplan_swarmitfix.trajectory.path import JOIN_M, TrajectoryPath, count, millimetres
from skillplan_swarmitfix.trajectory.path_elements import (
    SAME_POINT_M,
    Arc,
    Element,
    Line,
    Point2,
    Spline,
    circle_of,
    end_directions,
    ending_at,
    reversed_element,
    shown,
)

GAP_M = 1e-4
"""Gaps up to this are shut, if both ends meet nothing else [m]."""

_MOST_AT_A_FORK = 64
_MOST_NAMED = 3
_MOST_ALIKE = 300
_SHARE_OFF = 0.02
_MOST_COMPARED = 5_000_000


@dataclass(frozen=True)
class Piece:
    """Some elements in a row that come from one entity of a drawing.

    Parameters
    ----------
    name
        The entity, for messages.
    start
        Start of the first element [m].
    elements
        At least one.
    places
        Origin of each element, for messages.
    """

    name: str
    start: Point2
    elements: tuple[Element, ...]
    places: tuple[str, ...]

    @property
    def end(self) -> Point2:
        """End of the last element [m]."""
        return self.elements[-1].end

    @property
    def starts(self) -> list[Point2]:
        """Start of each element [m]."""
        return [self.start, *(element.end for element in self.elements[:-1])]

    def reversed(self) -> Piece:
        """Return the piece in the opposite sense."""
        turned = tuple(
            reversed_element(start, element)
            for start, element in zip(self.starts, self.elements, strict=True)
        )
        return Piece(self.name, self.end, turned[::-1], self.places[::-1])


def join_pieces(pieces: Sequence[Piece]) -> tuple[list[TrajectoryPath], list[str]]:
    """Return the contours that pieces make, end to end, and notes about what was mended.

    Lines and arcs that lie on others are dropped, and gaps up to `GAP_M` between loose ends are
    shut. At a fork the path goes on as straight as it can. A contour runs in the sense of its first
    piece; a closed one starts with it.
    """
    pieces, notes = _drop_repeated(pieces)
    ends, gaps_m, points = _ends(pieces)
    if gaps_m:
        notes.append(f"{count(len(gaps_m), 'gap')} of up to {millimetres(max(gaps_m))} mm shut")
    partners, forks = _partners(pieces, ends)
    if forks:
        where = ", ".join(shown(points[node]) for node in forks[:_MOST_NAMED])
        more = f" and {len(forks) - _MOST_NAMED} more" if len(forks) > _MOST_NAMED else ""
        notes.append(
            f"the path forks at {count(len(forks), 'point')}, {where}{more}, and goes straight on"
        )
    left = dict.fromkeys(range(len(pieces)))
    contours = []
    while left:
        first = next(iter(left))
        del left[first]
        onward = list(_walk((first, 1), partners, left))
        back = list(_walk((first, 0), partners, left))
        chain = [*((i, not flip) for i, flip in reversed(back)), (first, False), *onward]
        whole = [pieces[i].reversed() if flip else pieces[i] for i, flip in chain]
        contour = TrajectoryPath.ended(
            whole[0].start,
            [element for piece in whole for element in piece.elements],
            [place for piece in whole for place in piece.places],
        )
        closes = (chain[0][0], int(chain[0][1])) == partners.get(
            (chain[-1][0], int(not chain[-1][1]))
        )
        if closes and not contour.closed and len(contour.elements) > 1:
            last = ending_at(contour.elements[-1], contour.start)
            contour = replace(contour, closed=True, elements=(*contour.elements[:-1], last))
        contours.append(contour)
    return contours, notes


def _walk(
    end: tuple[int, int], partners: dict[tuple[int, int], tuple[int, int]], left: dict[int, None]
) -> Iterator[tuple[int, bool]]:
    """Yield the pieces beyond an end of a piece, and whether each is followed backwards."""
    while True:
        following = partners.get(end)
        if following is None or following[0] not in left:
            return
        i, side = following
        del left[i]
        yield i, side == 1
        end = (i, 1 - side)


def _ends(pieces: Sequence[Piece]) -> tuple[list[tuple[int, int]], list[float], list[Point2]]:
    """Return the nodes at both ends of each piece, the gaps shut [m], and the nodes' points."""
    index = PointIndex()
    ends = [(index.at(piece.start), index.at(piece.end)) for piece in pieces]
    degree = [0] * len(index.points)
    for node in itertools.chain.from_iterable(ends):
        degree[node] += 1
    loose = [node for node, meeting in enumerate(degree) if meeting == 1]
    cells: dict[tuple[int, int], list[int]] = {}
    for node in loose:
        x, y = index.points[node]
        cells.setdefault((math.floor(x / GAP_M), math.floor(y / GAP_M)), []).append(node)
    nearest: dict[int, tuple[float, int]] = {}
    for node in loose:
        x, y = index.points[node]
        column, row = math.floor(x / GAP_M), math.floor(y / GAP_M)
        around = itertools.product((column - 1, column, column + 1), (row - 1, row, row + 1))
        near = [
            (math.dist(index.points[node], index.points[other]), other)
            for cell in around
            for other in cells.get(cell, ())[:_MOST_AT_A_FORK]
            if other != node
        ]
        if near and min(near)[0] <= GAP_M:
            nearest[node] = min(near)
    same: dict[int, int] = {}
    gaps_m = []
    for node, (gap_m, other) in nearest.items():
        if node < other and nearest.get(other, (0.0, -1))[1] == node:
            same[other] = node
            gaps_m.append(gap_m)
    return [(same.get(a, a), same.get(b, b)) for a, b in ends], gaps_m, index.points


def _partners(
    pieces: Sequence[Piece], ends: Sequence[tuple[int, int]]
) -> tuple[dict[tuple[int, int], tuple[int, int]], list[int]]:
    """Return which end of a piece leads on to which, and the nodes where more than two meet.

    An end is the number of a piece, and 0 for its start or 1 for its end.
    """
    meeting: dict[int, list[tuple[int, int]]] = {}
    for i, pair in enumerate(ends):
        for side, node in enumerate(pair):
            meeting.setdefault(node, []).append((i, side))
    partners: dict[tuple[int, int], tuple[int, int]] = {}
    forks = []
    for node, those in meeting.items():
        pairs = [those] if len(those) == 2 else []
        if len(those) > 2:
            forks.append(node)
            pairs = _straightest(pieces, those[:_MOST_AT_A_FORK])
        for end, other in pairs:
            partners[end], partners[other] = other, end
    return partners, forks


def _straightest(
    pieces: Sequence[Piece], those: Sequence[tuple[int, int]]
) -> list[list[tuple[int, int]]]:
    """Return pairs of ends, the straightest passage first; with an odd number one is left over."""
    away = [_direction_away(pieces[i], side) for i, side in those]
    turns = sorted(
        (abs(math.remainder(away[a] - away[b] - math.pi, math.tau)), a, b)
        for a, b in itertools.combinations(range(len(those)), 2)
    )
    pairs, used = [], set[int]()
    for _, a, b in turns:
        if a not in used and b not in used:
            used |= {a, b}
            pairs.append([those[a], those[b]])
    return pairs


def _direction_away(piece: Piece, side: int) -> float:
    """Return the direction in which a piece leaves one of its ends [rad]."""
    if side == 0:
        return end_directions(piece.start, piece.elements[0])[0]
    return end_directions(piece.starts[-1], piece.elements[-1])[1] + math.pi


def _drop_repeated(pieces: Sequence[Piece]) -> tuple[list[Piece], list[str]]:
    """Return the pieces without lines and arcs that lie on those of others."""
    owned = [
        (i, start, element)
        for i, piece in enumerate(pieces)
        for start, element in zip(piece.starts, piece.elements, strict=True)
    ]
    repeated = _repeated_lines(owned) | _repeated_arcs(owned) | _repeated_curves(owned)
    if not repeated:
        return list(pieces), []
    kept, first = [], 0
    for piece in pieces:
        starts = piece.starts
        dropped = [first + k in repeated for k in range(len(starts))]
        for is_dropped, run in itertools.groupby(range(len(starts)), dropped.__getitem__):
            if not is_dropped:
                ks = list(run)
                part = slice(ks[0], ks[-1] + 1)
                kept.append(
                    Piece(piece.name, starts[ks[0]], piece.elements[part], piece.places[part])
                )
        first += len(starts)
    return kept, [f"dropped: {count(len(repeated), 'element')} on top of others"]


_Owned = tuple[int, Point2, Element]
"""The number of a piece, and start and element of one of its elements."""


def _repeated_lines(owned: Sequence[_Owned]) -> set[int]:
    """Return the lines within `JOIN_M` of a longer one, or of an equal one before.

    Lines that are hardly longer than that must lie closer, since their neighbours are as near.
    """
    lines = [
        number
        for number, (_, start, element) in enumerate(owned)
        if isinstance(element, Line) and math.dist(start, element.end) > SAME_POINT_M
    ]
    if len(lines) < 2:
        return set()
    starts = np.array([owned[number][1] for number in lines])
    ends = np.array([owned[number][2].end for number in lines])
    lengths = np.hypot(*(ends - starts).T)
    piece_of = np.array([owned[number][0] for number in lines])
    repeated: set[int] = set()
    compared = 0
    for first, second in near_pairs(starts, ends):
        compared += len(first)
        if compared > _MOST_COMPARED:
            # So dense that no mistake of drawing explains it.
            break
        apart = piece_of[first] != piece_of[second]
        first, second = first[apart], second[apart]
        # The shorter one may lie on the longer one; of equals the later one.
        swap = lengths[first] < lengths[second] - SAME_POINT_M
        short, long = np.where(swap, first, second), np.where(swap, second, first)
        along = ends[long] - starts[long]
        off = np.zeros(len(short))
        for tips in (starts[short], ends[short]):
            share = ((tips - starts[long]) * along).sum(axis=1) / (lengths[long] ** 2)
            foot = starts[long] + np.clip(share, 0.0, 1.0)[:, None] * along
            off = np.maximum(off, np.hypot(*(tips - foot).T))
        near_m = np.minimum(JOIN_M, _SHARE_OFF * lengths[short])
        repeated |= {lines[i] for i in short[off <= near_m].tolist()}
    return repeated


def _repeated_arcs(owned: Sequence[_Owned]) -> set[int]:
    """Return the arcs that lie on a longer one, or on an equal one before."""
    alike: dict[tuple[int, ...], list[tuple[int, int, float, float]]] = {}
    for number, (piece, start, element) in enumerate(owned):
        if isinstance(element, Arc):
            circle = circle_of(start, element)
            measures = (*circle.centre, circle.radius_m)
            key = tuple(round(value / (10 * JOIN_M)) for value in measures)
            low = min(circle.start_rad, circle.start_rad + circle.sweep_rad)
            alike.setdefault(key, []).append((number, piece, low, abs(circle.sweep_rad)))
    repeated: set[int] = set()
    for key, arcs in alike.items():
        slack = 1 / max(1, 10 * key[2])
        arcs = arcs[:_MOST_ALIKE]
        for (number, piece, low, sweep), (other, rival, first, span) in itertools.product(
            arcs, arcs
        ):
            if piece == rival or other in repeated or number in repeated:
                continue
            is_longer = span > sweep + slack or (abs(span - sweep) <= slack and other < number)
            begin = (low - first + slack) % math.tau - slack
            if is_longer and begin + sweep <= span + slack:
                repeated.add(number)
    return repeated


def _repeated_curves(owned: Sequence[_Owned]) -> set[int]:
    """Return the splines that equal one before, in either sense."""
    known: dict[tuple[tuple[int, int], ...], int] = {}
    repeated: set[int] = set()
    for number, (piece, start, element) in enumerate(owned):
        if isinstance(element, Spline):
            points = (start, *element.through)
            cells = tuple((round(x / JOIN_M), round(y / JOIN_M)) for x, y in points)
            if known.setdefault(min(cells, cells[::-1]), piece) != piece:
                repeated.add(number)
    return repeated


class PointIndex:
    """Numbers points such that those within `JOIN_M` of one another have the same."""

    def __init__(self) -> None:
        self.points: list[Point2] = []
        self._cells: dict[tuple[int, int], list[int]] = {}

    def at(self, point: Point2) -> int:
        """Return the number of a point."""
        column, row = (math.floor(coordinate / JOIN_M) for coordinate in point)
        for cell in itertools.product((column, column - 1, column + 1), (row, row - 1, row + 1)):
            for node in self._cells.get(cell, ()):
                if math.dist(self.points[node], point) <= JOIN_M:
                    return node
        self.points.append(point)
        self._cells.setdefault((column, row), []).append(len(self.points) - 1)
        return len(self.points) - 1
