"""Fits of parts that convex pieces make tight: they take the clearance that the meshes leave.

A part that moves is made of convex pieces. In hollows these stand out of its mesh. If they fill the
clearance of a fit, a skill is refused that the meshes allow.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations

from skillplan.collision.solid import Solid
from skillplan.task.motion import Event, Point
from skillplan.task.pose import DOWN
from skillplan.task.scene import WORLD, Body, Placement
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan_pinocchio.shapes import (
    ConvexPiece,
    may_touch,
    nearness,
    pieces_of,
    standing_pieces_of,
)

# Places along an insertion at which the clearance of the meshes is measured.
_SAMPLES = 8
# Bodies that rest on each other touch: clearance is measured from so far off their seat on [m].
_OFF_SEAT_M = 0.001
# Pieces that leave more of a clearance than this are no matter, as are those that take less [m].
_NARROW_M = 1e-4
_LEAST_TAKEN_M = 5e-5
# Rounding of distances [m].
_ROUNDING_M = 1e-5


@dataclass(frozen=True, slots=True)
class TightFit:
    """Two parts whose convex pieces take clearance from the fit of their meshes.

    Parameters
    ----------
    bodies
        Their names, first the one that moves.
    clearance_m
        Least distance between the meshes along the insertion [m], 1 mm at most.
    left_m
        Clearance that the pieces leave [m]; below 0 the depth by which they overlap.
    """

    bodies: tuple[str, str]
    clearance_m: float
    left_m: float

    @property
    def is_tight(self) -> bool:
        """Whether pieces take enough of the clearance to matter."""
        return self.left_m < min(_NARROW_M, self.clearance_m - _LEAST_TAKEN_M)

    @property
    def is_blocked(self) -> bool:
        """Whether pieces take more than the clearance."""
        return self.is_tight and self.left_m < -_ROUNDING_M

    @property
    def words(self) -> str:
        """One sentence without a full stop."""
        mover, other = self.bodies
        begin = f"{mover!r} fits {other!r}"
        if self.clearance_m < _OFF_SEAT_M - _ROUNDING_M:
            begin += f" with {self.clearance_m * 1e3:.2f} mm between their meshes"
        if self.is_blocked:
            pieces = f"are {-self.left_m * 1e3:.2f} mm deep in each other"
        else:
            pieces = f"leave {self.left_m * 1e3:.2f} mm of it"
        return f"{begin}, but when it moves, their convex pieces {pieces}"


def blocked_fits(task: Task, *, as_pieces: bool) -> dict[str, str]:
    """Return messages on fits that pieces block in every order, by the fact of a placed part.

    Parameters
    ----------
    task, as_pieces
        As of `fits_of`.
    """
    blocked = []
    for fits in fits_of(task, as_pieces=as_pieces):
        widest = max(fits, key=lambda fit: fit.left_m)
        if widest.is_blocked:
            blocked.append(widest)
    return _messages(blocked, "")


def tight_fits(task: Task, *, as_pieces: bool) -> dict[str, str]:
    """Return messages on fits that pieces make tight in any order, by the fact of a placed part.

    Parameters
    ----------
    task, as_pieces
        As of `fits_of`.
    """
    narrowest = (
        min(fits, key=lambda fit: fit.left_m) for fits in fits_of(task, as_pieces=as_pieces)
    )
    return _messages(
        [fit for fit in narrowest if fit.is_tight], ", so that swept or an engine may refuse it"
    )


def _messages(fits: Sequence[TightFit], effect: str) -> dict[str, str]:
    found: dict[str, str] = {}
    for fit in fits:
        fact = f"placed({fit.bodies[0]})"
        message = f"{fit.words}{effect}. Give 'pieces' that follow the meshes, or more clearance."
        found[fact] = f"{found[fact]} {message}" if fact in found else message
    return found


def fits_of(task: Task, *, as_pieces: bool) -> list[list[TightFit]]:
    """Return, for every pair of near parts, the fit in each order and direction of insertion.

    Pairs of convex parts are left out, and orders in which the meshes themselves do not pass.

    Parameters
    ----------
    task
        With bodies at their starts and goals.
    as_pieces
        Whether bodies that stand are convex pieces as well, and not meshes.
    """
    if not any(body.surfaces for body in task.scene.bodies):
        return []
    found: list[list[TightFit]] = []
    for placed in (_at_start(task), _at_goal(task)):
        pairs: dict[frozenset[str], list[TightFit]] = {}
        for mover, other in permutations(placed, 2):
            if (mover.body.surfaces or other.body.surfaces) and mover.is_near(other):
                pair = frozenset((mover.body.name, other.body.name))
                fits = _fits(mover, other, as_pieces=as_pieces)
                pairs.setdefault(pair, []).extend(fits)
        found += [fits for fits in pairs.values() if fits]
    return found


@dataclass(frozen=True)
class _Placed:
    """A body at the start or at its goal, and the directions from which it comes there."""

    body: Body
    placement: Placement
    along: tuple[Point, ...]

    @cached_property
    def solid(self) -> Solid:
        return Solid(self.body.exact_shapes, self.placement.pose)

    @cached_property
    def meshes(self) -> tuple[ConvexPiece, ...]:
        return standing_pieces_of(self.body, self.placement.pose)

    @cached_property
    def pieces(self) -> tuple[ConvexPiece, ...]:
        return pieces_of(self.body, self.placement.pose)

    @cached_property
    def low(self) -> tuple[float, ...]:
        return tuple(min(piece.low[axis] for piece in self.meshes) for axis in range(3))

    @cached_property
    def high(self) -> tuple[float, ...]:
        return tuple(max(piece.high[axis] for piece in self.meshes) for axis in range(3))

    def is_near(self, other: _Placed) -> bool:
        """Whether the boxes about both overlap or touch."""
        return all(
            low <= top and bottom <= high
            for low, high, bottom, top in zip(
                self.low, self.high, other.low, other.high, strict=True
            )
        )


def _fits(mover: _Placed, other: _Placed, *, as_pieces: bool) -> Iterator[TightFit]:
    """Yield the fit for every direction in which the meshes pass each other."""
    stands = other.pieces if as_pieces else other.meshes
    for along in mover.along:
        length_m = _length_m(mover, other, along)
        if length_m <= _ROUNDING_M:
            # It stands on the other.
            continue
        clearance_m = _clearance_m(mover.meshes, other.meshes, along, length_m)
        if clearance_m <= 0:
            continue
        back = _times(along, -length_m)
        left_m = _distance_m([piece.swept(back) for piece in mover.pieces], stands)
        if left_m < -_LEAST_TAKEN_M:
            left_m += mover.solid.depth_m(other.solid)
        else:
            # At its seat it touches.
            seat = _times(along, -min(_OFF_SEAT_M, length_m / 2))
            raised = [ConvexPiece(piece.corners + seat) for piece in mover.pieces]
            left_m = _distance_m([piece.swept(back) for piece in raised], stands)
        yield TightFit((mover.body.name, other.body.name), clearance_m, left_m)


def _length_m(mover: _Placed, other: _Placed, along: Point) -> float:
    """Return how far back a body goes until the box about it leaves another's [m]."""
    exits_m = []
    for axis in range(3):
        if abs(along[axis]) > _ROUNDING_M:
            ahead_m = (
                other.high[axis] - mover.low[axis]
                if along[axis] < 0
                else mover.high[axis] - other.low[axis]
            )
            exits_m.append(ahead_m / abs(along[axis]))
    return min(exits_m)


def _clearance_m(
    moving: Sequence[ConvexPiece],
    standing: Sequence[ConvexPiece],
    along: Point,
    length_m: float,
) -> float:
    """Return the least distance of meshes along an insertion, off their seat [m]; <= 0 for none."""
    begin_m = min(_OFF_SEAT_M, length_m / 2)
    step_m = (length_m - begin_m) / _SAMPLES
    offsets = [_times(along, -(begin_m + number * step_m)) for number in range(_SAMPLES)]
    distances = (
        nearness(one, two, offset).distance_m
        for offset in offsets
        for one in moving
        for two in standing
    )
    return min(_OFF_SEAT_M, *distances)


def _distance_m(moving: Sequence[ConvexPiece], standing: Sequence[ConvexPiece]) -> float:
    """Return the least distance of pieces [m], 1 mm at most; below 0 the depth of an overlap."""
    distances = (
        nearness(one, two).distance_m
        for one in moving
        for two in standing
        if may_touch(one, two, -_OFF_SEAT_M)
    )
    return min(_OFF_SEAT_M, min(distances, default=_OFF_SEAT_M))


def _at_start(task: Task) -> list[_Placed]:
    return [
        _Placed(body, placement, (DOWN,))
        for body in task.scene.bodies
        if (placement := _solid_in(body, task.initial)) is not None
    ]


def _at_goal(task: Task) -> list[_Placed]:
    """Return bodies at their goals; those that stay where they are never move."""
    goal = task.goal.requires
    along: dict[str, dict[Point, None]] = {}
    for skill in task.skills:
        for motion in (skill.motion, *(way.motion for way in skill.ways)):
            for route in () if motion is None else motion.routes:
                for visit in route.visits:
                    if visit.event is Event.RELEASE:
                        along.setdefault(visit.subject, {})[visit.along] = None
    found = []
    for body in task.scene.bodies:
        placed, lies = _solid_in(body, goal), _solid_in(body, task.initial)
        if placed is not None:
            found.append(_Placed(body, placed, tuple(along.get(body.name, ()))))
        elif lies is not None:
            found.append(_Placed(body, lies, ()))
    return found


def _solid_in(body: Body, state: State) -> Placement | None:
    """Return where a body is in the world in a state; None for one in a feeder, or not there."""
    placements = (
        placement
        for placement in body.placements
        if placement.solid and placement.frame == WORLD and placement.fact in state
    )
    return next(placements, None)


def _times(direction: Point, length_m: float) -> Point:
    x, y, z = direction
    return (x * length_m, y * length_m, z * length_m)
