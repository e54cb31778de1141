"""Search removal paths that are not straight: A* over translations, then with turns.

There are five outcomes. *free*: a path was found and checked in small steps. *closed*: the search
covered everything reachable on the lattice without a way out. *budget spent*: undecided.
*not searched*: the time was over before. *no effort left*: other searches took all of it before.
Budgets count iterations and effort, never time.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from skillplan_cad.planning.motion_space import (
    Array,
    Axis,
    Met,
    Surroundings,
    find_axes,
    list_stops,
    rotate_about,
)
from skillplan_cad.planning.shrunk_meshes import MeshTrees
from skillplan_cad.product import Part, Vector

Outcome = Literal["free", "closed", "budget spent", "not searched", "no effort left"]

_INSET_SHARE = 0.9
_TURN_STEPS = 24  # per full turn
_BEND_SHARE = 0.1  # cost of a bend, as a share of the smallest extent of the moving parts
_COARSE_STEP = 4.0  # distance of the placements checked in the search, in insets


@dataclass(frozen=True, slots=True)
class Move:
    """A straight move, or a turn.

    Parameters
    ----------
    offset_m
        Translation; zero for a turn.
    angle_rad, axis
        Rotation angle and axis, located with the part in place; 0 and None for a straight move.
    """

    offset_m: Vector
    angle_rad: float = 0.0
    axis: Axis | None = None


@dataclass(frozen=True, slots=True)
class FreePath:
    """Result of a path search.

    Parameters
    ----------
    moves
        Moves from the place in the product to the outside; empty unless the outcome is free.
    turned
        True if turns were searched.
    in_the_way
        Obstacles, the nearest first: each part once, with a point.
    effort
        Work of the search, as in `Surroundings.effort`.
    """

    outcome: Outcome
    moves: tuple[Move, ...]
    iterations: int
    turned: bool
    in_the_way: tuple[Met, ...]
    effort: float = 0.0


def find_free_path(
    moving: Sequence[Part],
    standing: Sequence[Part],
    tolerance_m: float = 1e-4,
    budget: int = 20_000,
    turns: bool = True,
    effort: float = math.inf,
    trees: MeshTrees | None = None,
) -> FreePath:
    """Search a way out for parts that move as one: translations first, then turns.

    Parameters
    ----------
    standing
        Parts that stay, except mates of a moving thread.
    tolerance_m
        Distance by which every face is moved inwards [m].
    budget
        Iteration limit of each of the two searches.
    turns
        True to search turns if translations fail.
    effort
        Limit of the work of both searches, as in `Surroundings.effort`.
    trees
        Meshes shrunk by `get_inset_m` that other searches share.
    """
    trees = trees or MeshTrees(get_inset_m(tolerance_m))
    space = _Space(moving, standing, tolerance_m, trees, effort)
    overlaps = space.surroundings.list_overlaps()
    if overlaps:
        return FreePath("closed", (), 0, False, overlaps)
    straight = _search(space, (), budget)
    if straight.outcome == "free" or not turns or space.is_spent():
        return replace(straight, effort=space.surroundings.effort)
    turning = _search(space, find_axes(moving), budget)
    met = {obstacle.part: obstacle for obstacle in (*turning.in_the_way, *straight.in_the_way)}
    ordered = {
        obstacle.part: met[obstacle.part]
        for obstacle in (*straight.in_the_way, *turning.in_the_way)
    }
    spent = straight.iterations + turning.iterations
    return FreePath(
        turning.outcome,
        turning.moves,
        spent,
        True,
        tuple(ordered.values()),
        space.surroundings.effort,
    )


def get_inset_m(tolerance_m: float) -> float:
    """Return the inset of the meshes, with which overlaps of twice the tolerance still collide."""
    return _INSET_SHARE * tolerance_m


@dataclass(frozen=True, slots=True, order=True)
class _Node:
    """A placement: numbers of the offsets on the axes, of the rotation axis and of the angle."""

    x: int
    y: int
    z: int
    axis: int = 0
    turn: int = 0


def _compute_signs(here: _Node, there: _Node) -> tuple[int, ...]:
    """Return the signs of a move along the axes, and 1 for a turn."""
    steps = (there.x - here.x, there.y - here.y, there.z - here.z)
    return (*((step > 0) - (step < 0) for step in steps), int(here.turn != there.turn))


class _Space:
    """Placements of the moving parts, and their collisions."""

    def __init__(
        self,
        moving: Sequence[Part],
        standing: Sequence[Part],
        tolerance_m: float,
        trees: MeshTrees,
        effort: float,
    ) -> None:
        self.fine_m, self._effort = tolerance_m, effort
        self.surroundings = Surroundings(
            [trees.get(part) for part in moving], [trees.get(part) for part in standing]
        )
        self.offsets = list_stops(moving, standing, tolerance_m)
        points = np.concatenate([part.vertices_m for part in moving])
        self._points = points
        self.bend_m = _BEND_SHARE * float(np.ptp(points, axis=0).min())
        self._radii: dict[Axis, float] = {}
        self._turns: dict[tuple[Axis | None, float], tuple[Array, Array]] = {}
        self._boxes: dict[tuple[Axis | None, float], tuple[Array, Array]] = {}

    def is_spent(self) -> bool:
        """Return whether the limit of the effort is reached."""
        return self.surroundings.effort >= self._effort

    def start(self) -> _Node:
        """Return the node of the place in the product."""
        x, y, z = (int(np.argmin(np.abs(offsets))) for offsets in self.offsets)
        return _Node(x, y, z)

    def offset(self, node: _Node) -> Array:
        """Return the offset of a node from the place in the product."""
        numbers = (node.x, node.y, node.z)
        return np.array([self.offsets[axis][number] for axis, number in enumerate(numbers)])

    def turn(self, axis: Axis | None, angle_rad: float) -> tuple[Array, Array]:
        """Return a rotation as matrix and offset, from a cache."""
        key = (axis, angle_rad)
        if key not in self._turns:
            self._turns[key] = (
                (np.eye(3), np.zeros(3)) if axis is None else rotate_about(axis, angle_rad)
            )
        return self._turns[key]

    def box(self, axis: Axis | None, angle_rad: float) -> tuple[Array, Array]:
        """Return the bounding box of the rotated, untranslated moving parts."""
        key = (axis, angle_rad)
        if key not in self._boxes:
            matrix, by = self.turn(axis, angle_rad)
            low, high = self.surroundings.compute_box(matrix)
            self._boxes[key] = (low + by, high + by)
        return self._boxes[key]

    def radius_m(self, axis: Axis) -> float:
        """Return the greatest distance of the moving parts from a line."""
        if axis not in self._radii:
            offsets = self._points - np.asarray(axis.point_m)
            across = np.cross(offsets, np.asarray(axis.direction))
            self._radii[axis] = float(np.linalg.norm(across, axis=1).max())
        return self._radii[axis]

    def find_obstacle_between(
        self, axis: Axis | None, angles: tuple[float, float], ends: tuple[Array, Array], step: float
    ) -> Met | None:
        """Return the first obstacle between two placements, without the first of them."""
        length = float(np.linalg.norm(ends[1] - ends[0]))
        if axis is not None and angles[0] != angles[1]:
            length += abs(angles[1] - angles[0]) * self.radius_m(axis)
        number = max(1, int(np.ceil(length / step)))
        for k in range(1, number + 1):
            if self.is_spent():
                raise _EffortSpentError
            share = k / number
            angle = angles[0] + share * (angles[1] - angles[0])
            matrix, by = (
                self.turn(axis, angle) if angles[0] == angles[1] else _compute_turn(axis, angle)
            )
            met = self.surroundings.find_obstacle(
                matrix, by + ends[0] + share * (ends[1] - ends[0])
            )
            if met is not None:
                return met
        return None


def _compute_turn(axis: Axis | None, angle_rad: float) -> tuple[Array, Array]:
    assert axis is not None
    return rotate_about(axis, angle_rad)


class _Search:
    def __init__(self, space: _Space, axes: tuple[Axis, ...]) -> None:
        self.space, self.axes = space, axes
        self.iterations = 0
        self.came: dict[_Node, _Node] = {}
        self.met: dict[str, Met] = {}
        self._meets: dict[_Node, Met | None] = {}

    def pose(self, node: _Node) -> tuple[Axis | None, float]:
        """Return axis and angle of a node."""
        if not node.turn:
            return None, 0.0
        return self.axes[node.axis], node.turn * 2 * np.pi / _TURN_STEPS

    def list_neighbours(self, node: _Node) -> Iterator[tuple[_Node, float]]:
        """Yield the nodes one move away, with their distance."""
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

    def find_obstacle(self, node: _Node, there: _Node) -> Met | None:
        """Return the obstacle on a move, or None."""
        if there not in self._meets:
            if self.space.is_spent():
                raise _EffortSpentError
            matrix, by = self.space.turn(*self.pose(there))
            offset = by + self.space.offset(there)
            self._meets[there] = self.space.surroundings.find_obstacle(matrix, offset)
        met = self._meets[there]
        if met is None:
            met = self._check_between(node, there, _COARSE_STEP * self.space.fine_m)
        return met

    def _check_between(self, node: _Node, there: _Node, step: float) -> Met | None:
        axis, angles = self._find_turn(node, there)
        ends = (self.space.offset(node), self.space.offset(there))
        return self.space.find_obstacle_between(axis, angles, ends, step)

    def _find_turn(self, node: _Node, there: _Node) -> tuple[Axis | None, tuple[float, float]]:
        """Return the rotation axis of a move, and its first and last angle."""
        (first, before), (second, after) = self.pose(node), self.pose(there)
        if abs(after - before) > np.pi:  # through half a turn
            after += 2 * np.pi if after < before else -2 * np.pi
        return first or second, (before, after)

    def compute_bend_m(self, node: _Node, there: _Node) -> float:
        """Return the extra cost of a change of direction; paths with few moves are easier."""
        before = self.came.get(node)
        if before is None:
            return 0.0
        return (
            0.0
            if _compute_signs(before, node) == _compute_signs(node, there)
            else self.space.bend_m
        )

    def is_out(self, node: _Node) -> bool:
        """Return whether the moving parts are clear of the bounding box of the others."""
        low, high = self.space.box(*self.pose(node))
        offset = self.space.offset(node)
        return self.space.surroundings.is_out(low + offset, high + offset)

    def bound_left_m(self, node: _Node) -> float:
        """Return a lower bound on the remaining distance to the outside."""
        low, high = self.space.box(*self.pose(node))
        offset = self.space.offset(node)
        surroundings = self.space.surroundings
        distances = np.concatenate(
            [high + offset - surroundings.low_m, surroundings.high_m - low - offset]
        )
        return max(0.0, float(distances.min()))

    def build_moves(self, node: _Node) -> tuple[Move, ...] | None:
        """Return the path to a node, or None if it collides in small steps."""
        path = [node]
        while path[-1] in self.came:
            path.append(self.came[path[-1]])
        path.reverse()
        moves: list[Move] = []
        for here, there in itertools.pairwise(path):
            if self._check_between(here, there, self.space.fine_m) is not None:
                return None
            axis, (before, after) = self._find_turn(here, there)
            offset = self.space.offset(there) - self.space.offset(here)
            _append(moves, offset, after - before, axis if before != after else None)
        return tuple(moves)


def _append(moves: list[Move], offset: Array, angle: float, axis: Axis | None) -> None:
    """Add a move, merged with the last one if it continues in the same direction."""
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


class _EffortSpentError(Exception):
    """The limit of the effort is reached between two placements."""


def _search(space: _Space, axes: tuple[Axis, ...], budget: int) -> FreePath:
    """Run A* within an iteration budget."""
    search = _Search(space, axes)
    try:
        return _explore(space, search, budget)
    except _EffortSpentError:
        return FreePath("budget spent", (), search.iterations, bool(axes), _met(search))


def _explore(space: _Space, search: _Search, budget: int) -> FreePath:
    axes, start = search.axes, space.start()
    costs = {start: 0.0}
    heap = [(search.bound_left_m(start), 0.0, start)]
    done: set[_Node] = set()
    doubtful = False
    while heap:
        _, cost, node = heapq.heappop(heap)
        if node in done:
            continue
        done.add(node)
        if search.is_out(node):
            moves = search.build_moves(node)
            if moves is not None:
                return FreePath("free", moves, search.iterations, bool(axes), _met(search))
            doubtful = True
            continue
        if search.iterations >= budget:
            return FreePath("budget spent", (), search.iterations, bool(axes), _met(search))
        search.iterations += 1
        for there, length in search.list_neighbours(node):
            if there in done or cost + length >= costs.get(there, np.inf):
                continue
            met = search.find_obstacle(node, there)
            if met is not None:
                search.met.setdefault(met.part, met)
                continue
            spent = cost + length + search.compute_bend_m(node, there)
            if spent >= costs.get(there, np.inf):
                continue
            costs[there] = spent
            search.came[there] = node
            heapq.heappush(heap, (spent + search.bound_left_m(there), spent, there))
    # A path that fails in small steps proves nothing either way.
    outcome: Outcome = "budget spent" if doubtful else "closed"
    return FreePath(outcome, (), search.iterations, bool(axes), _met(search))


def _met(search: _Search) -> tuple[Met, ...]:
    return tuple(search.met.values())
