"""Ways out for what no straight line frees: A* over translations, then over turns as well.

The answer is one of three words. *free*: a path was found, checked in small steps. *closed*:
everything that can be reached on the lattice was looked at, and nothing leads out. *budget spent*:
neither is known. The budget counts iterations, never time.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from skillplan_cad.planning.motion_space import (
    Array,
    Axis,
    Met,
    Surroundings,
    axes_of,
    stops,
    turned,
)
from skillplan_cad.planning.shrunk_meshes import mesh_trees
from skillplan_cad.product import Part, Vector

Outcome = Literal["free", "closed", "budget spent"]

_INSET_SHARE = 0.9
_TURN_STEPS = 24  # of a whole turn
_BEND_SHARE = 0.1  # of the least extent of what moves: what a bend counts
_COARSE_STEP = 4.0  # of the inset, between the placements that the search looks at


@dataclass(frozen=True, slots=True)
class Move:
    """A straight move, or a turn.

    Parameters
    ----------
    offset_m
        How far it goes; zero of a turn.
    angle_rad, axis
        How far it is turned, and about which line, as it lies with the part in place; 0 and None
        of a straight move.
    """

    offset_m: Vector
    angle_rad: float = 0.0
    axis: Axis | None = None


@dataclass(frozen=True, slots=True)
class FreePath:
    """What was found out about taking parts out.

    Parameters
    ----------
    outcome
        One of the three words.
    moves
        From its place to beside all that stands; empty unless it is free.
    iterations
        Spent on the search.
    turned
        Whether turns were searched, too.
    in_the_way
        What was met, the nearest first: each part once, with a point.
    """

    outcome: Outcome
    moves: tuple[Move, ...]
    iterations: int
    turned: bool
    in_the_way: tuple[Met, ...]


def free_path(
    moving: Sequence[Part],
    standing: Sequence[Part],
    tolerance_m: float = 1e-4,
    budget: int = 20_000,
    turns: bool = True,
) -> FreePath:
    """Return a way out for parts that move as one: by translations, else by turns as well.

    Parameters
    ----------
    moving, standing
        What moves, and what stays; that by which a thread is waived is left out of it.
    tolerance_m
        How far every face is moved inwards.
    budget
        The most iterations that either search may take.
    turns
        Whether to search turns where translations do not lead out.
    """
    space = _Space(moving, standing, tolerance_m)
    straight = _search(space, (), budget)
    if straight.outcome == "free" or not turns:
        return straight
    turning = _search(space, axes_of(moving), budget)
    met = {one.part: one for one in (*turning.in_the_way, *straight.in_the_way)}
    ordered = {one.part: met[one.part] for one in (*straight.in_the_way, *turning.in_the_way)}
    spent = straight.iterations + turning.iterations
    return FreePath(turning.outcome, turning.moves, spent, True, tuple(ordered.values()))


@dataclass(frozen=True, slots=True, order=True)
class _Node:
    """A placement: numbers of offsets along the axes, and of axis and angle."""

    x: int
    y: int
    z: int
    axis: int = 0
    turn: int = 0


def _signs(here: _Node, there: _Node) -> tuple[int, ...]:
    """Return which way a move goes, and whether it is a turn."""
    ways = (there.x - here.x, there.y - here.y, there.z - here.z)
    return (*((way > 0) - (way < 0) for way in ways), int(here.turn != there.turn))


class _Space:
    """Placements, and what they meet."""

    def __init__(
        self, moving: Sequence[Part], standing: Sequence[Part], tolerance_m: float
    ) -> None:
        self.fine_m = tolerance_m
        # What overlaps by twice the tolerance still does.
        inset_m = _INSET_SHARE * tolerance_m
        self.surroundings = Surroundings(mesh_trees(moving, inset_m), mesh_trees(standing, inset_m))
        self.offsets = stops(moving, standing, tolerance_m)
        points = np.concatenate([part.vertices_m for part in moving])
        self._points = points
        self.bend_m = _BEND_SHARE * float(np.ptp(points, axis=0).min())
        self._radii: dict[Axis, float] = {}
        self._turns: dict[tuple[Axis | None, float], tuple[Array, Array]] = {}
        self._boxes: dict[tuple[Axis | None, float], tuple[Array, Array]] = {}

    def start(self) -> _Node:
        """Return the node at which nothing is moved."""
        x, y, z = (int(np.argmin(np.abs(offsets))) for offsets in self.offsets)
        return _Node(x, y, z)

    def offset(self, node: _Node) -> Array:
        """Return how far a node is from the place in the product."""
        numbers = (node.x, node.y, node.z)
        return np.array([self.offsets[axis][number] for axis, number in enumerate(numbers)])

    def turn(self, axis: Axis | None, angle_rad: float) -> tuple[Array, Array]:
        """Return a turn as matrix and offset; kept, as there are few."""
        key = (axis, angle_rad)
        if key not in self._turns:
            self._turns[key] = (np.eye(3), np.zeros(3)) if axis is None else turned(axis, angle_rad)
        return self._turns[key]

    def box(self, axis: Axis | None, angle_rad: float) -> tuple[Array, Array]:
        """Return the box about what moves, turned and not yet moved."""
        key = (axis, angle_rad)
        if key not in self._boxes:
            matrix, by = self.turn(axis, angle_rad)
            low, high = self.surroundings.box_of(matrix)
            self._boxes[key] = (low + by, high + by)
        return self._boxes[key]

    def radius_m(self, axis: Axis) -> float:
        """Return how far a point of what moves is from a line at most."""
        if axis not in self._radii:
            apart = self._points - np.asarray(axis.point_m)
            across = np.cross(apart, np.asarray(axis.direction))
            self._radii[axis] = float(np.linalg.norm(across, axis=1).max())
        return self._radii[axis]

    def meets_between(
        self, axis: Axis | None, angles: tuple[float, float], ends: tuple[Array, Array], step: float
    ) -> Met | None:
        """Return what is met between two placements, the first of them left out."""
        length = float(np.linalg.norm(ends[1] - ends[0]))
        if axis is not None and angles[0] != angles[1]:
            length += abs(angles[1] - angles[0]) * self.radius_m(axis)
        number = max(1, int(np.ceil(length / step)))
        for k in range(1, number + 1):
            share = k / number
            angle = angles[0] + share * (angles[1] - angles[0])
            matrix, by = self.turn(axis, angle) if angles[0] == angles[1] else _fresh(axis, angle)
            met = self.surroundings.meets(matrix, by + ends[0] + share * (ends[1] - ends[0]))
            if met is not None:
                return met
        return None


def _fresh(axis: Axis | None, angle_rad: float) -> tuple[Array, Array]:
    assert axis is not None
    return turned(axis, angle_rad)


class _Search:
    """One A* search."""

    def __init__(self, space: _Space, axes: tuple[Axis, ...]) -> None:
        self.space, self.axes = space, axes
        self.came: dict[_Node, _Node] = {}
        self.met: dict[str, Met] = {}
        self._meets: dict[_Node, Met | None] = {}

    def pose(self, node: _Node) -> tuple[Axis | None, float]:
        """Return axis and angle of a node."""
        if not node.turn:
            return None, 0.0
        return self.axes[node.axis], node.turn * 2 * np.pi / _TURN_STEPS

    def neighbours(self, node: _Node) -> Iterator[tuple[_Node, float]]:
        """Yield where one move leads, and how far it is."""
        here = (node.x, node.y, node.z)
        for axis in range(3):
            offsets = self.space.offsets[axis]
            for number in (here[axis] + 1, here[axis] - 1):
                if 0 <= number < len(offsets):
                    length = abs(float(offsets[number] - offsets[here[axis]]))
                    yield replace(node, **{"xyz"[axis]: number}), length
        half = _TURN_STEPS // 2
        for number, line in enumerate(self.axes):
            if node.turn and number != node.axis:
                continue
            length = self.space.radius_m(line) * 2 * np.pi / _TURN_STEPS
            for turn in (node.turn + 1, node.turn - 1):
                wrapped = (turn + half) % _TURN_STEPS - half
                yield _Node(*here, number if wrapped else 0, wrapped), length

    def blocked(self, node: _Node, there: _Node) -> Met | None:
        """Return what is met on one move."""
        if there not in self._meets:
            matrix, by = self.space.turn(*self.pose(there))
            offset = by + self.space.offset(there)
            self._meets[there] = self.space.surroundings.meets(matrix, offset)
        found = self._meets[there]
        if found is None:
            found = self._between(node, there, _COARSE_STEP * self.space.fine_m)
        return found

    def _between(self, node: _Node, there: _Node, step: float) -> Met | None:
        axis, angles = self._turn_between(node, there)
        ends = (self.space.offset(node), self.space.offset(there))
        return self.space.meets_between(axis, angles, ends, step)

    def _turn_between(self, node: _Node, there: _Node) -> tuple[Axis | None, tuple[float, float]]:
        """Return about which line it is turned in one move, from and to which angle."""
        (one, before), (other, after) = self.pose(node), self.pose(there)
        if abs(after - before) > np.pi:  # through half a turn
            after += 2 * np.pi if after < before else -2 * np.pi
        return one or other, (before, after)

    def bend_m(self, node: _Node, there: _Node) -> float:
        """Return what it counts to go on otherwise than before: few moves are easier to make."""
        before = self.came.get(node)
        if before is None:
            return 0.0
        return 0.0 if _signs(before, node) == _signs(node, there) else self.space.bend_m

    def is_out(self, node: _Node) -> bool:
        """Return whether all is beside what stands."""
        low, high = self.space.box(*self.pose(node))
        offset = self.space.offset(node)
        return self.space.surroundings.is_out(low + offset, high + offset)

    def left_m(self, node: _Node) -> float:
        """Return the least way to beside all that stands: no path is shorter."""
        low, high = self.space.box(*self.pose(node))
        offset = self.space.offset(node)
        about = self.space.surroundings
        ways = np.concatenate([high + offset - about.low_m, about.high_m - low - offset])
        return max(0.0, float(ways.min()))

    def moves(self, node: _Node) -> tuple[Move, ...] | None:
        """Return the path to a node, or None if in small steps something is met after all."""
        path = [node]
        while path[-1] in self.came:
            path.append(self.came[path[-1]])
        path.reverse()
        found: list[Move] = []
        for here, there in itertools.pairwise(path):
            if self._between(here, there, self.space.fine_m) is not None:
                return None
            axis, (before, after) = self._turn_between(here, there)
            offset = self.space.offset(there) - self.space.offset(here)
            _append(found, offset, after - before, axis if before != after else None)
        return tuple(found)


def _append(moves: list[Move], offset: Array, angle: float, axis: Axis | None) -> None:
    """Add a move to others, as part of the last one where it goes on in the same way."""
    new = Move((float(offset[0]), float(offset[1]), float(offset[2])), angle, axis)
    last = moves[-1] if moves else None
    if last is not None and last.axis == axis:
        sums = np.asarray(last.offset_m) + offset
        onwards = float(np.asarray(last.offset_m) @ offset) > 0 and np.allclose(
            np.cross(last.offset_m, offset), 0.0, atol=1e-12
        )
        if onwards or (axis is not None and last.angle_rad * angle > 0):
            new = Move(
                (float(sums[0]), float(sums[1]), float(sums[2])), last.angle_rad + angle, axis
            )
            moves.pop()
    moves.append(new)


def _search(space: _Space, axes: tuple[Axis, ...], budget: int) -> FreePath:
    """Return what A* finds."""
    search, start = _Search(space, axes), space.start()
    costs = {start: 0.0}
    heap = [(search.left_m(start), 0.0, start)]
    done: set[_Node] = set()
    iterations = 0
    doubtful = False
    while heap:
        _, cost, node = heapq.heappop(heap)
        if node in done:
            continue
        done.add(node)
        if search.is_out(node):
            moves = search.moves(node)
            if moves is not None:
                return FreePath("free", moves, iterations, bool(axes), tuple(search.met.values()))
            doubtful = True
            continue
        if iterations >= budget:
            return FreePath("budget spent", (), iterations, bool(axes), _met(search))
        iterations += 1
        for there, length in search.neighbours(node):
            if there in done or cost + length >= costs.get(there, np.inf):
                continue
            met = search.blocked(node, there)
            if met is not None:
                search.met.setdefault(met.part, met)
                continue
            spent = cost + length + search.bend_m(node, there)
            if spent >= costs.get(there, np.inf):
                continue
            costs[there] = spent
            search.came[there] = node
            heapq.heappush(heap, (spent + search.left_m(there), spent, there))
    # A path that only large steps allow is no path, and no proof that there is none.
    outcome: Outcome = "budget spent" if doubtful else "closed"
    return FreePath(outcome, (), iterations, bool(axes), _met(search))


def _met(search: _Search) -> tuple[Met, ...]:
    return tuple(search.met.values())
