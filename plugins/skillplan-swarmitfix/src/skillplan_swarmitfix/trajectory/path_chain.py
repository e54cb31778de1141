"""Pieces of a path, in any order and sense, joined end to end."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from skillplan_swarmitfix.trajectory.path import (
    JOIN_M,
    TrajectoryFileError,
    TrajectoryPath,
)
from skillplan_swarmitfix.trajectory.path_elements import Element, reversed_element
from skillplan_swarmitfix.trajectory.plane_point import Point2, shown

MOST_NAMED = 6
"""So many entities are named in a message."""


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

    def reversed(self) -> Piece:
        """Return the piece in the opposite sense."""
        starts = [self.start, *(element.end for element in self.elements[:-1])]
        turned = tuple(
            reversed_element(start, element)
            for start, element in zip(starts, self.elements, strict=True)
        )
        return Piece(self.name, self.end, turned[::-1], self.places[::-1])


def chained(path: Path, pieces: Sequence[Piece]) -> TrajectoryPath:
    """Return the one trajectory that pieces make, end to end.

    It runs in the sense of the first piece; a closed one starts with it.

    Parameters
    ----------
    path
        The file that they come from.
    pieces
        At least one.

    Raises
    ------
    TrajectoryFileError
        If they form several paths, or a fork.
    """
    nodes = _Nodes()
    ends = [(nodes.at(piece.start), nodes.at(piece.end)) for piece in pieces]
    meeting: dict[int, list[int]] = {}
    for i, pair in enumerate(ends):
        for node in pair:
            meeting.setdefault(node, []).append(i)
    for node, those in meeting.items():
        if len(those) > 2:
            names = ", ".join(dict.fromkeys(pieces[i].name for i in those[:MOST_NAMED]))
            message = f"The path forks at {shown(nodes.points[node])}; keep one branch."
            raise TrajectoryFileError(path, message, names)
    left = dict.fromkeys(range(len(pieces)))
    chains = []
    while left:
        first = next(iter(left))
        del left[first]
        onward = list(_walk(ends[first][1], ends, meeting, left))
        back = list(_walk(ends[first][0], ends, meeting, left))
        chains.append([*((i, not flip) for i, flip in reversed(back)), (first, False), *onward])
    if len(chains) > 1:
        names = ", ".join(pieces[min(i for i, _ in chain)].name for chain in chains[:MOST_NAMED])
        message = (
            f"There are {len(chains)} paths that do not meet, the first of them at these "
            "entities; keep one, or close the gaps between them."
        )
        raise TrajectoryFileError(path, message, names)
    whole = [pieces[i].reversed() if flip else pieces[i] for i, flip in chains[0]]
    return TrajectoryPath.ended(
        whole[0].start,
        [element for piece in whole for element in piece.elements],
        [place for piece in whole for place in piece.places],
    )


def _walk(
    node: int,
    ends: Sequence[tuple[int, int]],
    meeting: Mapping[int, Sequence[int]],
    left: dict[int, None],
) -> Iterator[tuple[int, bool]]:
    """Yield the pieces along the path from a node, and whether each is followed backwards."""
    while True:
        i = next((i for i in meeting[node] if i in left), None)
        if i is None:
            return
        del left[i]
        flip = ends[i][0] != node
        yield i, flip
        node = ends[i][0 if flip else 1]


class _Nodes:
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
